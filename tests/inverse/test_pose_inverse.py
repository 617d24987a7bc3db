"""The inverse in space: branches against the closed form, positions near joints, pixels."""

import numpy as np
from models import six

from calib.arm.loading import load_arm
from calib.arm.rotations import exponential, logarithm
from calib.common.scale import Scale
from calib.inverse.newton import Newton
from calib.inverse.pose import Joints, searched_ways
from calib.inverse.task import Poses, Positions
from calib.model.space import Space


def evaluate_of(arm):
    def evaluate(q):
        return (*arm.chain.poses(q), arm.chain.jacobian(q))

    return evaluate


def joints_of(arm):
    return Joints(arm.lower, arm.upper, arm.revolute)


def apart(joints, a, b):
    """Largest distance of any joint between rows (n, dof) and b (dof,); turns wrap."""
    scale = joints.turning
    return np.abs(scale.difference(scale.to_unit(a), scale.to_unit(b)) * scale.span).max(axis=1)


def rows(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


def test_every_branch_of_the_closed_form_is_found_and_none_is_invented():
    arm = load_arm("six_axis")
    joints, evaluate = joints_of(arm), evaluate_of(arm)
    missed = known = 0
    q = rows(arm, 12, 5)
    places, turns = arm.chain.poses(q)
    target = Poses.target(places, turns)
    searched = searched_ways(evaluate, target, joints, arm.chain.reach)
    for k, found in enumerate(searched):
        expected, inside = joints.within(closed_form(places[k], turns[k], arm.chain.rotation))
        expected = expected[inside]
        assert apart(joints, expected, q[k]).min() < 1e-6  # the closed form itself is right
        reached, turned = arm.chain.poses(found)
        assert np.abs(reached - places[k]).max() < 1e-8
        assert np.abs(turned - turns[k]).max() < 1e-7
        assert (found >= arm.lower).all()
        assert (found <= arm.upper).all()
        known += len(expected)
        missed += sum(apart(joints, found, each).min() > 1e-4 for each in expected)
        assert all(apart(joints, expected, each).min() < 1e-4 for each in found)
    assert known > 40
    assert missed == 0


def test_a_pose_has_the_same_branches_alone_and_among_others_and_out_of_reach_none():
    arm = load_arm("six_axis")
    places, turns = arm.chain.poses(rows(arm, 3, 8))
    places[1] = (2.0, 0.0, 0.0)
    evaluate, joints = evaluate_of(arm), joints_of(arm)
    target = Poses.target(places, turns)
    together = searched_ways(evaluate, target, joints, 1.0, seed=3)
    assert [len(found) > 0 for found in together] == [True, False, True]
    (alone,) = searched_ways(evaluate, target[2:], joints, 1.0, seed=3)
    np.testing.assert_allclose(alone, together[2], atol=1e-12)


def test_a_position_is_reached_near_given_joints_and_no_nearer_one_exists():
    arm = load_arm("six_axis")
    near = rows(arm, 30, 2) * 0.8
    rng = np.random.default_rng(3)
    target = arm.forward(near + rng.normal(0, 0.1, near.shape))
    scale = Scale.of_range(arm.lower, arm.upper, arm.revolute)

    def value_and_slope(u):
        place, _, slope = evaluate_of(arm)(scale.from_unit(u))
        return place, slope[:, :3] * scale.span

    newton = Newton(Positions(value_and_slope), scale, arm.chain.reach)
    wish = scale.to_unit(near)
    u, left = newton.settle(wish, target, wish)
    assert left.max() < 1e-8
    np.testing.assert_allclose(arm.forward(scale.from_unit(u)), target, atol=1e-8)
    # the motion is across the null space: no direction that keeps the position brings it nearer
    assert np.abs(newton.tangent(u, wish - u)).max() < 1e-5


def test_orientation_is_kept_as_far_as_joints_allow():
    space = Space.of(six())
    arm, rng = load_arm("six_axis"), np.random.default_rng(5)
    near = rows(arm, 20, 4) * 0.7
    place, before, _ = space.evaluate(near)
    target = place + rng.normal(0, 0.02, (20, 3))
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
