"""Recognising: which of some models the arm is in, through the functions and the command line."""

from functools import cache

import pytest

import calib

TOOL = "tip.offset=0.05,0"


def log(*changes, n=40, seed=1):
    arm = calib.load_arm("two_link")
    return calib.babble(arm, n, seed=seed, noise=1e-3, changes=changes)


@cache
def models():
    plain = calib.train(log(n=400, seed=0), size=8)
    return plain, calib.adapt(plain, log(TOOL, n=100)).model


@pytest.mark.parametrize(
    ("changes", "index"), [((), 0), ((TOOL,), 1), (("elbow.length=-20%",), None)]
)
def test_the_state_is_recognised_by_few_rows_or_none_is(changes, index):
    for seed in (5, 6, 7):
        assert calib.recognise(models(), log(*changes, n=25, seed=seed)).index == index


def test_command(tmp_path, run):
    names = [tmp_path / "plain.calib", tmp_path / "tool.calib"]
    for model, path in zip(models(), names, strict=True):
        model.save(path)
    for changes, code, name in (((TOOL,), 0, str(names[1])), (("elbow.length=-20%",), 3, None)):
        calib.write_log(log(*changes, seed=9), tmp_path / "log.csv")
        result = run("recognise", *names, "--data", tmp_path / "log.csv", "--json")
        assert result.code == code, result.err
        assert result.document["model"] == name
