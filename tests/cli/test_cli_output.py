"""Output: the verdict first, the result alone or all it rests on, units that are asked for."""

import csv
import io

import numpy as np
import pytest

import calib


@pytest.fixture(scope="module")
def folder(tmp_path_factory, run):
    """A model of a log; logs of the same arm, of a noisier sensor, and with a longer elbow."""
    folder = tmp_path_factory.mktemp("output")
    for name, words in {
        "log": "-n 200 --noise 1e-4",
        "same": "-n 60 --noise 1e-4 --seed 5",
        "noisy": "-n 100 --noise 5e-4 --seed 5",
        "moved": "-n 60 --noise 1e-4 --seed 5 --change elbow.offset=0.02",
    }.items():
        run("babble", "two_link", *words.split(), "-o", folder / f"{name}.csv")
    run.done("train", "two_link", "--data", folder / "log.csv", "-o", folder / "m.calib")
    return folder


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def test_check_begins_with_the_verdict_and_says_what_to_do(run):
    done = run("check", "m.calib", "--data", "same.csv")
    assert (done.code, done.out.splitlines()[0]) == (0, "still calibrated")
    done = run("check", "m.calib", "--data", "moved.csv")
    assert done.code == 3
    lines = done.out.splitlines()
    assert lines[0].startswith("DRIFTED: elbow is off by ")
    assert " 1.1" in lines[0].replace("+", " ")  # 0.02 rad
    assert "deg" in lines[0]
    assert any("calib adapt" in line for line in lines[1:])
    assert lines[-1].startswith("limited by ")
    assert "zeta" not in done.out
    told = run("check", "m.calib", "--data", "moved.csv", "-v").out
    assert "zeta" in told
    assert "what may have changed" in told


@pytest.mark.parametrize(
    ("words", "code", "first"),
    [
        ("--data same.csv --tolerance 1e-6", 3, "TOO COARSE"),
        ("--data noisy.csv", 0, "THE BOUND DOES NOT HOLD"),
    ],
)
def test_what_is_no_drift_is_said_first(run, words, code, first):
    done = run("check", "m.calib", *words.split())
    assert (done.code, done.out[: len(first)]) == (code, first)


@pytest.mark.parametrize(
    "words",
    [
        "check m.calib --data moved.csv",
        "evaluate m.calib --data same.csv",
        "adapt m.calib --data moved.csv -o b.calib",
        "train two_link --data log.csv -o n.calib",
        "query forward m.calib 0.5 1.0",
        "query inverse m.calib 0.1 0.4",
    ],
)
def test_quiet_is_one_line_and_no_note(run, words):
    done = run(*words.split(), "--quiet")
    assert done.err == ""
    assert len(done.out.splitlines()) == 1


def test_what_a_log_differs_in_is_told_with_its_unit(run):
    done = run("train", "two_link", "--data", "moved.csv", "-o", "found.calib")
    (found,) = (line for line in done.out.splitlines() if line.startswith("found: "))
    assert "elbow" in found
    assert "1.1" in found  # 0.02 rad
    assert "deg" in found
    assert "bounds" not in found
    assert "expected_error" in run("info", "found.calib").out


def test_positions_are_typed_and_printed_in_the_unit_asked_for(run):
    plain = run("query", "inverse", "m.calib", "0.1", "0.4", "--json").document
    asked = run("query", "inverse", "m.calib", "100", "400", "--unit", "mm", "--json").document
    assert asked == plain  # documents are in the model's unit
    done = run("query", "forward", "m.calib", "0.5", "1.0", "--unit", "cm")
    x, y = calib.load("m.calib").forward([0.5, 1.0])
    row = done.out.splitlines()[1].split()
    assert [float(row[2]), float(row[3])] == pytest.approx([100 * x, 100 * y], abs=1e-3)
    assert "x [cm]" in done.out
    typed = "x,y\n100,400\n"
    done = run("query", "inverse", "m.calib", "--input", "-", "--unit", "mm", stdin=typed)
    (answer,) = csv.DictReader(io.StringIO(done.out))
    (solution,) = plain["solutions"]
    assert float(answer["elbow"]) == pytest.approx(solution["joints"]["elbow"], abs=1e-6)
    assert (float(answer["x"]), float(answer["y"])) == pytest.approx((100.0, 400.0))
    bound = float(answer["expected_error"])
    assert bound == pytest.approx(1e3 * solution["expected_error"], rel=1e-6)
    run.refused(2, "mm", "query", "inverse", "m.calib", "1", "1", "--unit", "px")


@pytest.mark.parametrize(("factor", "offset"), [(1e3, 0.0), (640.0, 500.0), (1.0, 0.3)])
def test_a_log_of_another_unit_or_frame_is_told(run, tmp_path, factor, offset):
    samples = calib.babble(calib.load_arm("two_link"), 40, seed=8, noise=1e-4)
    path = tmp_path / "log.csv"
    table = np.hstack([samples.q, factor * samples.x + offset])
    np.savetxt(path, table, delimiter=",", header="shoulder,elbow,x,y", comments="")
    done = run("evaluate", "m.calib", "--data", path)
    assert done.code == 3
    assert "does not hold for this log" in done.out
    if factor != 1e3:
        return
    assert "--unit mm" in done.err
    adapt = ("adapt", "m.calib", "--data", path, "-o", tmp_path / "a.calib")
    raw, converted = run(*adapt, "-v"), run(*adapt, "--unit", "mm", "--json")
    assert " sensor units before" in raw.out  # and not mm, which it was not told
    assert "--unit mm" in raw.out
    assert converted.document["unit"] == "m"
    looked = run("check", "m.calib", "--data", path, "-v")
    assert looked.code == 3
    assert "check the log's unit before calib adapt" in looked.out
    assert "smallest [sensor units]" in looked.out
    assert "`" not in looked.out


def test_a_planar_log_without_a_tip_is_told_whose_positions_it_has(run, tmp_path):
    """A wrist that was measured and a tool that was taken are an offset of the elbow."""
    log = calib.babble(calib.load_arm("three_link", ["shoulder", "elbow"], "tip"), 60, noise=1e-4)
    calib.write_log(log, tmp_path / "log.csv")
    joints = ("--joints", "shoulder,elbow", "--data", tmp_path / "log.csv", "--size", "5")
    train = ("train", "three_link", *joints, "-o", tmp_path / "m.calib")
    assert "--tip" in run(*train).err
    assert "those of tip" not in run(*train, "--tip", "tip").err
