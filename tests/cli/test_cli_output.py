"""Output: the verdict first, the result alone or all it rests on, units that are asked for."""

import csv
import io

import pytest

import calib


@pytest.fixture(scope="module")
def folder(tmp_path_factory, run):
    """A model of a log, a log of the same arm and one of the arm with its elbow moved."""
    folder = tmp_path_factory.mktemp("output")
    babble = ("babble", "two_link", "--noise", "1e-4", "-o")
    run(*babble, folder / "log.csv", "-n", "200")
    run(*babble, folder / "same.csv", "-n", "60", "--seed", "5")
    moved = ("--change", "elbow.offset=0.02")
    run(*babble, folder / "moved.csv", "-n", "60", "--seed", "5", *moved)
    done = run("train", "two_link", "--data", folder / "log.csv", "-o", folder / "m.calib")
    assert done.code == 0, done.err
    return folder


def test_check_begins_with_the_verdict_and_says_what_to_do(run, folder):
    done = run("check", folder / "m.calib", "--data", folder / "same.csv")
    assert (done.code, done.out.splitlines()[0]) == (0, "still calibrated")
    done = run("check", folder / "m.calib", "--data", folder / "moved.csv")
    assert done.code == 3
    lines = done.out.splitlines()
    assert lines[0].startswith("DRIFTED: elbow is off by ")
    assert " 1.1" in lines[0].replace("+", " ")  # 0.02 rad
    assert "deg" in lines[0]
    assert any("calib adapt" in line for line in lines[1:])
    assert lines[-1].startswith("limited by ")
    assert "zeta" not in done.out
    told = run("check", folder / "m.calib", "--data", folder / "moved.csv", "-v").out
    assert "zeta" in told
    assert "what may have changed" in told


@pytest.mark.parametrize(
    "words",
    [
        ("check", "m.calib", "--data", "moved.csv"),
        ("evaluate", "m.calib", "--data", "same.csv"),
        ("adapt", "m.calib", "--data", "moved.csv", "-o", "b.calib"),
        ("train", "two_link", "--data", "log.csv", "-o", "n.calib"),
        ("query", "forward", "m.calib", "0.5", "1.0"),
        ("query", "inverse", "m.calib", "0.1", "0.4"),
    ],
)
def test_quiet_is_one_line_and_no_note(run, folder, monkeypatch, words):
    monkeypatch.chdir(folder)
    done = run(*words, "--quiet")
    assert done.err == ""
    assert len(done.out.splitlines()) == 1


def test_positions_are_typed_and_printed_in_the_unit_asked_for(run, folder):
    path = folder / "m.calib"
    plain = run("query", "inverse", path, "0.1", "0.4", "--json").document
    asked = run("query", "inverse", path, "100", "400", "--unit", "mm", "--json").document
    assert asked == plain  # documents are in the model's unit
    done = run("query", "forward", path, "0.5", "1.0", "--unit", "cm")
    model = calib.load(path)
    x, y = model.forward([0.5, 1.0])
    row = done.out.splitlines()[1].split()
    assert [float(row[2]), float(row[3])] == pytest.approx([100 * x, 100 * y], abs=1e-3)
    assert "x [cm]" in done.out
    typed = "x,y\n100,400\n"
    done = run("query", "inverse", path, "--input", "-", "--unit", "mm", stdin=typed)
    (answer,) = csv.DictReader(io.StringIO(done.out))
    joints = plain["solutions"][0]["joints"]
    assert float(answer["elbow"]) == pytest.approx(joints["elbow"], abs=1e-6)
    assert (float(answer["x"]), float(answer["y"])) == pytest.approx((100.0, 400.0))
    assert float(answer["expected_error"]) == pytest.approx(
        1e3 * plain["solutions"][0]["expected_error"], rel=1e-6
    )
    refused = run("query", "inverse", path, "1", "1", "--unit", "px")
    assert refused.code == 2
    assert "mm" in refused.err


def test_a_planar_log_without_a_tip_is_told_whose_positions_it_has(run, tmp_path):
    """A wrist that was measured and a tool that was taken are an offset of the elbow."""
    log = calib.babble(calib.load_arm("three_link", ["shoulder", "elbow"], "tip"), 60, noise=1e-4)
    calib.write_log(log, tmp_path / "log.csv")
    joints = ("--joints", "shoulder,elbow", "--data", tmp_path / "log.csv", "--size", "5")
    train = ("train", "three_link", *joints, "-o", tmp_path / "m.calib")
    assert "--tip" in run(*train).err
    assert "those of tip" not in run(*train, "--tip", "tip").err
