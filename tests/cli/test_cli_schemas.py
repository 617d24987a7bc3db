"""Schemas on the command line: adapt keeps them, check and info name them."""

from __future__ import annotations

import pytest

import calib


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = calib.load_arm("two_link")
    calib.train(calib.babble(arm, 1500, noise=1e-3), size=12).save("m.calib")
    for name, changes in (("on", ["tip.offset=0.05,0"]), ("off", []), ("other", ["elbow.lock=1"])):
        log = calib.babble(arm, 60, seed=3, noise=1e-3, changes=changes)
        calib.write_log(log, f"{name}.csv")
    return tmp_path


def test_adapt_keeps_the_old_state_and_check_names_the_one_that_fits(run, folder):
    done = run("adapt", "m.calib", "--data", "on.csv", "--schema", "tool on", "-o", "both.calib")
    assert done.code == 0, done.err
    for log, name in (("on.csv", "tool on"), ("off.csv", "schema 1")):
        done = run("check", "both.calib", "--data", log)
        assert f"schema {name!r} fits" in done.out
    found = run("check", "both.calib", "--data", "off.csv", "--json").document
    assert found["drifted"] is True
    assert found["schema"] == "schema 1"
    assert run("check", "both.calib", "--data", "other.csv", "--json").document["schema"] is None
    assert "schema" not in run("check", "m.calib", "--data", "off.csv", "--json").document
    about = run("info", "both.calib", "--json").document
    assert (about["schema"], about["schemas"]) == ("tool on", ["schema 1"])
    assert "'tool on'; kept beside it: 'schema 1'" in run("info", "both.calib").out


def test_a_name_is_refused_before_anything_is_done(run, folder):
    done = run("adapt", "m.calib", "--data", "on.csv", "--schema", " ")
    assert done.code in (1, 2)
    assert "printable" in done.err
    done = run("adapt", "m.calib", "--data", "on.csv", "--schema", "schema 1")
    assert done.code == 1
    assert "another name" in done.err
    assert not (folder / "m.adapted.calib").exists()
