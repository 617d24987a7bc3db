"""The dynamic map: what its source says of elasticity, time and density."""

import numpy as np
from small_maps import points

import calib
from calib.maps.lattice import Lattice
from calib.maps.others import present_dsom


def step(weights, x, elasticity, rate, shape):
    moved = weights.copy()
    present_dsom(moved, Lattice(shape), np.atleast_2d(x), elasticity, rate)
    return moved


def test_one_sample_moves_a_3x3_map_as_the_source_says():
    w, x = points(9, seed=3), np.array([0.2, 0.9])
    d = np.linalg.norm(w - x, axis=1) / np.sqrt(2)  # over the diagonal of the box
    s = d.argmin()
    p = Lattice((3, 3)).positions() / 2  # a lattice of unit sides
    h = np.exp(-np.sum((p - p[s]) ** 2, axis=1) / (1.5 * d[s]) ** 2)
    expected = w + 0.1 * (d * h)[:, None] * (x - w)
    np.testing.assert_allclose(step(w, x, 1.5, 0.1, (3, 3)), expected, atol=2e-4)


def test_density_is_not_followed():
    """Nine of ten samples lie in one half, yet a SOM puts more nodes there than a DSOM."""
    rng = np.random.default_rng(0)
    x = rng.random((6000, 2))
    x[:5400, 0] *= 0.5
    x[5400:, 0] = 0.5 + 0.5 * x[5400:, 0]
    share = {
        name: float(np.mean(calib.SOM((12, 12), name, seed=1).fit(x).weights[:, 0] < 0.5))
        for name in ("som", "dsom")
    }
    assert share["som"] > share["dsom"] + 0.05


def test_a_dsom_unfolds_and_represents_its_samples():
    x = points(4000)
    network = calib.SOM((10, 10), "dsom").fit(x)
    assert network.topographic_error(x) < 0.1
    assert network.quantization_error(x) < 1.6 * 0.377 / 10
