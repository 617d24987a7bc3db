"""The commands check and adapt, and what they refuse."""

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
    assert " sensor before" in table  # and not mm, which it was not told
    assert "--unit mm" in table
    looked = run("check", folder / "m.calib", "--data", path, "-v")
    assert looked.code == 3
    assert "check the log's unit before calib adapt" in looked.out
    assert "smallest [sensor]" in looked.out
    assert "`" not in looked.out
