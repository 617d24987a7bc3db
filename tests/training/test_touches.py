"""Touches through the public face: a log of sockets becomes a model like any other."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from conftest import lengths, refused
from models import accuracy
from touching import World, touching

import calib
from calib.arm.rotations import similarity
from calib.samples.sockets import Touches

CHANGES = [("offset", 2, 0.0, ""), ("offset", 2, 6e-3, "elbow"), ("tool", 0, 2e-3, "tool")]


@cache
def learned():
    """A world, and a model of its touches."""
    world = World(0, each=15)
    return world, calib.train(world.log(), size=5)


def errors(model, q, true):
    """Distances (n,) of a model's tips from true ones, wherever the base stands."""
    tips = model.forward(q)
    turn, _, _ = similarity(true, tips)
    turned = true @ turn.T
    return lengths(tips - turned - (tips - turned).mean(axis=0))


def rows(world, q, **more):
    """A table of joints (n, dof) and further columns."""
    return pl.DataFrame(dict(zip(world.arm.joint_names, q.T, strict=True)) | more)


def test_a_model_is_learned_evaluated_and_asked(tmp_path, run):
    world, path, model = World(2, each=15), tmp_path / "touches.csv", tmp_path / "arm.calib"
    q = world.q.copy()
    q[[3, 30]] += 0.02  # the ball was beside the socket
    setups = [("front", "left")[number // 2] for number in world.number]
    points = ["AB"[number % 2] for number in world.number]
    rows(world, q, setup=setups, point=points).write_csv(path)
    distance = lengths(world.points[::2] - world.points[1::2]).mean()
    known = ["--distance", f"A,B={1e3 * distance}mm+-200mm"]
    done = run.done("train", "six_axis", "--data", path, "-o", model, "--size=5", "--json", *known)
    assert "2 rows were in no socket" in done.err
    assert done.document["errors"]["local"]["forward"]["distance"]["mean"] < 0.6e-3
    document = run("evaluate", model, "--data", path, "--json", *known).document
    told = document["touch"]
    assert document["evaluated"]["left_out"] == 2
    assert sum(each["rows"] for each in told["points"]) == 58
    assert told["scatter"]["mean"] < told["scatter"]["p95"] < 0.5e-3
    assert told["scatter"]["covered"] > 0.9
    assert len(told["distances"]) == 2
    assert "scatter" in run("evaluate", model, "--data", path).out
    assert run("report", model, "--data", path, "-o", tmp_path / "report.html").code == 0
    assert run("query", "forward", model, *world.q[0]).code == 0
    note = run("urdf", model, "-o", tmp_path / "mended.urdf").err
    assert "no touch tells the first joint's offset" in note
    assert "train with" not in note
    assert run("check", model, "--data", path).code == 0
    assert run("adapt", model, "--data", path, "-o", tmp_path / "new.calib").code == 3


@pytest.mark.parametrize(("group", "place", "change", "name"), CHANGES)
def test_a_change_is_found_and_mended_by_touches_of_other_sockets(group, place, change, name):
    """Nobody says where those are, which is as open as before: the bound says so."""
    world, model = learned()
    rng = np.random.default_rng(1)
    points = world.points.mean(axis=0) + 0.15 * rng.uniform(-1, 1, (2, 3))
    beta = world.beta.copy()
    beta[world.truth.groups[group][place]] += change
    log = world.log(*touching(world, beta, points, 15, 0.1e-3, rng))
    found, made = calib.check(model, log), calib.adapt(model, log)
    assert found.drifted is bool(name)
    assert bool(made.improved) is bool(name)
    if not name:
        return
    assert name in found.explanations[0]
    before, after = (calib.evaluate(m, log).touch["scatter"] for m in (model, made.model))
    assert after["mean"] < 0.2e-3 < 0.8e-3 < before["mean"]
    # the bound holds where no socket is
    q = rng.uniform(*world.limits, (300, 6))
    true = world.truth.predict(q, beta)
    left = errors(made.model, q, true)
    assert left.mean() < 0.3 * errors(model, q, true).mean()
    assert np.mean(left < made.model.model_error(q)) > 0.95
    # no touch tells a frame, which there is no sensor to have
    assert np.median(calib.adapt(model, log, free="offsets").model.model_error(q)) < 0.03


def test_a_touch_that_is_logged_again_counts_once(tmp_path):
    """An arm that rests in a socket while a logger writes shows nothing new."""
    world = World(2, each=15)
    log = world.log()
    thrice = log.take(np.repeat(np.arange(len(log)), 3))
    once, repeated = calib.train(log, size=3), calib.train(thrice, size=3)
    np.testing.assert_allclose(repeated.forward(world.q), once.forward(world.q), atol=1e-12)
    np.testing.assert_allclose(repeated.model_error(world.q), once.model_error(world.q), rtol=1e-6)
    assert "120 touches" in " ".join(repeated.about.notes)
    once.save(tmp_path / "once.calib")
    again = calib.load(tmp_path / "once.calib").expected_error(world.q)
    assert (again == once.expected_error(world.q)).all()


def test_most_touches_are_not_left_out():
    """Touches of an arm with play, and a third under wrong names, are no strays of a few good."""
    world = World(2, each=15)
    model = calib.train(world.log(), size=3)
    wrong = world.number.copy()
    wrong[::3] = (wrong[::3] + 1) % 4
    found = calib.evaluate(model, world.log(number=wrong))
    assert found.left_out == 0
    assert found.touch["scatter"]["mean"] > 0.05
    side = np.sign(np.diff(world.q[:, 1], prepend=0.0))
    with_play = world.q.copy()
    with_play[:, 1] += 3e-3 * side
    assert calib.train(world.log(with_play), size=3).about.left_out == 0


def test_positions_of_a_sensor_stand_beside_touches(tmp_path, run):
    """Rows without a point are a sensor's: the model speaks in its frame, and knows its size."""
    world = World(3, each=15)
    turn, shift = np.diag([-1.0, -1.0, 1.0]), np.array([1.0, 2.0, 0.5])
    rng = np.random.default_rng(0)
    q = rng.uniform(*world.limits, (20, 6))
    seen = world.truth.predict(q, world.beta) @ turn.T + shift
    seen += 0.2e-3 * rng.standard_normal(seen.shape)
    touched = rows(world, world.q, point=["ABCD"[k] for k in world.number])
    measured = rows(world, q, **dict(zip("xyz", 1e3 * seen.T, strict=True)))
    pl.concat([touched, measured], how="diagonal").write_csv(tmp_path / "mixed.csv")
    log = calib.read_log(tmp_path / "mixed.csv", world.arm, unit="mm")
    assert (log.touch.number < 0).sum() == 20
    model = calib.train(log, size=5)
    fresh = rng.uniform(*world.limits, (200, 6))
    true = world.truth.predict(fresh, world.beta) @ turn.T + shift
    readings = true + 0.2e-3 * rng.standard_normal(true.shape)
    for told in (true, readings):
        error, covered = accuracy(model, fresh, told, "expected_error")
        assert error < 1e-3
        assert covered > 0.9
    assert calib.evaluate(model, log).touch["scatter"]["mean"] < 0.5e-3
    apart = 1.01e3 * np.linalg.norm(world.points[0] - world.points[1])
    stated = replace(log, touch=log.touch.with_stated_facts([f"A,B={apart}mm"]))
    beside = calib.train(stated, size=3)
    assert "by the sensor's size they are" in " ".join(beside.about.notes)
    assert accuracy(beside, fresh, true)[1] > 0.9


def test_points_of_a_plane_are_stated_on_the_command_line(tmp_path, run):
    world, path = World(3, each=12, flat=True), tmp_path / "flat.csv"
    rows(world, world.q, point=["ABCD"[k] for k in world.number]).write_csv(path)
    told = ("train", "six_axis", "--data", path, "-o", tmp_path / "m.calib", "--size", "3")
    run.done(*told, "--plane", "A,B,C,D", "--distance", "A,B=1m+-1m")
    tips = calib.load(tmp_path / "m.calib").forward(world.q)
    means = np.array([tips[world.number == k].mean(axis=0) for k in range(4)])
    assert np.linalg.svd(means - means.mean(axis=0))[1][2] < 1e-4
    assert "four points" in run(*told, "--plane", "A,B,C").err
    words = "expected two points of one setup, each once, of A, B, C, D"
    assert words in run(*told, "--distance", "A,Z=50mm").err


def test_touches_that_tell_nothing_or_are_wrong_are_told():
    """Wrong names, a row beside its socket, one point, postures all alike, joints in degrees."""
    good = World(4, each=12).log()
    named = good.touch.number.copy()
    named[5] = 2  # the wrong socket's name
    model = calib.train(replace(good, touch=replace(good.touch, number=named)), size=5)
    assert model.about.left_out == 1
    assert "row 6" in " ".join(model.about.notes)
    one = good.take(np.arange(11))
    refused(calib.LogError, "11 touches of 1 sockets tell nothing", calib.train, one)
    alike = replace(good, q=good.q[12 * (good.touch.number)] + 1e-3 * np.sin(good.q))
    refused(calib.LogError, "all alike", calib.train, alike)
    mixed = np.random.default_rng(0).permutation(good.touch.number)
    shuffled = replace(good, touch=replace(good.touch, number=mixed))
    refused(calib.LogError, "no arm explains the touches", calib.train, shuffled, size=5)


def test_a_distance_that_is_left_out_makes_no_bound_narrower():
    """One ten times too long made it half as wide, and it covered 3 % of an arm .3 % too large."""
    world, model = learned()
    apart = lengths(world.points[:1] - world.points[1:2])[0]
    log = world.log()
    touch = log.touch.with_stated_facts([f"A,B={10 * apart}m"])
    wrong = calib.train(replace(log, touch=touch), size=5)
    assert np.median(wrong.model_error(world.q) / model.model_error(world.q)) > 0.95
    assert re.search("the distance is left out.*touches alone do not tell", str(wrong.notes))


@pytest.mark.parametrize("text", ["A,B", "A,B=50", "A=50mm", "A,B=-5mm", "A,B=5mm+-x", "A,A=50mm"])
def test_distances_are_read_as_typed_or_refused(text):
    read = Touches(np.zeros(1, int), (("", "A"), ("", "B"))).with_stated_facts
    assert read(["A,B=50mm+-0.196mm"]).facts[0].tolerance == pytest.approx(1e-4)
    assert read(["A,B=5 cm"]).facts[0].value == pytest.approx(0.05)
    refused(calib.OptionError, "50mm", read, [text])
