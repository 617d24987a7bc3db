"""Plans whose tip stays in a box, and what is impossible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import trained, two_link_inverse

import calib
from calib.common.scale import Scale
from calib.use.keep_inside import keep_of
from calib.use.pose_space import space_of

DEGREE = math.radians(1.0)
UNIT = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))


def between(q, steps=200):
    """Return places along the straight moves from row to row."""
    share = np.linspace(0, 1, steps)[:, None, None]
    return (q[:-1] + share * np.diff(q, axis=0)).reshape(-1, q.shape[1])


def way(plan):
    """Return all places that the arm comes through, the start first."""
    return plan.q if plan.start is None else np.vstack([plan.start, plan.q])


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("two_link")


# --- keeping ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "keep", "start"),
    [
        ("two_link", {"x": (0.0, 0.3), "y": (0.2, 0.5)}, None),
        ("two_link_full", {"x": (0.1, 0.4), "y": (0.1, 0.45)}, None),
        ("two_link_full", {"y": (0.1, 0.45)}, [0.5, 0.6]),
        ("polar", {"x": (-0.2, 0.3)}, None),
        ("three_link", {"x": (0.1, 0.4)}, None),
    ],
)
def test_the_tip_never_leaves_the_box(robot, keep, start):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 40, keep=keep, start=start)
    x = arm.forward(between(way(plan)))
    for axis, (low, high) in keep.items():
        seen = x[:, "xy".index(axis)]
        assert seen.min() > low
        assert seen.max() < high
    assert np.count_nonzero(~plan.via) == 40
    assert plan.length < 0.5 * plan.random_length


def test_moves_that_would_leave_the_box_are_led_round():
    arm = calib.load_arm("two_link_full")
    box = {"x": (0.1, 0.45), "y": (0.1, 0.45)}
    keep = keep_of(space_of(arm), box)
    ends = np.array([[0.02, 1.3], [0.9, -1.3]])  # halfway the arm is stretched: x = 0.49
    u = (ends - arm.lower) / (arm.upper - arm.lower)
    assert keep.holds(u).all()
    assert arm.forward(ends.mean(axis=0))[0] > 0.49
    assert keep.clear(u[:1], u[1:]).tolist() == [False]
    plans = [calib.plan(arm, 40, keep=box, seed=seed) for seed in range(3)]
    for plan in plans:
        assert {-1.0, 1.0} <= set(np.sign(plan.q[:, 1]))
        assert not any("elbow" in note for note in plan.notes)
    assert any(plan.via.any() for plan in plans)


@given(st.integers(0, 2**32))
@settings(deadline=None, max_examples=30)
def test_a_move_said_to_be_clear_is_clear(seed):
    arm = calib.load_arm("two_link_full")
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.uniform(-0.3, 0.6, (2, 2)), axis=0)
    keep = keep_of(space_of(arm), {"x": (low[0], high[0]), "y": (low[1], high[1])})
    a, b = rng.random((2, 50, 2))
    b = a + 0.3 * (b - a)
    clear = keep.clear(a, b)
    for u, v in zip(a[clear], b[clear], strict=True):
        x = arm.forward(keep.space.scale.from_unit(between(np.stack([u, v]), 500)))
        assert (x >= low).all()
        assert (x <= high).all()
    # and what stays well inside is said to be clear
    share = np.linspace(0, 1, 300)[:, None, None]
    x = arm.forward(keep.space.scale.from_unit((a + share * (b - a)).reshape(-1, 2)))
    room = np.minimum(x - low, high - x).min(axis=1).reshape(300, 50).min(axis=0)
    assert clear[room > keep.step].all()


def test_places_keep_half_a_step_from_the_border():
    """A tip that goes out and back between two places a step apart goes no further than that."""
    space = replace(space_of(calib.load_arm("two_link")), position=lambda q: q, scale=UNIT)
    keep = keep_of(space, {"x": (0.2, 0.8)})
    assert keep.step == pytest.approx(0.01, rel=0.01)  # of the extent, which is 1
    x = np.array([0.2, 0.2 + 0.49 * keep.step, 0.2 + 0.51 * keep.step, 0.8 - 0.49 * keep.step])
    held = keep.holds(np.stack([x, np.full(4, 0.5)], axis=1))
    assert held.tolist() == [False, False, True, False]
    assert keep.holds(np.array([[np.nan, 0.5]])).tolist() == [False]


def test_a_tip_that_is_faster_than_was_thought_is_not_taken_to_be_inside():
    arm = calib.load_arm("two_link")
    keep = keep_of(space_of(arm), {"x": (-9.0, 9.0)})
    start, end = np.array([[0.1, 0.2]]), np.array([[0.9, 0.8]])
    assert keep.clear(start, end).tolist() == [True]
    assert replace(keep, reach=keep.reach / 10).clear(start, end).tolist() == [False]


def test_branches_that_the_box_parts_are_told():
    """Elbow up and elbow down meet where the arm is stretched, at 0.55 m: beyond this box."""
    arm = calib.load_arm("two_link_full")
    box = {"x": (0.25, 0.37), "y": (0.25, 0.37)}
    for sign in (1.0, -1.0):
        start = two_link_inverse(np.array([[0.3, 0.3]]), sign)[0]
        plan = calib.plan(arm, 20, keep=box, start=start)
        assert (np.sign(plan.q[:, 1]) == sign).all()
        assert any("`start`" in note for note in plan.notes)


def test_a_model_keeps_its_tip_too():
    model = trained("two_link", n=3000, size=20)
    keep = {"x": (0.0, 0.3), "y": (0.2, 0.5)}
    plan = calib.plan(model, 15, keep=keep)
    x = model.forward(between(way(plan)))
    assert (x > [0.0, 0.2]).all()
    assert (x < [0.3, 0.5]).all()


# --- Python's errors and the file ---------------------------------------------------------


def test_the_same_seed_gives_the_same_plan(arm):
    a, b, c = (calib.plan(arm, 30, seed=s) for s in (4, 4, 5))
    np.testing.assert_array_equal(a.q, b.q)
    assert not np.array_equal(a.q, c.q)
    with pytest.raises(ValueError, match="read-only"):
        a.q[0] = 0


@pytest.mark.parametrize(
    ("n", "options", "part"),
    [
        (0, {}, "n is 0"),
        (1001, {}, "expected 1 to 1,000"),
        (2.5, {}, "whole number"),
        (5, {"seed": -1}, "seed is -1"),
        (5, {"margin": -0.1}, "margin -0.1"),
        (5, {"margin": float("nan")}, "margin nan"),
        (5, {"margin": [0.1, 0.1, 0.1]}, "one for each of shoulder, elbow"),
        (5, {"margin": 2.0}, "no room is left in shoulder"),
        (5, {"ranges": {"elbow": (0.0, 1.0)}}, "outside the joint's limits"),
        (5, {"ranges": {"ellbow": (0.5, 1.0)}}, "did you mean elbow"),
        (5, {"start": [0.5]}, "expected 2 finite joint values"),
        (5, {"start": ["a", "b"]}, "expected 2 finite joint values"),
        (5, {"start": [0.5, 9.0]}, "elbow = 9 is outside of its range"),
        (5, {"keep": {"z": (0.0, 1.0)}}, "expected x or y"),
        (5, {"keep": {"x": (1.0, 0.0)}}, "the lower one first"),
        (5, {"keep": {"x": (float("nan"), 0.0)}}, "the lower one first"),
        (5, {"keep": {"x": (2.0, 3.0)}}, "no pose of the 5 wanted"),
        (5, {"keep": {"x": (0.1, 0.1001)}}, "give a wider box"),
        (5, {"keep": {"x": (0.0, 0.2)}, "start": [0.0, 0.3]}, "start's tip is at"),
    ],
)
def test_what_is_impossible_is_told_in_one_line(arm, n, options, part):
    with pytest.raises(calib.OptionError) as told:
        calib.plan(arm, n, **options)
    assert part in str(told.value)
    assert "\n" not in str(told.value)


def test_a_log_of_other_joints_is_refused(arm):
    log = calib.babble(calib.load_arm("polar"), 20)
    with pytest.raises(calib.OptionError, match="have the joints"):
        calib.plan(arm, 5, measured=log)


def test_a_written_plan_is_no_log_by_mistake(arm, tmp_path):
    path = tmp_path / "poses.csv"
    plan = calib.plan(arm, 12)
    plan.write(path)
    with pytest.raises(calib.LogError, match="x"):
        calib.read_log(path, arm)
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, plan.q)
    np.testing.assert_array_equal(log.x, plan.x)


def test_a_joint_is_not_taken_for_what_is_expected(arm):
    plan = replace(calib.plan(arm, 5), joint_names=("shoulder", "expected_y"))
    with pytest.raises(calib.OptionError, match="cannot be told from the plan's own column"):
        plan.columns()
