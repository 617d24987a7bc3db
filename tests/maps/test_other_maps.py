"""Growing neural gas: ages, insertion, removal, growth, and what a gain does to it."""

import numpy as np
from small_maps import points

import calib


def test_a_gas_grows_to_its_size_and_follows_its_samples():
    x = points(3000)
    network = calib.SOM((10, 10), "gng").fit(x)
    assert 95 <= network.size <= 100
    assert network.quantization_error(x) < 1.15 * 0.377 / 10
    assert network.topographic_error(x) < 0.05
    assert network.history[0, 0] < network.history[-1, 0]


def test_a_gas_leaves_a_hole_empty_that_a_lattice_crosses():
    x = points(6000)
    x = x[np.linalg.norm(x - 0.5, axis=1) > 0.3]
    gap = {}
    for name in ("som", "gng"):
        w = calib.SOM((10, 10), name).fit(x).weights
        gap[name] = int(np.sum(np.linalg.norm(w - 0.5, axis=1) < 0.22))
    assert gap["gng"] == 0 < gap["som"]


def test_a_dsom_unfolds_and_represents_its_samples():
    x = points(4000)
    network = calib.SOM((10, 10), "dsom").fit(x)
    assert network.topographic_error(x) < 0.1
    assert network.quantization_error(x) < 1.6 * 0.377 / 10
