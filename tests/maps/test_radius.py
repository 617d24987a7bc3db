"""The radius that a stream starts again from (eq. 10): where training had the same error."""

import numpy as np
import pytest

from calib.change.follow import matching_sigma
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map

BOX = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))


def trained_like(*history, shape=(30, 30)):
    lattice = Lattice(shape)
    units = np.zeros((lattice.size, 2))
    return Map(units, lattice, BOX, np.array([(*row, 0.0) for row in history]))


def test_between_two_epochs_the_radius_is_interpolated_geometrically():
    network = trained_like((900, 8.0, 0.5), (900, 4.0, 0.4), (900, 1.0, 0.2), (900, 0.5, 0.05))
    # after a radius of 8 the error was 0.4, after 4 it was 0.2, after 1 it was 0.05
    assert matching_sigma(network, 0.3) == pytest.approx(8.0 * 0.5**0.5)
    assert matching_sigma(network, 0.35) == pytest.approx(8.0 * 0.5**0.25)
    assert matching_sigma(network, 0.125) == pytest.approx(4.0 * 0.25**0.5)
    assert matching_sigma(network, 0.05) == pytest.approx(1.0)
    assert matching_sigma(network, 0.4) == pytest.approx(8.0)
    assert matching_sigma(network, 0.41) == 15.0


def test_a_radius_of_a_coarse_lattice_is_the_same_share_of_the_full_one():
    network = trained_like((100, 2.0, 0.5), (100, 1.0, 0.4), (900, 1.0, 0.2), (900, 0.5, 0.1))
    assert matching_sigma(network, 0.4) == pytest.approx(6.0)
    assert matching_sigma(network, 0.3) == pytest.approx(6.0 * 0.5**0.5)
    assert matching_sigma(network, 0.2) == pytest.approx(3.0)
