"""Neighbourhood sums on a lattice, and the two ways in which nodes follow them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.maps.batch import moved, spread, spread_out
from calib.maps.lattice import REACH, Lattice

shapes = st.lists(st.integers(2, 30), min_size=1, max_size=4).map(tuple)


def random(*shape, seed=0):
    return np.random.default_rng(seed).random(shape)


def neighbourhood(lattice, sigma):
    """h_ji of equation 3, cut along each axis where `spread` may cut it."""
    steps = np.abs(lattice.positions()[:, None] - lattice.positions()[None])
    near = (steps <= int(REACH * sigma) + 1).all(axis=2)
    return np.where(near, np.exp(-np.sum(steps**2, axis=2) / (2 * sigma**2)), 0.0)


@settings(max_examples=40, deadline=None)
@given(shapes.filter(lambda s: np.prod(s) < 700), st.floats(0.2, 20.0))
def test_spread_is_the_sum_of_eq_3_over_all_nodes(shape, sigma):
    lattice = Lattice(shape)
    sums = random(lattice.size, 3)
    expected = neighbourhood(lattice, sigma) @ sums
    np.testing.assert_allclose(spread(sums, lattice, sigma), expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("step", [None, 1.5])
def test_nodes_that_no_sample_reaches_stay_where_they_are(step):
    lattice, weights = Lattice((40,)), random(40, 2)
    sums = np.zeros((40, 3))
    sums[0] = [0.5, 0.5, 1.0]
    new = moved(weights, sums, lattice, 0.5, step)
    assert (new[8:] == weights[8:]).all()
    assert (new[0] != weights[0]).any()


@pytest.mark.parametrize("shape", [(70, 70), (17, 17, 17), (300,), (6, 6, 6, 6)])
def test_a_start_fills_the_box_in_order(shape):
    """Of samples of a uniform box each lattice axis runs one way, by one coordinate."""
    dim, lattice = len(shape), Lattice(shape)
    grid = spread_out(random(500, dim), lattice).reshape(*shape, dim)
    for k in range(dim):
        steps = np.diff(grid, axis=k)
        assert (steps[..., k] > 0.0).all()
        assert np.abs(np.delete(steps, k, axis=-1)).max(initial=0.0) < 1e-12
