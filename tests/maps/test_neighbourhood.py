"""Neighbourhood sums on a lattice, and the two ways in which nodes follow them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_maps import UNIT_BOX

from calib import Map
from calib.maps.batch import coarse_to_fine, decay, moved, spread, spread_out
from calib.maps.lattice import REACH, Lattice
from calib.stream.follow import matching_sigma

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


@given(st.floats(0.1, 100), st.floats(0.01, 1), st.integers(2, 200))
def test_radii_start_and_end_as_told_and_fall_by_one_factor(start, share, n):
    values = decay(start, start * share, n)
    assert len(values) == n
    assert values[0] == pytest.approx(start)
    assert values[-1] == pytest.approx(start * share)
    np.testing.assert_allclose(values[1:] / values[:-1], share ** (1 / (n - 1)), rtol=1e-9)


def test_the_papers_lattice_grows_from_64_nodes_by_nine():
    shapes = [s.lattice.shape for s in coarse_to_fine(Lattice((70, 70)))]
    assert list(dict.fromkeys(shapes)) == [(8, 8), (24, 24), (70, 70)]


@pytest.mark.parametrize(
    ("epochs", "sigma", "radii"),
    [(7, None, (35.0, 0.4, 7)), (None, (3.0, 2.0), (3.0, 2.0, 20)), (4, (9.0, 1.0), (9.0, 1.0, 4))],
)
def test_epochs_or_sigma_train_the_full_lattice_alone(epochs, sigma, radii):
    (stage,) = coarse_to_fine(Lattice((70, 70)), epochs, sigma)
    start, end, n = radii
    assert stage.lattice.shape == (70, 70)
    assert (len(stage.sigma), stage.sigma[0], stage.sigma[-1]) == (
        n,
        pytest.approx(start),
        pytest.approx(end),
    )


def trained_like(*history, shape=(30, 30)):
    lattice = Lattice(shape)
    units = np.zeros((lattice.size, 2))
    return Map(units, lattice, UNIT_BOX, np.array([(*row, 0.0) for row in history]))


def test_between_two_epochs_the_radius_is_interpolated_geometrically():
    network = trained_like((900, 8.0, 0.5), (900, 4.0, 0.4), (900, 1.0, 0.2), (900, 0.5, 0.05))
    # after a radius of 8 the error was 0.4, after 4 it was 0.2, after 1 it was 0.05
    assert matching_sigma(network, 0.3) == pytest.approx(8.0 * 0.5**0.5)
    assert matching_sigma(network, 0.35) == pytest.approx(8.0 * 0.5**0.25)
    assert matching_sigma(network, 0.125) == pytest.approx(4.0 * 0.25**0.5)
    assert matching_sigma(network, 0.05) == pytest.approx(1.0)
    assert matching_sigma(network, 0.4) == pytest.approx(8.0)
    assert matching_sigma(network, 0.41) == 15.0
