"""The commands check and adapt, and what they refuse."""

import os
import threading
from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drift")
    model().save(folder / "m.calib")
    calib.write_log(log(n=100), folder / "same.csv")
    calib.write_log(log("elbow.length=+5%", n=100), folder / "new.csv")
    return folder


def test_check_adapt_check(folder, run, tmp_path):
    model, log, out = folder / "m.calib", folder / "new.csv", tmp_path / "mine.calib"
    drifted = run("check", model, "--data", log, "--json").document
    assert "the link of elbow" in drifted["explanations"][0]
    done = run("adapt", model, "--data", log, "-o", out, "--json")
    assert (done.code, done.document["model"], done.document["improved"]) == (0, str(out), True)
    assert done.document["after"]["mean"] < 0.2 * done.document["before"]["mean"]
    causes = [cause for cause in drifted["causes"] if cause["cause"] != "noise"]
    assert done.document["changed"] == causes
    assert "the sensor's scale" in done.document["kept"]
    assert 0.5 < done.document["coverage"] <= 1
    assert calib.load(out).history[0]["samples"] == done.document["samples"]
    assert run("check", out, "--data", log).code == 0
    assert run("adapt", model, "--data", folder / "same.csv", "-o", tmp_path / "no.calib").code == 3
    assert not (tmp_path / "no.calib").exists()


@pytest.mark.skipif(os.name == "nt", reason="pipes with a name are POSIX")
def test_a_pipe_is_checked_like_the_file_with_its_episodes(folder, run, tmp_path):
    table = (folder / "new.csv").read_text().splitlines()
    lines = [f"{table[0]},episode", *(f"{row},{k // 50}" for k, row in enumerate(table[1:]))]
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    thread = threading.Thread(target=lambda: pipe.write_text("\n".join(lines)))
    thread.start()
    done = run("check", folder / "m.calib", "--data", pipe, "--json")
    thread.join(5.0)
    assert done.code == 3, done.err
    assert [part["samples"] for part in done.document["episodes"]] == [50, 50]


def test_a_bound_that_the_rows_contradict_is_written_wider(run, tmp_path):
    """A ripple of 2 mm that no chain follows: Python returned a wider bound, the command none."""
    rng = np.random.default_rng(4)
    for name, n, size in (("own", 300, 0.0), ("new", 100, 2e-3)):
        q = rng.uniform(arm().lower, arm().upper, (n, 2))
        ripple = size * np.sin(9 * q[:, :1] + 7 * q[:, 1:]) * [1.0, 0.6]
        x = arm().forward(q) + ripple + rng.normal(0.0, 2e-4, q.shape)
        calib.write_log(replace(log(n=n), q=q, x=x, simulation=None), tmp_path / f"{name}.csv")
    old, new = tmp_path / "own.calib", tmp_path / "own.adapted.calib"
    run("train", "two_link", "--data", tmp_path / "own.csv", "--size", 8, "-o", old)
    assert run("check", old, "--data", tmp_path / "new.csv").code == 3
    done = run("adapt", old, "--data", tmp_path / "new.csv")
    assert done.code == 3
    assert f"{new} predicts as {old} does, with a wider bound" in done.out
    document = run("adapt", old, "--data", tmp_path / "new.csv", "--json").document
    assert (document["improved"], document["model"]) == (False, str(new))
    before, after = calib.load(old), calib.load(new)
    assert np.array_equal(before.forward(q), after.forward(q))
    assert after.model_error(q).mean() > 2 * before.model_error(q).mean()


def test_rows_too_coarse_for_what_is_tolerated_end_with_exit_code_3(folder, run):
    line = ("check", folder / "m.calib", "--data", folder / "same.csv", "--tolerance", "1e-6")
    done = run(*line, "--json")
    assert (done.code, done.document["drifted"]) == (3, None)
    assert run(*line).out.startswith("TOO COARSE")


def test_noisier_readings_are_said_and_are_no_change(folder, run, tmp_path):
    calib.write_log(log(n=100, noise=5e-3), tmp_path / "noisy.csv")
    done = run("check", folder / "m.calib", "--data", tmp_path / "noisy.csv", "--json")
    assert (done.code, done.document["drifted"], done.document["bound_holds"]) == (0, False, False)
    assert [cause["cause"] for cause in done.document["causes"]] == ["noise"]
    shown = run("check", folder / "m.calib", "--data", tmp_path / "noisy.csv")
    assert shown.out.startswith("THE BOUND DOES NOT HOLD")


def test_millimetres(folder, run, tmp_path):
    samples = log("elbow.length=+5%", n=100)
    table = np.hstack([samples.q, 1e3 * samples.x])
    path = tmp_path / "mm.csv"
    np.savetxt(path, table, delimiter=",", header="shoulder,elbow,x,y", comments="")
    converted = run(
        "adapt", folder / "m.calib", "--data", path, "--unit", "mm", "-o", tmp_path / "a", "--json"
    )
    assert converted.code == 0
    assert converted.document["unit"] == "m"
    raw = run("adapt", folder / "m.calib", "--data", path, "-o", tmp_path / "b", "--json")
    assert raw.code == 0
    assert "--unit mm" in raw.err
    assert raw.document["unit"] == "sensor"
    table = run("adapt", folder / "m.calib", "--data", path, "-o", tmp_path / "c", "-v").out
    assert "held-out rows [sensor]" in table  # and not mm, which it was not told
    assert "--unit mm" in table
    looked = run("check", folder / "m.calib", "--data", path, "-v")
    assert looked.code == 3
    assert "check the log's unit before calib adapt" in looked.out
    assert "smallest [sensor]" in looked.out
    assert "`" not in looked.out


def test_what_was_said_of_a_cause_is_not_asked_again(folder, run, tmp_path):
    calib.write_log(log("shoulder.offset=0.03", n=60), tmp_path / "off.csv")
    line = ["check", folder / "m.calib", "--data", tmp_path / "off.csv"]
    assert "--cause joints or --cause sensor" in run(*line).err
    assert "--cause" not in run(*line, "--cause", "joints").err


def test_other_column_names_degrees_order_and_holes(folder, run, tmp_path):
    samples = log("elbow.length=+5%", n=150)
    order = np.random.default_rng(0).permutation(150)
    q = np.rad2deg(samples.q)[order]
    x = samples.x[order]
    lines = ["j1,j2,cam_u,cam_v"]
    lines += [f"{a},{b},{u},{v}" for (a, b), (u, v) in zip(q, x, strict=True)]
    lines[5] = lines[5].rpartition(",")[0] + ","
    lines += lines[1:30]
    path = tmp_path / "odd.csv"
    path.write_text("\n".join(lines) + "\n")
    columns = "shoulder=j1,elbow=j2,x=cam_u,y=cam_v"
    done = run(
        "adapt", folder / "m.calib", "--data", path, "--columns", columns, "--degrees", "--json",
        "-o", tmp_path / "a.calib",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert done.document["samples"] == 149
    assert "repeated" in done.err
    truth = samples.simulation.exact(arm().lower[None] + 0.3)
    said = calib.load(tmp_path / "a.calib").forward(arm().lower[None] + 0.3)
    assert np.abs(said - truth).max() < 2e-3


def test_wrong_rows_are_counted_alike_by_all_commands(tmp_path, run):
    """Rows of zeros, where a sensor saw nothing, were counted by some commands alone."""
    made, fresh, saved = tmp_path / "made.csv", tmp_path / "fresh.csv", tmp_path / "own.calib"
    for path, n, lost in ((made, 200, [7, 40, 63]), (fresh, 100, [11, 58])):
        measured = log(n=n, seed=n, noise=2e-4)
        x = measured.x.copy()
        x[lost] = 0.0
        calib.write_log(replace(measured, x=x, simulation=None), path)
    trained = run("train", "two_link", "--data", made, "--size", 6, "-o", saved, "--json")
    assert trained.document["left_out"] == 3
    for command in ("check", "evaluate", "adapt"):
        told = run(command, saved, "--data", fresh, "--json")
        assert told.document["left_out"] == 2, command


def test_a_bumped_camera_is_not_told_as_a_bent_one():
    """It was also "bent, as by a lens"."""

    def seen(n, seed, turn=0.0, shift=(0.0, 0.0), tilt=0.05):
        told = calib.babble(arm(), n, seed=seed)
        c, s = np.cos(turn), np.sin(turn)
        x = 900.0 * told.x @ np.array([[c, -s], [s, c]]) + (300.0, 200.0) + shift
        x = x / (1.0 + told.x @ (tilt, 0.02))[:, None]
        x = x + np.random.default_rng(seed).normal(0.0, 0.3, x.shape)
        return replace(told, x=x, unit="px", simulation=None)

    known = calib.train(seen(200, 0), size=6)
    for seed, tilt in ((1, 0.06), (3, 0.05)):
        drift = calib.check(known, seen(60, seed, 0.01, (12.0, -7.0), tilt))
        assert drift.causes[0].cause == "sensor"
        assert "bent" not in " ".join(drift.explanations)
