"""Batch neural gas: it quantizes many dimensions better than a lattice, and is reproducible."""

import numpy as np

import calib


def uniform(n, d, seed=0):
    return np.random.default_rng(seed).random((n, d))


def test_in_six_dimensions_it_is_closer_to_samples_than_rows_and_a_lattice():
    u, fresh = uniform(6000, 6), uniform(1000, 6, seed=1)
    error = {
        name: calib.SOM((20, 20), name).fit(u).quantization_error(fresh)
        for name in ("gas", "rows", "som")
    }
    assert error["gas"] < 0.97 * error["rows"]
    assert error["gas"] < 0.99 * error["som"]


def test_epochs_are_told_and_the_error_falls():
    gas = calib.SOM((8, 8), "gas", epochs=5).fit(uniform(2000, 3))
    assert gas.history.shape == (5, 4)
    assert gas.history[-1, 2] < gas.history[0, 2]
