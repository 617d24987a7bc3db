"""Out of reach: the nearest attainable point, holes, gaps between branches, bad targets."""

import numpy as np
import pytest
from models import L1, L2, trained

import calib


def test_a_stretched_arm_points_at_a_far_target():
    model = trained("two_link_full")
    angle = np.radians([10.0, 45.0, 80.0])
    for far in (0.6, 2.0, 1e6):
        x = far * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        answer = model.solve(x)
        assert not answer.reachable.any()
        np.testing.assert_allclose(answer.distance, far - L1 - L2, rtol=1e-9)
        np.testing.assert_allclose(answer.q, np.stack([angle, 0 * angle], 1), atol=1e-4)


def test_a_hole_in_the_workspace():
    model = trained("scara")
    # the elbow stops short of folding: the tip cannot come closer to the base than this
    arm = calib.load_arm("scara")
    hole = np.linalg.norm(arm.forward([0.0, arm.upper[1]]))
    assert hole > 0.2
    answer = model.solve([[0.0, 0.0], [0.1, 0.0], [0.0, 0.05]])
    assert not answer.reachable.any()
    np.testing.assert_allclose(answer.distance, hole - np.array([0, 0.1, 0.05]), atol=1e-6)
    assert np.isnan(model.inverse([0.0, 0.0])).all()
    assert [len(q) for q in model.inverse_all([[0.0, 0.0], [0.5, 0.0]])] == [0, 2]


@pytest.mark.parametrize("robot", ["two_link_full", "scara", "polar", "three_link"])
def test_no_attainable_point_is_closer(robot):
    model, arm = trained(robot), calib.load_arm(robot)
    rng = np.random.default_rng(1)
    grid = rng.uniform(arm.lower, arm.upper, (20_000, arm.dof))
    for k in range(arm.dof):  # the workspace ends where joints do
        grid[k::6, k] = rng.choice([arm.lower[k], arm.upper[k]], len(grid[k::6]))
    positions = arm.forward(grid)
    targets = rng.uniform(-0.9, 0.9, (150, 2))
    answer = model.solve(targets)
    known = np.array([np.linalg.norm(positions - x, axis=1).min() for x in targets])
    out = ~answer.reachable
    assert out.sum() > 30
    assert (answer.distance[out] <= known[out] + 1e-6).all()
    np.testing.assert_allclose(
        np.linalg.norm(arm.forward(answer.q) - targets, axis=1), answer.distance, atol=1e-6
    )


def test_at_the_edge_what_is_attainable_is_reached():
    model, arm = trained("two_link_full"), calib.load_arm("two_link_full")
    rng = np.random.default_rng(2)
    q = rng.uniform(arm.lower, arm.upper, (300, 2))
    q[::3, 0] = arm.lower[0]
    q[1::3, 1] = arm.upper[1]
    q[2::3, 1] = 0.0
    answer = model.solve(arm.forward(q))
    assert answer.reachable.all()
    assert answer.distance.max() < 1e-8


@pytest.mark.parametrize("readout", ["local", "activity", "winner"])
@pytest.mark.parametrize("size", [1e12, 1e200, 1e308])
def test_targets_of_any_size_have_the_nearest_point_of_their_direction(readout, size):
    model = trained("two_link")
    direction = np.array([[0.6, 0.8], [-0.6, 0.8], [0.0, -1.0]])
    far = model.solve(size * direction, readout=readout)
    near = model.solve(1e7 * direction, readout=readout)
    np.testing.assert_allclose(far.q, near.q, atol=1e-4)
    np.testing.assert_allclose(far.distance, size, rtol=1e-9)
    assert not far.reachable.any()
