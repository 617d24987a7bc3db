"""Folds, and the attainable point that is nearest to a target, on arms of a closed form."""

import numpy as np
import pytest
from closed_arms import TWO, newton_of

from calib.common.scale import TURN
from calib.inverse.closest import closest
from calib.inverse.starts import damped_inverse, twins


@pytest.fixture
def two():
    return newton_of(TWO, [0.0, 0.2], [np.pi / 2, 2.7])


# --- folds ------------------------------------------------------------------------------


def test_a_twin_lies_across_the_stretched_arm():
    newton = newton_of(TWO, [-1.5, -2.7], [1.5, 2.7])
    q = np.array([[0.2, 0.05], [0.2, -0.05], [0.2, 1.5], [-0.5, 0.08]])
    u = newton.scale.to_unit(q)
    rows, start = twins(newton, u)
    assert rows.tolist() == [0, 1, 3]
    x = newton.task.forward.value(u)
    other, left = newton.refine(start, x[rows])
    assert left.max() < 1e-12
    found = newton.scale.from_unit(other)
    np.testing.assert_allclose(found[:, 1], -q[rows, 1], atol=1e-9)
    # the first guess was already close: the error is of second order
    np.testing.assert_allclose(newton.scale.from_unit(start)[:, 1], -q[rows, 1], atol=5e-3)


def test_on_the_fold_itself_the_twin_is_the_solution():
    newton = newton_of(TWO, [-1.5, -2.7], [1.5, 2.7])
    u = newton.scale.to_unit(np.array([[0.3, 0.0]]))
    np.testing.assert_allclose(twins(newton, u)[1], u[: len(twins(newton, u)[0])], atol=1e-12)


def test_a_damped_inverse_is_the_textbooks():
    slope = np.random.default_rng(0).normal(size=(20, 2, 4))
    turned = np.swapaxes(slope, 1, 2)
    power = np.einsum("noi,noi->n", slope, slope)[:, None, None]
    expected = turned @ np.linalg.inv(slope @ turned + 1e-2 * power * np.eye(2))
    np.testing.assert_allclose(damped_inverse(slope, 1e-2), expected, rtol=1e-9)
    assert np.isfinite(damped_inverse(np.zeros((1, 2, 3)), 1e-4)).all()


# --- closest ----------------------------------------------------------------------------


def grid_of(newton, n=101):
    axes = np.meshgrid(*(np.linspace(0, 1, n),) * 2, indexing="ij")
    return newton.task.forward.value(np.stack([a.ravel() for a in axes], axis=1))


@pytest.mark.parametrize("far", [1.0, 1e3, 1e9])
def test_the_closest_point_of_a_free_arm_lies_on_its_circle(far):
    newton = newton_of(TWO, [-3.0, -2.0], [3.0, 2.0])
    angle = np.linspace(-1.0, 1.0, 15)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = newton.scale.to_unit(np.stack([angle + 0.3, np.full(15, -0.5)], axis=1))
    u, left = closest(newton, start, far * ray)
    np.testing.assert_allclose(newton.task.forward.value(u), sum(TWO) * ray, atol=1e-7)
    np.testing.assert_allclose(left, far - sum(TWO), rtol=1e-12)
    assert newton.task.forward.asked <= 1 + 1 + 5 * 20  # Newton: two looks per joint and step


def test_beside_the_limits_no_point_of_a_grid_is_closer(two):
    rng = np.random.default_rng(3)
    x = rng.uniform(-0.7, 0.7, (40, 2))
    reached = grid_of(two)
    best = np.linalg.norm(reached[None] - x[:, None], axis=2)
    out = best.min(axis=1) > 0.01
    axis = np.linspace(0, 1, 101)
    start = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    u, left = closest(two, start[best.argmin(axis=1)], x)
    assert (left[out] <= best.min(axis=1)[out] + 1e-12).all()
    np.testing.assert_allclose(
        left, np.linalg.norm(two.task.forward.value(u) - x, axis=1), atol=1e-14
    )
    assert u.min() >= 0.0
    assert u.max() <= 1.0
    # at rest: what the distance still asks of the joints points out of the box
    value, slope = two.task.forward.value_and_slope(u)
    push = np.einsum("noi,no->ni", slope, x - value)[out]
    outward = ((u[out] == 0.0) & (push <= 0.0)) | ((u[out] == 1.0) & (push >= 0.0))
    assert np.abs(push[~outward]).max() < 1e-7


def test_a_joint_that_turns_round_follows_a_far_target_through_its_seam():
    newton = newton_of(TWO, [-np.pi, 0.2], [np.pi, 2.7])
    x = np.array([[-2.0, -0.01]])
    start = newton.scale.to_unit(np.array([[3.0, 0.3]]))
    u, left = closest(newton, start, x)
    reach = np.linalg.norm(newton.task.forward.value(np.array([[0.3, 0.0]])))
    assert left[0] == pytest.approx(np.linalg.norm(x) - reach, abs=1e-12)
    assert u[0, 1] == 0.0
    assert newton.scale.span[0] == TURN
