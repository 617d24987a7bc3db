"""Queries by a model's own compiled C are those of the batch in NumPy, and safe to ask for."""

import pickle
import time
from dataclasses import replace
from functools import cache

import models
import numpy as np
import pytest
from chains import chain_urdf, turning
from conftest import lengths, refused
from models import draw, in_pixels, in_space, log_of, needs_compiler, of_a_third, six, trained, warm
from numpy.testing import assert_allclose, assert_array_equal

import calib
from calib.arm.loading import arm_from_urdf
from calib.kernel.compiled import Compiler
from calib.model.c_header import Header

ROBOTS = [entry.name for entry in calib.list_robots()]
MODELS = {
    **{name: lambda name=name: trained(name, 600, 6) for name in ROBOTS},
    "measured": models.measured,
    "turning": models.turning,
    "space": in_space,
    "pixels": in_pixels,
    "planar pixels": models.tilted_camera,
    "four": models.in_plane,
    "six": six,
    "six in pixels": lambda: in_pixels(40, "six_axis"),
}


def cold(model):
    """A copy of a model that nothing was compiled for."""
    return pickle.loads(pickle.dumps(model))


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


@cache
def optimised():
    """A strict model, compiled as users' compilers do it; others are in a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.kernel.compiled.COMPILER", Compiler())
        model = cold(six())
        model.warm_up(strict=True)
    assert np.isfinite(model.forward(np.zeros(6))).all()
    assert model.unanswered is None
    return model


@pytest.mark.parametrize("kind", [*MODELS, pytest.param("optimised", marks=needs_compiler)])
def test_joints_alone_and_together_are_answered_as_by_numpy(kind):
    model = six() if kind == "optimised" else MODELS[kind]()
    fast = optimised() if kind == "optimised" else warm(model)
    q = np.vstack([poses(model, 30), np.full(len(model.about.lower), 1e9)])
    atol = 1e-9 * model.reach
    for name in ("forward", "expected_error", "model_error", "jacobian"):
        expected = getattr(model, name)(q)
        one = np.array([getattr(fast, name)(row) for row in q])
        assert_allclose(one, expected, rtol=0, atol=atol)
        assert_allclose(getattr(fast, name)(q), expected, rtol=0, atol=atol)
        assert np.isnan(expected[-1]).all()


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("away", [0.3, 9.0])
def test_one_inverse_reaches_its_target_on_the_nearest_branch(kind, away):
    model = MODELS[kind]()
    fast, scale = warm(model), model.motor.scale
    spare = len(model.about.lower) > len(model.axes)
    q = poses(model, 8 if spare and away < 1.0 else 20)
    x = model.forward(q)
    q, x = q[np.isfinite(x[:, 0])], x[np.isfinite(x[:, 0])]
    near = q + np.random.default_rng(2).uniform(-away, away, q.shape)
    near = np.clip(near, model.about.lower, model.about.upper)
    together = model.inverse(x, near=near)
    alone = np.array([fast.inverse(a, near=b) for a, b in zip(x, near, strict=True)])
    assert (np.isnan(alone) == np.isnan(together)).all()
    known = np.isfinite(alone[:, 0])
    assert known.mean() > 0.9
    alone, together, x, near = alone[known], together[known], x[known], near[known]
    gap, met = (lengths(model.forward(joints) - x) for joints in (alone, together))
    assert (gap <= np.maximum(met, 1e-9 * model.reach)).all()
    moves = (scale.difference(scale.to_unit(a), scale.to_unit(near)) for a in (alone, together))
    further = np.subtract(*(lengths(move) for move in moves))
    if spare and away > 1.0:  # of infinitely many ways either may find the nearer one
        assert further.mean() < 0.01
    else:
        assert (further <= (2e-2 if spare else 1e-6)).all()


@pytest.mark.parametrize("kind", ["two_link", "three_link", "six"])
def test_a_position_that_nothing_reaches_is_answered_without_the_batch(kind):
    """Once a single call fell to the batch, for a third of a second, where C found nothing."""
    model = MODELS[kind]()
    fast = warm(model)
    near = (model.about.lower + model.about.upper) / 2
    middle = model.sensory.weights.mean(axis=0)
    far = middle + 2.0 * model.solver.extent * np.eye(len(middle))[0]
    together = model.solve(far, near)
    assert not together.reachable.any()
    joints, said = fast.kernel.ask("inverse", near, far)
    assert said == 3
    assert np.isnan(joints).all()
    assert np.isnan(fast.inverse(far, near=near)).all()
    assert_allclose(fast.inverse(far, near=near, nearest=True), together.q[0], atol=1e-6)


def poses_in_millimetres():
    """A model of poses that a tracker in another frame tells in millimetres."""
    arm = calib.load_arm("six_axis")
    q = np.random.default_rng(0).uniform(0.6 * arm.lower, 0.6 * arm.upper, (60, 6))
    x, turns = arm.pose(q)
    return calib.train(log_of(arm, q, 1e3 * x + 200.0, orientation=turns, unit="mm"), size=3)


@needs_compiler
@pytest.mark.parametrize("made", [six, poses_in_millimetres])
def test_one_pose_is_that_of_the_batch_and_what_is_no_rotation_is_refused(made):
    model = made()
    fast = cold(model)
    fast.warm_up(strict=True)  # or the batch would answer for C
    q = draw(model, 12, margin=0.25)
    x, turns = model.pose(q)
    shift = np.random.default_rng(0).uniform(-0.2, 0.2, q.shape)
    near = np.clip(q + shift, model.about.lower, model.about.upper)
    together = model.inverse_pose(x, turns, near)
    for place, turn, beside, expected in zip(x, turns, near, together, strict=True):
        alone = fast.inverse_pose(place, turn, beside)
        assert_allclose(alone, expected, rtol=0, atol=1e-6)
        reached, turned = fast.pose(alone)
        assert_allclose(reached, place, rtol=0, atol=1e-9 * model.reach)
        assert abs(abs(turned @ turn) - 1.0) < 1e-12
    # compiled C would answer for the direction of what is no rotation
    once = warm(model).inverse_pose
    assert_allclose(once(x[0], turns[0], q[0]), q[0], atol=1e-6)
    for length in (0.5, 1.1):
        refused(calib.QueryError, "expected length 1", once, x[0], length * turns[0], q[0])


@needs_compiler
def test_c_that_knows_less_than_numpy_does_not_answer(monkeypatch):
    """A body's parameter that no C was written for left it 1.5 mm off, without a word."""
    model = cold(in_space())
    header = Header.of(replace(model, body=replace(model.body, beta=0.99 * model.body.beta)))
    monkeypatch.setattr(Header, "of", lambda _: header)
    assert "not agree with NumPy" in model.warm_up()
    assert not model.warm


@needs_compiler
def test_a_strict_model_says_why_it_has_no_answer_within_a_millisecond():
    model = optimised()
    q = (model.about.lower + model.about.upper) / 2 + 0.2
    position, turn = model.pose(q)
    assert np.isfinite(model.inverse_pose(position, turn, q)).all()
    started = time.thread_time()
    for _ in range(20):
        assert np.isnan(model.inverse_pose(position + 9.0, turn, q)).all()
    assert (time.thread_time() - started) / 20 < 1e-3
    assert "bounded search" in model.unanswered
    # without an orientation, or without `near`, too
    assert_allclose(model.forward(model.inverse_pose(position, near=q)), position, atol=1e-7)
    assert_allclose(model.forward(model.inverse(position)), position, atol=1e-7)
    assert np.isnan(model.inverse(position + 9.0)).all()
    assert "nothing reaches" in model.unanswered
    # what is no question has the words of the batch as its reason
    for wrong, beside, words in (
        (0.5 * turn, q, "length 0.5: expected length 1"),
        (0.0 * turn, q, "length 0: expected length 1"),
        (turn, q + 50.0, "expected a value in its range"),
    ):
        for frame in ("sensor", "base"):
            assert np.isnan(model.inverse_pose(position, wrong, beside, frame=frame)).all()
            assert words in model.unanswered
    assert np.isnan(model.inverse(position, near=q + 50.0)).all()
    assert "expected a value in its range" in model.unanswered
    assert np.isnan(model.forward(q + 50.0)).all()
    assert "is outside of the learned range" in model.unanswered
    # in another process, too
    again = cold(model)
    assert np.isnan(again.inverse_pose(position + 9.0, turn, q)).all()
    assert "bounded search" in again.unanswered


def test_a_joint_of_several_turns_is_answered_on_the_turn_of_near():
    arm = models.wide()
    model = calib.train(calib.babble(arm, 1500, seed=0), size=10)
    fast = warm(model)
    q = np.array([[-6.0, 1.0], [-3.3, 0.8], [3.4, 1.2], [5.9, 1.1], [-2.0, 0.5]])
    x = arm.forward(q)
    for aside in (0.1, -0.1):
        near = q + np.array([aside, 0.0])
        assert_allclose(model.inverse(x, near=near), q, atol=1e-6)
        alone = [fast.inverse(*pair) for pair in zip(x, near, strict=True)]
        assert_allclose(alone, q, atol=1e-6)


@pytest.mark.parametrize(("key", "value"), [("CALIB_NO_CC", "1"), ("CC", "none"), ("CC", "false")])
def test_without_a_compiler_the_batch_answers(monkeypatch, key, value):
    monkeypatch.setenv(key, value)
    model = trained("two_link", 600, 6)
    slow = cold(model)
    assert "batch" in slow.warm_up()
    assert not slow.warm
    refused(calib.OptionError, "strict", slow.warm_up, strict=True)
    q = draw(model, 1)
    assert_array_equal(slow.forward(q[0]), model.forward(q)[0])


def test_a_small_posterior_is_as_sure_as_the_whole_where_rows_were():
    # 80 rows within a third of each range, without a drawing: a second belief, far from the first
    # in what moves nothing, and curves of which rows tell the sum with the joints' offsets
    rows, _, fresh = of_a_third(80, waves=3e-4)
    model = calib.train(rows, size=4)
    ratio = model.expected_error(fresh) / model.body.bound(fresh)
    assert 0.85 < ratio.min() < ratio.max() < 1.25
    # of noisy samples all geometry is known alike: a few directions are a part of the variance
    model = trained("six_axis", 500, 4, 1e-3)
    q = draw(model, 200)
    ratio = model.model_error(q) / model.body.bound(q, noise=False)
    assert 0.95 < ratio.min() < ratio.max() < 1.05


def test_a_position_a_hair_beyond_a_limit_is_no_answer():
    """Once a last step that a limit cut short was not looked at, and its miss called a solution."""
    model = trained("polar")
    fast = warm(model)
    q = draw(model, 50, seed=5)
    q[:, 1] = model.about.upper[1]
    x = model.forward(q)
    beyond = x + 1e-2 * (x - model.forward(q - [0, 1e-4]))  # 1 um beyond the stop of a slide
    assert np.isnan(fast.inverse(beyond, near=q)).all()
    alone = [fast.inverse(place, near=joints) for place, joints in zip(beyond, q, strict=True)]
    assert np.isnan(alone).all()
    assert_allclose(fast.inverse(x, near=q), q, atol=1e-8)


CHAINS = [  # axes, places and limits of three joints, where the tip is, who answers
    (("0.88 -0.16 0.45", "0 0 0.1", "-1.6", "1.3"),
     ("-0.42 -0.91 0", "0.39 0.37 0.03", "-6.2", "7.0"),
     ("0 1 0", "-0.39 0.31 0.32", "-1.2", "2.9"), "-0.17 -0.03 0.08", lambda model: model),
    # optimised, a limit's share of its range rounds to less than one: once out of reach for C
    (("0.13 -0.13 0.64", "0 0 0", "-0.8", "2.9"),
     ("-1.27 -0.62 0.04", "-0.32 0.36 0.04", "-2.7", "1.0"),
     ("0.41 1.04 -0.13", "0.12 -0.12 0.5", "-1.1", "2.2"), "0.38 0.15 0.12", warm),
]  # fmt: skip


@pytest.mark.parametrize("chain", CHAINS)
def test_of_joints_at_their_limits_every_branch_is_found(chain, monkeypatch):
    """The way that a target is made of is among the answers."""
    *joints, tip, answering = chain
    # as users' compilers optimise it
    quick = Compiler(quick=("-O3", "-freciprocal-math"))
    monkeypatch.setattr("calib.kernel.compiled.COMPILER", quick)
    arm = arm_from_urdf(chain_urdf(*(turning(*each) for each in joints), tip=tip))
    model = answering(calib.train(calib.babble(arm, 1500, seed=0), size=20))
    u = np.random.default_rng(0).random((300, 3))
    q = arm.lower + np.where(u < 0.7, u, u.round()) * (arm.upper - arm.lower)
    x, scale = arm.forward(q), model.motor.scale
    assert np.isfinite(model.inverse(x)).all()
    for row, ways in zip(q, model.inverse_all(x), strict=True):
        gap = scale.difference(scale.to_unit(ways), scale.to_unit(row[None]))
        assert np.abs(gap).max(axis=1).min(initial=1.0) < 1e-3
