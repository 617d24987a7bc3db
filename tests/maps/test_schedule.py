"""Schedules: radii that decay exponentially, and lattices that grow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_maps import UNIT_BOX

from calib.maps.batch import coarse_to_fine, decay
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.stream.follow import matching_sigma


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
