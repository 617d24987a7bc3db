"""Touches through the public face: a log of sockets becomes a model like any other."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib.errors import LogError, OptionError
from calib.samples.sockets import Touches


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of the bundled arm in four sockets, three rows of it wrong, and the tips' distance."""
    from touching import World

    world = World(2, each=20)
    path = tmp_path_factory.mktemp("touch") / "touches.csv"
    names = world.arm.joint_names
    lines = [",".join([*names, "setup", "point"])]
    for k, (row, number) in enumerate(zip(world.q, world.number, strict=True)):
        setup, point = ("front", "left")[number // 2], "AB"[number % 2]
        if k in (3, 30):  # the ball was beside the socket
            row = row + 0.02
        lines.append(",".join([*(repr(float(v)) for v in row), setup, point]))
    path.write_text("\n".join(lines))
    apart = [np.linalg.norm(world.points[i] - world.points[i + 1]) for i in (0, 2)]
    return world, path, apart


def test_a_model_is_learned_evaluated_and_asked(log, tmp_path, run):
    world, path, apart = log
    model = tmp_path / "arm.calib"
    known = ["--distance", f"A,B={1e3 * np.mean(apart)}mm+-200mm"]
    done = run("train", "six_axis", "--data", path, "-o", model, "--json", *known)
    assert done.code == 0, done.err
    assert "2 rows were in no socket" in done.err
    assert done.document["errors"]["local"]["forward"]["distance"]["mean"] < 0.6e-3
    document = run("evaluate", model, "--data", path, "--json", *known).document
    told = document["touch"]
    assert document["evaluated"]["left_out"] == 2
    assert sum(each["rows"] for each in told["points"]) == 78
    assert told["scatter"]["mean"] < told["scatter"]["p95"] < 0.5e-3
    assert told["scatter"]["covered"] > 0.9
    assert len(told["distances"]) == 2
    text = run("evaluate", model, "--data", path).out
    assert "scatter" in text
    assert run("query", "forward", model, *world.q[0]).code == 0
    for command in ("check", "adapt"):
        done = run(command, model, "--data", path)
        assert done.code == 1
        assert "evaluate" in done.err


def test_what_touches_cannot_be_used_for_is_said(log, tmp_path, run):
    _, path, _ = log
    assert run("train", "two_link", "--data", path, "-o", tmp_path / "m.calib").code == 1
    wrong = run("train", "six_axis", "--data", path, "--distance", "A,Z=5mm", "-o", tmp_path / "m")
    assert wrong.code == 1
    assert "Z" in wrong.err
    few = calib.read_log(path, calib.load_arm("six_axis")).take(np.arange(10))
    with pytest.raises(LogError, match="20 postures"):
        calib.train(few)


@pytest.mark.parametrize("text", ["A,B", "A,B=50", "A=50mm", "A,B=-5mm", "A,B=5mm+-x"])
def test_distances_are_read_as_typed_or_refused(text):
    touches = Touches(np.zeros(1, int), (("", "A"), ("", "B")))
    assert touches.stated(["A,B=50mm+-0.196mm"]).known[0].tolerance == pytest.approx(1e-4)
    assert touches.stated(["A,B=5 cm"]).known[0].value == pytest.approx(0.05)
    with pytest.raises(OptionError, match="50mm"):
        touches.stated([text])
