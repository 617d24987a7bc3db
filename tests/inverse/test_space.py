"""Poses: every way against closed forms and random starts, positions near joints, free axes."""

import numpy as np
import pytest
from models import draw, six, warm

from calib.arm.loading import load_arm
from calib.arm.rotations import exponential, logarithm, matrix_of, quaternion_of
from calib.common.scale import Scale
from calib.errors import QueryError
from calib.inverse.closed_form import ClosedForm
from calib.inverse.newton import Newton
from calib.inverse.postures import Postures
from calib.inverse.search import Search
from calib.inverse.task import Poses, Positions
from calib.model.poses import solve_poses
from calib.model.space import Space


def of_arm(arm):
    """Where the tip of a drawing is, and the unit box of its joints."""

    def evaluate(q):
        return (*arm.chain.poses(q), arm.chain.jacobian(q))

    return evaluate, Scale.of_range(arm.lower, arm.upper, arm.revolute)


def rows(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


def inside(arm, q):
    """Joints by whole turns near the middle of their ranges, those within the limits."""
    middle = (arm.lower + arm.upper) / 2
    q = q - 2 * np.pi * np.round((q - middle) / (2 * np.pi))
    return q[((q > arm.lower) & (q < arm.upper)).all(axis=1)]


def apart(scale, a, b):
    """Largest difference of any joint between rows (n, k), as a share of its range."""
    gap = scale.difference(scale.to_unit(a)[:, None], scale.to_unit(b))
    return np.abs(gap).max(axis=2)


def test_every_way_of_two_closed_forms_is_found_and_none_is_invented():
    arm = load_arm("six_axis")
    evaluate, scale = of_arm(arm)
    q = rows(arm, 12, 5)
    places, turns = arm.chain.poses(q)
    places = np.vstack([places, [[2.0, 0.0, 0.0]]])  # out of reach
    turns = np.concatenate([turns, turns[:1]])
    drawn = ClosedForm.of(arm.chain).joints(places, turns)
    length = arm.chain.reach
    starts = Postures(evaluate, scale, length, tuple(range(12)))
    search = Search(Newton(Poses(evaluate, scale, length, length), scale), starts, 0.3)
    owner, u, _ = search.every(Poses.target(places, turns))
    missed = total = 0
    for k in range(12):
        expected = inside(arm, closed_form(places[k], turns[k], arm.chain.rotation))
        assert apart(scale, expected, q[k : k + 1]).min() < 1e-6  # it is right itself
        np.testing.assert_array_less(apart(scale, expected, drawn[k]).min(axis=1), 1e-6)
        gap = apart(scale, expected, scale.from_unit(u[owner == k]))
        assert (gap.min(axis=0) < 1e-4).all()
        missed += (gap.min(axis=1) > 1e-4).sum()
        total += len(expected)
    assert total > 40
    assert missed == 0
    assert (owner < 12).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_every_way_of_a_calibrated_arm_and_the_nearest_of_them(compiled):
    model = warm(six()) if compiled else six()
    scale = model.motor.scale
    q, near = draw(model, 8, seed=5, margin=0.05), draw(model, 8, seed=6)
    position, turn = model.pose(q)
    ways = solve_poses(model, position, turn, near, every=True, bounded=False)
    nearest = model.inverse_pose(position, turn, near)
    space = Space.of(model)
    newton = Newton(Poses(space.evaluate, scale, space.length, space.length), scale)
    target = Poses.target(*space.evaluate(q)[:2])
    for k in range(len(q)):
        found = ways.q[ways.target == k]
        start = np.vstack([scale.to_unit(q[k : k + 1]), np.random.default_rng(k).random((400, 6))])
        u, miss = newton.refine(start, np.tile(target[k], (401, 1)))
        gap = apart(scale, scale.from_unit(u[newton.met(miss)]), found)
        assert (gap.min(axis=1) < 1e-5).all()  # none is missed
        assert (gap.min(axis=0) < 1e-5).all()  # none is invented
        among = apart(scale, found, found) + np.eye(len(found))
        assert among.min() > 1e-5  # none is named twice
        away = np.linalg.norm(
            scale.difference(scale.to_unit(found), scale.to_unit(near[k : k + 1])), axis=1
        )
        assert (np.diff(away) >= 0).all()
        np.testing.assert_allclose(nearest[k], found[0], atol=1e-5)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_free_axis_leaves_the_turn_about_it_open(compiled):
    model = warm(six()) if compiled else six()
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


def test_a_position_is_reached_near_joints_and_no_nearer_one_exists():
    arm = load_arm("six_axis")
    near = rows(arm, 30, 2) * 0.8
    shift = np.random.default_rng(3).normal(0, 0.1, near.shape)
    target = arm.forward(near + shift)
    evaluate, scale = of_arm(arm)
    newton = Newton(Positions.in_base(evaluate, scale, arm.chain.reach), scale)
    wish = scale.to_unit(near)
    u, miss = newton.settle(wish, target, wish)
    assert miss.max() < 1e-8
    np.testing.assert_allclose(arm.forward(scale.from_unit(u)), target, atol=1e-8)
    # the motion is across the null space: no direction that keeps the position brings it nearer
    slope = newton.task.residual(u, target)[1]
    assert np.abs(newton.tangent(u, slope, wish - u)).max() < 1e-4


def test_orientation_is_kept_as_far_as_joints_allow():
    space = Space.of(six())
    near = rows(load_arm("six_axis"), 20, 4) * 0.7
    place, before, _ = space.evaluate(near)
    target = place + np.random.default_rng(5).normal(0, 0.02, (20, 3))
    turns = []
    for keep in (False, True):
        after = space.evaluate(space.at_positions(target, near, keep=keep))
        assert np.median(np.linalg.norm(after[0] - target, axis=1)) < 1e-8
        turn = logarithm(after[1] @ before.swapaxes(1, 2))
        turns.append(np.median(np.linalg.norm(turn, axis=1)))
    assert turns[1] < 0.2 * turns[0]


HEIGHT, SIDE, UPPER, FORE, DROP, TOOL = 0.16, 0.20, 0.42, 0.38, 0.09, 0.08


def closed_form(position: np.ndarray, frame: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Every joint vector (b, 6) that reaches a pose, by geometry; `tip` is the tip's frame at zero.

    The orientation is Rz(q1) Ry(q2 + q3 + q4) Rz(-q5) Ry(q6) `tip`, and the wrist lies 0.20 m
    beside the vertical plane of the two links.
    """
    r = frame @ tip.T
    wrist = position - TOOL * r[:, 1]
    out = []
    far = np.hypot(wrist[0], wrist[1])
    if far < SIDE:
        return np.empty((0, 6))
    for side in (np.arcsin(SIDE / far), np.pi - np.arcsin(SIDE / far)):
        q1 = np.arctan2(wrist[1], wrist[0]) - side
        back = exponential(np.array([0.0, 0.0, -q1]))
        m, w = back @ r, back @ wrist
        for sign in (1, -1):
            q5 = sign * np.arccos(np.clip(m[1, 1], -1, 1))
            s5 = np.sin(q5)
            if abs(s5) < 1e-9:
                continue
            total = np.arctan2(-m[2, 1] / s5, m[0, 1] / s5)
            q6 = np.arctan2(-m[1, 2] / s5, -m[1, 0] / s5)
            x = w[0] + DROP * np.sin(total)
            z = -(w[2] - HEIGHT + DROP * np.cos(total))
            bend = (x * x + z * z - UPPER**2 - FORE**2) / (2 * UPPER * FORE)
            if abs(bend) > 1:
                continue
            for q3 in (np.arccos(bend), -np.arccos(bend)):
                q2 = np.arctan2(z, x) - np.arctan2(FORE * np.sin(q3), UPPER + FORE * np.cos(q3))
                out.append([q1, q2, q3, total - q2 - q3, q5, q6])
    return np.array(out).reshape(-1, 6)
