"""Poses: every way against closed forms, the nearest of them, and free axes."""

import numpy as np
import pytest
from conftest import refused
from models import draw, lengths, six, trained, warm
from numpy.testing import assert_allclose
from reference import ROBOTS, needs_robots, pinocchio_forward, random_joints

import calib
from calib.arm.rotations import exponential, matrix_of, quaternion_of
from calib.model.poses import solve_poses

either_way = pytest.mark.parametrize("answering", [warm, lambda model: model], ids=["C", "batch"])
HEIGHT, SIDE, UPPER, FORE, DROP, TOOL = 0.16, 0.20, 0.42, 0.38, 0.09, 0.08


def inside(model, q):
    """Joints by whole turns near the middle of their ranges, those within the limits."""
    lower, upper = model.about.lower, model.about.upper
    q = q - 2 * np.pi * np.round((q - (lower + upper) / 2) / (2 * np.pi))
    return q[((q > lower) & (q < upper)).all(axis=1)]


def apart(model, a, b):
    """Largest difference of any joint between rows (n, k), as a share of its range."""
    scale = model.motor.scale
    gap = scale.difference(scale.to_unit(a)[:, None], scale.to_unit(b))
    return np.abs(gap).max(axis=2)


@either_way
def test_every_way_of_a_closed_form_is_found_and_none_is_invented(answering):
    model = answering(trained("six_axis", 60, 3))
    q = draw(model, 12, seed=5)
    places, turns = model.pose(q)
    places = np.vstack([places, [[2.0, 0.0, 0.0]]])  # out of reach
    turns = np.concatenate([turns, turns[:1]])
    ways = solve_poses(model, places, turns, every=True, bounded=False)
    zero = matrix_of(calib.load_arm("six_axis").pose(np.zeros((1, 6)))[1])[0]
    total = 0
    for k, frame in enumerate(matrix_of(turns[:12])):
        expected = inside(model, closed_form(places[k], frame, zero))
        assert apart(model, expected, q[k : k + 1]).min() < 1e-6  # it is right itself
        gap = apart(model, expected, ways.q[ways.target == k])
        assert (gap.min(axis=0) < 1e-4).all()
        assert (gap.min(axis=1) < 1e-4).all()
        total += len(expected)
    assert total > 40
    assert not ways.reachable[ways.target == 12].any()


@either_way
def test_ways_of_a_calibrated_arm_are_named_once_the_nearest_first(answering):
    model = answering(six())
    scale = model.motor.scale
    q, near = draw(model, 8, seed=5, margin=0.05), draw(model, 8, seed=6)
    position, turn = model.pose(q)
    ways = solve_poses(model, position, turn, near, every=True, bounded=False)
    nearest = model.inverse_pose(position, turn, near)
    for k in range(len(q)):
        found = ways.q[ways.target == k]
        assert apart(model, found, q[k : k + 1]).min() < 1e-5
        place, turned = model.pose(found)
        assert_allclose(place, np.tile(position[k], (len(found), 1)), atol=1e-7)
        assert_allclose(np.abs(turned @ turn[k]), 1.0, atol=1e-7)
        among = apart(model, found, found) + np.eye(len(found))
        assert among.min() > 1e-5  # none is named twice
        away = scale.difference(scale.to_unit(found), scale.to_unit(near[k : k + 1]))
        assert (np.diff(lengths(away)) >= 0).all()
        assert_allclose(nearest[k], found[0], atol=1e-5)


@either_way
def test_a_free_axis_leaves_the_turn_about_it_open(answering):
    model = answering(six())
    q = draw(model, 6, seed=7, margin=0.1)
    position, turn = model.pose(q)
    spun = quaternion_of(matrix_of(turn) @ exponential([0.0, 0.0, 1.0])[None])
    joints = model.inverse_pose(position, spun, q, free="z")
    place, reached = model.pose(joints)
    assert_allclose(place, position, atol=1e-7)
    assert_allclose(matrix_of(reached)[:, :, 2], matrix_of(turn)[:, :, 2], atol=1e-7)
    assert np.abs(joints - q).max() < 0.3  # as the turn is free, they hardly have to move
    refused(calib.QueryError, "one of x, y, z", model.inverse_pose, position, spun, q, free="w")


def closed_form(position: np.ndarray, frame: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Every joint vector (b, 6) that reaches a pose, by geometry; `tip` is the tip's frame at zero.

    The orientation is Rz(q1) Ry(q2 + q3 + q4) Rz(-q5) Ry(q6) `tip`, and the wrist lies 0.20 m
    beside the vertical plane of the two links.
    """
    r = frame @ tip.T
    wrist = position - TOOL * r[:, 1]
    out = []
    far = np.hypot(wrist[0], wrist[1])
    for side in (np.arcsin(SIDE / far), np.pi - np.arcsin(SIDE / far)):
        q1 = np.arctan2(wrist[1], wrist[0]) - side
        back = exponential(np.array([0.0, 0.0, -q1]))
        m, w = back @ r, back @ wrist
        for sign in (1, -1):
            q5 = sign * np.arccos(np.clip(m[1, 1], -1, 1))
            s5 = np.sin(q5)
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


@needs_robots
@pytest.mark.parametrize("file", ["tiago_description/robots/tiago", "panda_description/urdf/panda"])
def test_every_reachable_pose_of_seven_joints_is_reached_and_none_is_invented(file):
    """A way that slid into a corner of the limits was given up, 1 and 4 of 80 poses."""
    arm = calib.load_arm(ROBOTS / f"{file}.urdf")
    model = calib.train(calib.babble(arm, 2000, seed=0), size=20)
    q = random_joints(arm, 80, seed=5)
    places, turns = arm.pose(q)
    for answers in (model.inverse(places), model.inverse_pose(places, turns)):
        assert np.isfinite(answers).all()
        assert ((answers >= arm.lower - 1e-9) & (answers <= arm.upper + 1e-9)).all()
        assert_allclose(pinocchio_forward(arm, answers), pinocchio_forward(arm, q), atol=1e-6)
    assert_allclose(matrix_of(arm.pose(answers)[1]), matrix_of(turns), atol=1e-5)


@needs_robots
def test_what_lies_just_inside_of_the_edge_of_a_redundant_arm_is_reached():
    """Once compiled C said of 28 of 40 such positions that nothing reaches them."""
    arm = calib.load_arm(ROBOTS / "g1_description/urdf/g1_29dof_rev_1_0.urdf")
    model = warm(calib.train(calib.babble(arm, 1500, seed=0), size=20))
    directions = np.random.default_rng(5).normal(size=(5, 3))
    directions /= lengths(directions)[:, None]
    middle = model.sensory.weights.mean(axis=0)
    far = middle + 5 * model.solver.extent * directions
    edge = model.forward(model.inverse(far, nearest=True))
    inside = edge + 1e-4 * (middle - edge)
    assert_allclose(arm.forward(model.inverse(inside)), inside, atol=1e-7)
    # of the edge itself, to the last digit, most: once none
    assert np.isfinite(model.inverse(edge)).all(axis=1).mean() > 0.9


@either_way
def test_no_rows_are_no_answers(answering):
    """Once bounds in space, and compiled C asked for every way, failed at an empty batch."""
    model = answering(six())
    none = np.empty((0, 3))
    assert model.expected_error(np.empty((0, 6))).shape == (0,)
    for every in (False, True):
        answers = solve_poses(model, none, np.empty((0, 4)), every=every)
        assert answers.q.shape == (0, 6)
        assert answers.expected_error.shape == (0,)


def test_poses_with_joints_at_their_limits_keep_their_ways():
    """Once the table of starts lay between the limits: one of seven such poses lost a way."""
    model = warm(trained("so101"))
    lower, upper, rng = model.about.lower, model.about.upper, np.random.default_rng(3)
    q = draw(model, 60, seed=5)
    for row in q:
        joints = rng.permutation(5)[:3]
        row[joints] = np.where(rng.random(3) < 0.5, lower[joints], upper[joints])
    ways = solve_poses(model, *model.pose(q), every=True, bounded=False)
    gaps = [apart(model, ways.q[ways.target == k], q[k : k + 1]).min() for k in range(len(q))]
    assert np.count_nonzero(np.array(gaps) > 1e-3) <= 1
