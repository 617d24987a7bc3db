"""The inverse against closed forms: branches, limits, reach, turns, redundancy."""

from dataclasses import replace

import numpy as np
import pytest
from models import ELBOW, draw, trained, turning, two_link

from calib.common.scale import TURN

ROBOTS = ("two_link", "two_link_full", "three_link", "polar", "scara", "tilted")


def from_middle(model, q):
    """Distance of joints to the middle of their ranges, in units of these."""
    span = model.about.upper - model.about.lower
    return np.linalg.norm((q - model.about.lower) / span - 0.5, axis=-1)


@pytest.mark.parametrize("robot", ROBOTS)
def test_forward_of_inverse_is_the_target(robot):
    model = trained(robot)
    x = model.forward(draw(model, 300, seed=1))
    answer = model.solve(x)
    assert answer.reachable.all()
    np.testing.assert_allclose(model.forward(answer.q), x, atol=1e-9)
    np.testing.assert_allclose(answer.position, x, atol=1e-9)
    assert answer.distance.max() < 1e-9


@pytest.mark.parametrize("robot", ROBOTS)
def test_answers_keep_within_the_limits(robot):
    model = trained(robot)
    rng = np.random.default_rng(2)
    x = rng.uniform(-0.9, 0.9, (200, 2))  # within reach and far out of it
    q = model.solve(x).q
    slack = 1e-12 * (model.about.upper - model.about.lower)
    assert (q >= model.about.lower - slack).all()
    assert (q <= model.about.upper + slack).all()


def test_near_is_reached_exactly_where_it_solves():
    for robot in ("two_link_full", "three_link", "polar"):
        model = trained(robot)
        q = draw(model, 100, seed=5, margin=0.02)
        said = model.inverse(model.forward(q), near=q)
        gap = np.abs(said - q) / (model.about.upper - model.about.lower)
        assert gap.max() < 1e-5, robot
        np.testing.assert_allclose(model.forward(said), model.forward(q), atol=1e-8)


def test_redundant_joints_slide_towards_the_wish_and_stay_on_target():
    model = trained("three_link")
    q = draw(model, 60, seed=6, margin=0.1)
    x = model.forward(q)
    span = model.about.upper - model.about.lower
    wish = np.clip(q + 0.1 * span * [1, -1, 1], model.about.lower, model.about.upper)
    said = model.inverse(x, near=wish)
    np.testing.assert_allclose(model.forward(said), x, atol=1e-8)

    def away(joints):
        return np.linalg.norm((joints - wish) / span, axis=1)

    # the joints drawn solve the target too: no answer should be farther than they are
    assert (away(said) <= away(q) + 1e-4).all()


def test_every_answer_of_a_redundant_arm_is_on_target_and_nearer_ones_come_first():
    model = trained("three_link")
    x = model.forward(draw(model, 30, seed=7, margin=0.1))
    for target, solutions in zip(x, model.inverse_all(x), strict=True):
        assert len(solutions) >= 1
        np.testing.assert_allclose(model.forward(solutions), np.tile(target, (len(solutions), 1)))
        assert (np.diff(from_middle(model, solutions)) >= 0).all()


def test_without_a_wish_redundant_joints_stay_as_central_as_the_target_allows():
    model = trained("three_link")
    q = draw(model, 100, seed=7, margin=0.1)
    said = model.inverse(model.forward(q))
    # the joints drawn reach the target too, so the answer may not be farther out
    assert (from_middle(model, said) <= from_middle(model, q) + 1e-4).all()


def test_beyond_a_limited_elbow_the_nearest_point_has_the_elbow_at_its_limit():
    model = trained("two_link")
    q = np.stack([np.linspace(0.1, 1.4, 15), np.full(15, ELBOW[0])], axis=1)
    edge = two_link(q)
    answer = model.solve(1.3 * edge)
    assert not answer.reachable.any()
    np.testing.assert_allclose(answer.distance, 0.3 * np.linalg.norm(edge, axis=1), atol=1e-9)
    np.testing.assert_allclose(answer.position, edge, atol=1e-5)
    np.testing.assert_allclose(answer.q, q, atol=1e-4)


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
    assert not model.solve(edge + 1e-6 * extent * outwards).reachable.any()


def test_a_joint_that_turns_round_reaches_every_direction_across_its_seam():
    model = turning()
    q = draw(model, 300, seed=9, margin=0.01)
    q[:20, 0] = np.pi - 1e-3 * np.arange(20)
    q[20:40, 0] = -np.pi + 1e-3 * np.arange(20)
    x = two_link(q)
    answer = model.solve(x, near=q)
    assert answer.reachable.all()
    np.testing.assert_allclose(two_link(answer.q), x, atol=1e-6)
    gap = answer.q - q
    gap[:, 0] -= TURN * np.round(gap[:, 0] / TURN)
    np.testing.assert_allclose(gap, 0.0, atol=1e-5)
    assert (np.abs(answer.q[:, 0]) <= np.pi + 1e-12).all()


def test_joint_values_one_turn_on_are_the_same_query():
    model = turning()
    q = draw(model, 50, seed=10, margin=0.01)
    np.testing.assert_allclose(model.forward(q + np.array([TURN, 0])), model.forward(q), atol=1e-9)
    x = two_link(q)
    np.testing.assert_allclose(
        model.inverse(x, near=q + np.array([TURN, 0])), model.inverse(x, near=q), atol=1e-9
    )
