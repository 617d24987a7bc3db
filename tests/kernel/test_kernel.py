"""Single queries by a model's own compiled C are those of the batch, and safe to ask for."""

import gc
import os
import pickle
import shutil
import stat
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from models import draw, in_pixels, in_plane, in_space, measured, six, trained, turning

import calib
from calib.arm.rotations import exponential, matrix_of, quaternion_of
from calib.errors import OptionError, QueryError
from calib.inverse.pose import Joints, searched_ways
from calib.inverse.task import Poses
from calib.model import batches
from calib.model.header import Header
from calib.model.poses import solve_poses
from calib.model.space import Space

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")

ROBOTS = sorted(path.stem for path in (Path(__file__).parents[2] / "robots").glob("*.urdf"))
MODELS = {
    **{name: lambda name=name: trained(name, 600, 6) for name in ROBOTS},
    "measured": measured,
    "turning": turning,
    "space": in_space,
    "pixels": in_pixels,
    "planar pixels": lambda: homography(),
    "four": in_plane,
    "six": six,
}


def homography():
    """A planar arm before a tilted camera with a lens."""
    arm = calib.load_arm("two_link")
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (300, 2))
    x = arm.forward(q)
    seen = 640 + 900 * x / (1.2 + 0.2 * x[:, :1])
    seen += 1e-7 * (seen - 640) * ((seen - 640) ** 2).sum(axis=1, keepdims=True)
    ranges = arm.joint_names, arm.lower, arm.upper, arm.revolute
    return calib.train(calib.Samples(q, seen, *ranges, arm=arm, unit="px"), size=8)


@cache
def both(kind):
    """The model as the batch answers, and one whose single queries are compiled."""
    model = MODELS[kind]()
    fast = pickle.loads(pickle.dumps(model))
    assert "compiled" in fast.warm_up()
    return model, fast


def poses(model, n):
    """Random, limit, outside and stretched postures."""
    lower, upper = model.about.lower, model.about.upper
    rng = np.random.default_rng(1)
    u = rng.uniform(0, 1, (n, len(lower)))
    limit = np.where(rng.random((n, len(lower))) < 0.5, u.round(), u)
    outside = rng.uniform(-0.05, 1.05, (n, len(lower)))
    stretched = lower + u * (upper - lower)
    stretched[:, 1:] = np.clip(0.0, lower[1:], upper[1:])
    inside = lower + np.vstack([u, limit, outside]) * (upper - lower)
    return np.vstack([inside, stretched])


@needs_compiler
@pytest.mark.parametrize("kind", MODELS)
def test_one_query_is_that_of_the_batch(kind):
    model, fast = both(kind)
    q = poses(model, 60)
    atol = 1e-9 * model.reach
    for name in ("forward", "expected_error", "model_error", "jacobian"):
        one = np.array([getattr(fast, name)(row) for row in q])
        np.testing.assert_allclose(one, getattr(model, name)(q), rtol=0, atol=atol)


@needs_compiler
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("away", [0.3, 9.0])
def test_one_inverse_reaches_its_target_on_the_nearest_branch(kind, away):
    model, fast = both(kind)
    lower, upper, scale = model.about.lower, model.about.upper, model.motor.scale
    spare = len(lower) > len(model.axes)  # far from `near` each of these is a whole search
    q = poses(model, 8 if spare and away > 1.0 else 20)
    x = model.forward(q)
    q, x = q[np.isfinite(x[:, 0])], x[np.isfinite(x[:, 0])]
    near = q + np.random.default_rng(2).uniform(-away, away, q.shape)
    near = np.clip(near, lower, upper)
    together = model.inverse(x, near=near)
    alone = np.array([fast.inverse(a, near=b) for a, b in zip(x, near, strict=True)])
    assert (np.isnan(alone) == np.isnan(together)).all()
    known = np.isfinite(alone[:, 0])
    assert known.mean() > 0.9
    gap = np.linalg.norm(model.forward(alone[known]) - x[known], axis=1)
    met = np.linalg.norm(model.forward(together[known]) - x[known], axis=1)
    assert (gap <= np.maximum(met, 1e-9 * model.reach)).all()

    def far(found):
        there, here = scale.to_unit(found[known]), scale.to_unit(near[known])
        return np.linalg.norm(scale.difference(there, here), axis=1)

    further = far(alone) - far(together)
    if spare and away > 1.0:  # of infinitely many ways either may find the nearer one
        assert further.mean() < 0.02
    elif spare:
        assert (further <= 2e-2).mean() > 0.98
    else:
        assert (further <= 1e-6).all()


@needs_compiler
@pytest.mark.parametrize("kind", ["two_link", "three_link", "six"])
def test_a_position_that_nothing_reaches_is_answered_without_the_batch(kind):
    """Once a single call fell to the batch, for a third of a second, where C found nothing."""
    model, fast = both(kind)
    near = (model.about.lower + model.about.upper) / 2
    middle = model.sensory.weights.mean(axis=0)
    far = middle + 2.0 * model.solver.extent * np.eye(len(middle))
    assert np.isnan(model.inverse(far, near=near)).all()
    for x in far:
        joints, said = fast.kernel.ask("inverse", near, x)
        assert said == 3
        assert np.isnan(joints).all()
        assert np.isnan(fast.inverse(x, near=near)).all()
        close = fast.inverse(x, near=near, nearest=True)
        np.testing.assert_allclose(close, model.inverse(x, near=near, nearest=True), atol=1e-6)


@needs_compiler
def test_a_compiler_that_knows_few_options_serves_too(monkeypatch, tmp_path):
    plain = tmp_path / "plain-cc"
    plain.write_text('#!/bin/sh\ncase "$*" in *tree-pre*) exit 1;; esac\nexec cc "$@"\n')
    plain.chmod(0o700)
    monkeypatch.setenv("CC", str(plain))
    fast = pickle.loads(pickle.dumps(trained("two_link", 600, 6)))
    assert "compiled C" in fast.warm_up()


@needs_compiler
def test_one_pose_is_that_of_the_batch():
    model, fast = both("six")
    rng = np.random.default_rng(0)
    lower, upper = model.about.lower, model.about.upper
    q = lower + (upper - lower) * rng.uniform(0.1, 0.9, (12, 6))
    x, turns = model.pose(q)
    near = np.clip(q + rng.uniform(-0.2, 0.2, q.shape), lower, upper)
    together = model.inverse_pose(x, turns, near)
    for k in range(len(q)):
        alone = fast.inverse_pose(x[k], turns[k], near[k])
        np.testing.assert_allclose(alone, together[k], rtol=0, atol=1e-6)
        place, turned = model.pose(alone)
        np.testing.assert_allclose(place, x[k], rtol=0, atol=1e-9)
        assert abs(abs(turned @ turns[k]) - 1.0) < 1e-12


@needs_compiler
@pytest.mark.parametrize("kind", ["two_link", "six", "measured"])
def test_a_batch_is_that_of_numpy(kind):
    model, fast = both(kind)
    q = np.vstack([poses(model, 20), np.full(len(model.about.lower), 1e9)])
    atol = 1e-9 * model.reach
    for name in ("forward", "expected_error", "model_error"):
        together = getattr(fast, name)(q)
        np.testing.assert_allclose(together, getattr(model, name)(q), rtol=0, atol=atol)
        assert np.isnan(together[-1]).all()
    x = model.forward(q[:20])
    for nearest in (False, True):
        joints = fast.inverse(np.vstack([x, 1e3 + x[:1]]), nearest=nearest)
        np.testing.assert_allclose(model.forward(joints[:20]), x, rtol=0, atol=atol)
        assert np.isnan(joints[-1]).all() != nearest


@needs_compiler
def test_the_batch_names_every_branch_of_a_position_once():
    model = trained("two_link_full")
    fast = pickle.loads(pickle.dumps(model))
    fast.warm_up()
    x = model.forward(draw(model, 300, seed=2))
    for compiled, expected in zip(fast.inverse_all(x), model.inverse_all(x), strict=True):
        np.testing.assert_allclose(compiled, expected, atol=1e-6)


@needs_compiler
@pytest.mark.parametrize("compiled", [True, False])
def test_every_branch_of_a_pose_and_the_nearest_of_them(compiled):
    model = both("six")[compiled]
    q = draw(model, 8, seed=5, margin=0.05)
    position, turn = model.pose(q)
    near = draw(model, 8, seed=6)
    ways = solve_poses(model, position, turn, near, every=True, bounded=False)
    target = Poses.target(*Space.of(model).evaluate(q)[:2])
    joints = Joints(model.about.lower, model.about.upper, model.about.revolute)
    space = Space.of(model)
    searched = searched_ways(space.evaluate, target, joints, space.length, starts=q)
    scale = model.motor.scale
    for k, expected in enumerate(searched):
        found = ways.q[ways.target == k]
        gap = scale.difference(scale.to_unit(found)[:, None], scale.to_unit(expected))
        apart = np.abs(gap).max(axis=2)
        assert found.shape == expected.shape
        assert apart.min(axis=0).max() < 1e-5
    nearest = model.inverse_pose(position, turn, near)
    away = np.linalg.norm(scale.difference(scale.to_unit(nearest), scale.to_unit(near)), axis=1)
    for k in range(len(q)):
        found = scale.to_unit(ways.q[ways.target == k])
        gap = scale.difference(found, scale.to_unit(near[k : k + 1]))
        assert away[k] <= np.linalg.norm(gap, axis=1).min() + 1e-6


@needs_compiler
@pytest.mark.parametrize("compiled", [True, False])
def test_a_free_axis_leaves_the_turn_about_it_open(compiled):
    model = both("six")[compiled]
    q = draw(model, 6, seed=7, margin=0.1)
    position, turn = model.pose(q)
    spun = quaternion_of(matrix_of(turn) @ exponential([0.0, 0.0, 1.0])[None])
    joints = model.inverse_pose(position, spun, q, free="z")
    place, reached = model.pose(joints)
    np.testing.assert_allclose(place, position, atol=1e-7)
    axes = matrix_of(reached)[:, :, 2]
    np.testing.assert_allclose(axes, matrix_of(turn)[:, :, 2], atol=1e-7)
    assert np.abs(joints - q).max() < 0.3  # as the turn is free, they hardly have to move
    with pytest.raises(QueryError, match="axis of the tip"):
        model.inverse_pose(position, spun, q, free="w")


@needs_compiler
def test_a_strict_model_says_why_it_has_no_answer_and_stays_so():
    model = pickle.loads(pickle.dumps(six()))
    model.warm_up(strict=True)
    q = (model.about.lower + model.about.upper) / 2 + 0.2
    position, turn = model.pose(q)
    assert np.isfinite(model.inverse_pose(position, turn, q)).all()
    assert model.unanswered is None
    assert np.isnan(model.inverse_pose(position + 9.0, turn, q)).all()
    assert "bounded search" in model.unanswered
    again = pickle.loads(pickle.dumps(model))
    assert again.warm
    assert again.strict


def test_strict_needs_a_compiler(monkeypatch):
    monkeypatch.setenv("CALIB_NO_CC", "1")
    model = pickle.loads(pickle.dumps(trained("two_link", 600, 6)))
    with pytest.raises(OptionError, match="CALIB_NO_CC"):
        model.warm_up(strict=True)
    assert not model.warm


def test_a_large_batch_without_a_compiler_says_so_once(monkeypatch):
    monkeypatch.setenv("CALIB_NO_CC", "1")
    monkeypatch.setattr(batches, "COST", batches.NumpyCost(compiler=1.0))
    model = pickle.loads(pickle.dumps(trained("two_link", 600, 6)))
    q = draw(model, 100)
    with pytest.warns(RuntimeWarning, match="CALIB_NO_CC is set; large batches take longer"):
        x = model.forward(q)
    assert np.isfinite(model.inverse(x)).all()


@needs_compiler
def test_a_large_batch_is_compiled_by_itself(monkeypatch):
    monkeypatch.setattr(batches, "COST", batches.NumpyCost(compiler=1.0))
    model = pickle.loads(pickle.dumps(trained("two_link", 600, 6)))
    model.forward(draw(model, 100))
    assert model.warm


@needs_compiler
@pytest.mark.parametrize("bad", [[0.5], ["a", "b"], [0.5, 1.0, 2.0], None, 1.0])
def test_what_is_no_query_is_still_refused(bad):
    _, fast = both("two_link")
    with pytest.raises(QueryError):
        fast.forward(bad)
    with pytest.raises(QueryError):
        fast.inverse([0.3, 0.3], near=bad if bad is not None else [np.inf, 0.0])


@needs_compiler
def test_threads_do_not_disturb_each_other():
    model, fast = both("six")
    q = poses(model, 1)[:2]
    expected = [fast.forward(row) for row in q]

    def ask(k):
        return all((fast.forward(q[k]) == expected[k]).all() for _ in range(3000))

    with ThreadPoolExecutor(2) as pool:
        assert all(pool.map(ask, (0, 1)))


@needs_compiler
def test_no_text_of_a_model_gets_into_the_source():
    model = trained("two_link", 600, 6)
    evil = '*/ int hacked(void); /* " \\ ??/ \n #include <stdlib.h>'
    about = replace(
        model.about,
        robot=evil,
        tip=evil,
        unit="m",
        joint_names=(evil, "b"),
        source=model.about.source,
    )
    text = Header.of(replace(model, about=about)).text()[0]
    assert "hacked" not in text
    assert "stdlib" not in text


@needs_compiler
def test_the_folder_is_private_and_goes_with_the_model():
    fast = pickle.loads(pickle.dumps(trained("two_link", 600, 6)))
    fast.warm_up()
    folder = Path(fast.kernel._folder.name)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert folder.stat().st_uid == os.getuid()
    assert "kernel" not in pickle.loads(pickle.dumps(fast)).__dict__
    del fast
    gc.collect()
    assert not folder.exists()


@pytest.mark.parametrize(
    ("name", "value"), [("CALIB_NO_CC", "1"), ("CC", "no-such-compiler"), ("CC", "false")]
)
def test_without_a_compiler_the_batch_answers(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    model = trained("two_link", 600, 6)
    cold = pickle.loads(pickle.dumps(model))
    assert "batch" in cold.warm_up()
    assert cold.kernel is None
    q = poses(model, 3)
    np.testing.assert_array_equal(cold.forward(q[0]), model.forward(q[:1])[0])
