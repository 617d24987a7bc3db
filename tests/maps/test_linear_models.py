"""The readout of maps and links that regresses: what it reproduces, its slopes, its inverse."""

import numpy as np
from small_maps import grid, points

from calib.common.scale import Scale
from calib.maps.association import Association
from calib.maps.linear_models import regress
from calib.maps.links import WIRINGS
from calib.maps.som import SOM


def associated(truth, n=9, rows=20_000):
    u = points(rows)
    x = truth(u)
    scale = Scale.of_data(x)
    sensory = SOM((n, n), "som").fit(x, scale=scale)
    return Association.learn(grid(n), u, sensory, scale.to_unit(x), WIRINGS["reciprocal"])


def test_slopes_are_finite_differences_of_the_blended_value():
    affine = associated(lambda u: np.stack([np.sin(2 * u[:, 0]), u[:, 0] * u[:, 1]], axis=1))
    u, h = 0.05 + 0.9 * points(300, seed=3), 1e-6
    value, slope = affine.linear.value_and_slope(u)
    np.testing.assert_allclose(value, affine.linear.value(u), rtol=0, atol=1e-15)
    for k in range(2):
        step = h * np.eye(2)[k]
        found = (affine.linear.value(u + step) - affine.linear.value(u - step)) / (2 * h)
        # but for a point or two whose nearest nodes change within the step
        assert np.quantile(np.abs(found - slope[:, :, k]), 0.99) < 1e-6


def test_the_regression_is_that_of_the_normal_equations():
    rng = np.random.default_rng(5)
    place, value, weight = (
        rng.normal(size=(1, 12, 2)),
        rng.normal(size=(1, 12, 3)),
        rng.random((1, 12)),
    )
    middle, mean, slope = regress(place, value, weight)
    w = weight[0] / weight.sum()
    np.testing.assert_allclose(middle[0], w @ place[0])
    np.testing.assert_allclose(mean[0], w @ value[0])
    z = place[0] - middle[0]
    power = z.T @ (w[:, None] * z)
    power += 1e-2 * np.trace(power) / 2 * np.eye(2)
    np.testing.assert_allclose(slope[0], np.linalg.solve(power, z.T @ (w[:, None] * value[0])))
