"""Steps in joint space: the rate and the slide along the self-motion, by the textbook."""

import numpy as np
import pytest
from models import trained


@pytest.fixture(scope="module")
def newton():
    return trained("three_link").solver.newton


def around(n, dof, seed=0):
    return 0.1 + 0.8 * np.random.default_rng(seed).random((n, dof))


def test_a_rate_is_damped_least_squares(newton):
    u, gap = around(30, 3), 0.01 * (around(30, 2, 1) - 0.5)
    slope = newton.task.forward.value_and_slope(u)[1]
    power = np.einsum("noi,noi->n", slope, slope)
    square = slope @ np.swapaxes(slope, 1, 2) + 1e-3 * power[:, None, None] * np.eye(2)
    expected = np.einsum("noi,no->ni", slope, np.linalg.solve(square, gap[..., None])[..., 0])
    np.testing.assert_allclose(newton.rate(u, gap), expected, rtol=1e-9)


def test_a_tangent_is_the_projection_onto_the_null_space(newton):
    u, wish = around(50, 3), around(50, 3, 1) - 0.5
    slope = newton.task.forward.value_and_slope(u)[1]
    expected = wish - np.einsum("nio,noj,nj->ni", np.linalg.pinv(slope), slope, wish)
    move = newton.tangent(u, wish)
    np.testing.assert_allclose(move, expected, atol=1e-9)
    np.testing.assert_allclose(np.einsum("noi,ni->no", slope, move), 0.0, atol=1e-9)


def test_a_step_ends_on_its_target_within_the_limits(newton):
    goal = around(200, 3, 4)
    goal[:, 0] = 0.0  # the shoulder at its limit
    start = np.clip(goal + 0.1 * (around(200, 3, 5) - 0.5), 0, 1)
    u, left = newton.refine(start, newton.task.forward.value(goal))
    assert left.max() < 1e-12
    assert u.min() >= 0.0
    assert u.max() <= 1.0
