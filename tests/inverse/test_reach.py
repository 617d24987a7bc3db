"""Out of reach: the nearest attainable point; closed loops: a step, limits, arms that differ."""

from dataclasses import replace

import numpy as np
import pytest
from models import ELBOW, draw, trained, two_link
from refusals import refused

import calib


@pytest.mark.parametrize(("bound", "reached"), [(1e-3, 1e-3), (0.02, 1e-2)])
def test_a_target_counts_as_reached_within_the_expected_error_and_a_hundredth(bound, reached):
    """Within the smaller of the expected error and 1 % of the workspace's extent."""
    model = trained("two_link")
    q = np.array([[0.7, ELBOW[0]]])
    edge, extent = two_link(q), model.solver.extent
    unsure = replace(model, bounds=np.full(model.motor.size, bound * extent))
    outwards = edge / np.linalg.norm(edge)
    for share in (0.0, 0.5, 0.95):
        answer = unsure.solve(edge + share * reached * extent * outwards)
        assert answer.reachable.all()
        np.testing.assert_allclose(answer.q, q, atol=1e-6)
    for share in (1.05, 3.0):
        assert not unsure.solve(edge + share * reached * extent * outwards).reachable.any()
    # an exact model promises no more than what it knows
    assert model.expected_error(q).max() < 1e-9 * extent
    beyond = edge + 1e-6 * extent * outwards
    assert not model.solve(beyond).reachable.any()
    assert [len(ways) for ways in model.inverse_all(beyond)] == [0]


@pytest.mark.parametrize("robot", ["two_link_full", "scara", "polar", "three_link"])
def test_no_attainable_point_is_closer_and_the_edge_is_reached(robot):
    model, arm = trained(robot), calib.load_arm(robot)
    rng = np.random.default_rng(1)
    grid = rng.uniform(arm.lower, arm.upper, (20_000, arm.dof))
    for k in range(arm.dof):  # the workspace ends where joints do
        grid[k::6, k] = rng.choice([arm.lower[k], arm.upper[k]], len(grid[k::6]))
    positions = arm.forward(grid)
    targets = rng.uniform(-0.9, 0.9, (150, 2))
    closest = np.array([np.linalg.norm(positions - x, axis=1).min() for x in targets])
    # from joints far away, too: of ways that miss the one that misses least
    for near in (grid[:150], None):
        answer = model.solve(targets, near)
        out = ~answer.reachable
        assert out.sum() > 30
        assert (answer.distance[out] <= closest[out] + 1e-6).all()
        assert answer.distance[~out].max() < 1e-12
    away = np.linalg.norm(arm.forward(answer.q) - targets, axis=1)
    np.testing.assert_allclose(away, answer.distance, atol=1e-6)
    at_limits = model.solve(positions[: 6 * 40])
    assert at_limits.reachable.all()
    assert at_limits.distance.max() < 1e-8


def test_a_small_step_goes_where_the_jacobian_says_and_a_gain_is_a_share_of_the_way():
    model = trained()
    q = draw(model, 50, seed=1, margin=0.2)
    gap = 1e-5 * np.random.default_rng(2).normal(size=(50, 2))
    x = two_link(q)
    moved = two_link(model.servo(x, x + gap, q, gain=1.0)) - x
    np.testing.assert_allclose(moved, gap, rtol=0.05, atol=5e-7)
    np.testing.assert_allclose(model.servo(x, x, q), q, atol=1e-12)  # on target
    for gain in (0.0, -1.0, 1.5, float("nan")):
        refused(calib.QueryError, "gain", model.servo, x, x, q, gain=gain)


def test_steps_keep_the_limits_and_are_never_long():
    model = trained()
    span = model.about.upper - model.about.lower
    q = draw(model, 100, seed=6)
    far = np.random.default_rng(7).uniform(-5, 5, (100, 2))
    after = model.servo(two_link(q), far, q, gain=1.0)
    assert (after >= model.about.lower - 1e-12).all()
    assert (after <= model.about.upper + 1e-12).all()
    assert (np.linalg.norm((after - q) / span, axis=1) <= 0.1 + 1e-12).all()
