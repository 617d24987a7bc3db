"""Paths: one branch where there is one, no jumps, and told where one cannot be avoided."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from models import draw, lengths, log_of, trained, turning, two_link, two_link_inverse
from numpy.testing import assert_allclose, assert_array_equal
from reference import pinocchio_pose

import calib

TURN = 2 * np.pi
SQUARE = [[0.30, 0.30], [0.25, 0.35], [0.15, 0.30], [0.30, 0.30]]


@pytest.fixture(scope="module")
def model():
    """An arm with both branches."""
    return trained("two_link_full", n=8000, size=40)


def one_sided(model, sign):
    """Return targets that only one branch reaches."""
    q = draw(model, 400, seed=1)
    q = q[np.sign(q[:, 1]) == sign]
    other = two_link_inverse(two_link(q), -sign)
    beyond = ((other < model.about.lower - 0.1) | (other > model.about.upper + 0.1)).any(axis=1)
    return two_link(q[beyond & (np.abs(q[:, 1]) > 0.5)])


def steps(path, model):
    """Largest move of a joint between two rows, as a share of its range."""
    span = model.about.upper - model.about.lower
    return np.abs(np.diff(path.q, axis=0) / span).max(axis=1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_path_stays_on_the_branch_where_it_starts(model, sign):
    waypoints = np.array([[0.33, 0.30], [0.30, 0.35], [0.33, 0.33]])
    start = two_link_inverse(waypoints[:1], sign)[0]
    path = model.path(waypoints, start=start)
    assert len(path.jumps) == 0
    assert (np.sign(path.q[:, 1]) == sign).all()
    assert_allclose(path.q, two_link_inverse(path.target, sign), atol=1e-6)
    assert steps(path, model).max() < 0.1


def test_a_jump_that_cannot_be_avoided_is_told_where_it_is(model):
    plus, minus = one_sided(model, 1.0), one_sided(model, -1.0)
    share = np.linspace(0, 1, 20)[:, None]
    told = tried = 0
    for a, b in itertools.product(plus[:15], minus[:15]):
        if tried == 6 or not model.solve(a + share * (b - a)).reachable.all():
            continue
        tried += 1
        path = model.path([a, b])
        # elbows change sides at the stretched pose, or by a jump that is told
        far = np.flatnonzero(steps(path, model) > 0.2) + 1
        assert set(far) <= set(path.jumps.tolist())
        assert len(path.jumps) <= 1
        told += len(path.jumps)
    assert tried == 6
    assert told >= 1


def test_rows_lie_on_the_lines_at_most_a_step_apart(model):
    path = model.path(SQUARE, step=0.007)
    gaps = lengths(np.diff(path.target, axis=0))
    assert gaps.max() <= 0.007 + 1e-12
    for k, waypoint in enumerate(SQUARE):
        last = np.flatnonzero(path.waypoint == k)[-1]
        assert_array_equal(path.target[last], waypoint)
    assert (np.diff(path.waypoint) >= 0).all()
    assert_allclose(two_link(path.q), path.target, atol=1e-8)


def test_a_redundant_arm_follows_a_circle_without_a_jump():
    model, arm = trained("three_link"), calib.load_arm("three_link")
    turn = np.linspace(0, 2 * np.pi, 25)
    circle = np.stack([0.15 + 0.08 * np.cos(turn), 0.40 + 0.08 * np.sin(turn)], axis=1)
    path = model.path(circle)
    assert len(path.jumps) == 0
    assert path.reachable.all()
    assert lengths(arm.forward(path.q) - path.target).max() < 1e-7
    assert steps(path, model).max() < 0.1


def with_limits(model, limits):
    return replace(model, about=replace(model.about, limits=np.array(limits)))


def test_a_joint_goes_on_over_the_seam_where_it_can_and_is_told_where_it_turns_round():
    corners = two_link(np.array([[3.0, 1.0], [3.3, 1.0]]))
    model = turning()
    path = model.path(corners, step=0.01)
    assert len(path.jumps) == 1  # its log knows one turn
    row = path.jumps[0]
    assert abs(abs(path.q[row, 0] - path.q[row - 1, 0]) - TURN) < 0.1
    wide = with_limits(model, [[-TURN, TURN], [0.3, 2.5]])
    path = wide.path(corners, step=0.01)
    assert len(path.jumps) == 0
    assert np.abs(np.diff(path.q[:, 0])).max() < 0.1
    for turn in (-TURN, 0.0):  # of two turns on which it can go on the nearer one
        there = wide.path(corners, start=[3.0 + turn, 1.0])
        assert there.q[0, 0] == pytest.approx(3.0 + turn, abs=1e-5)
    near = [path.q[-1, 0], 1.0]
    assert abs(wide.inverse(corners[1], near=near)[0] - near[0]) < 1.0


def test_near_beyond_the_limits_of_several_turns_asks_for_the_turn_beside_them():
    model = with_limits(turning(), [[-TURN, TURN], [0.3, 2.5]])
    x = two_link(np.array([[-0.383, 1.0]]))
    for query in (x, x[0]):
        answer = model.inverse(query, near=[8.4, 1.0])  # 2.5 from 5.9, and 8.8 from -.383
        assert_allclose(np.ravel(answer), [-0.383 + TURN, 1.0], atol=1e-6)


def test_a_path_of_the_base_frame_is_followed_by_pinocchios_arm():
    arm = calib.load_arm("spatial_three")
    log = calib.babble(arm, 60, seed=0)
    turn = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])
    seen = 1e3 * (log.x @ turn.T + [0.2, -0.1, 0.4])  # a tracker of its own frame, in mm
    model = calib.train(log_of(arm, log.q, seen, unit="mm"), size=4)
    ends = pinocchio_pose(arm, np.array([[-0.5, 0.6, -1.0], [0.5, 0.8, -1.3]]))[0]
    path = model.path(ends, frame="base")
    assert path.reachable.all()
    assert len(path.jumps) == len(path.fast_turns) == 0
    assert_array_equal(path.target[[0, -1]], ends)
    assert_allclose(pinocchio_pose(arm, path.q)[0], path.target, atol=1e-9)


@pytest.mark.parametrize("frame", ["sensor", "base"])
def test_joints_that_turn_fast_beside_the_first_axis_are_told(frame):
    arm = calib.load_arm("spatial_three")
    model = trained("spatial_three", n=60, size=4)
    path = model.path([[0.25, 0.04, 0.6], [-0.25, 0.04, 0.6]], frame=frame)
    turn = np.abs(np.diff(path.q, axis=0)).max(axis=1)
    assert np.isfinite(path.expected_error).all()
    fast = np.flatnonzero(turn > 0.25) + 1
    assert len(fast)
    assert set(fast) <= set(path.fast_turns)
    assert turn[path.fast_turns - 1].min() > 0.2
    # beside the axis, of which the tip stays 4 cm away
    assert np.abs(arm.forward(path.q[path.fast_turns])[:, 0]).max() < 0.1
