"""Trained maps and the unit box: nearest nodes, also round a turn, and their two errors."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import Map
from calib.common.scale import Scale
from calib.maps.lattice import Lattice


def box(lower, upper, revolute=None):
    lower, upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
    return Scale.of_range(lower, upper, tuple(revolute or [True] * len(lower)))


def network(units, shape, scale):
    return Map(np.array(units, dtype=float), Lattice(shape), scale, np.zeros((0, 4)))


@pytest.fixture
def ring():
    """Three nodes on a joint that turns round."""
    return network([[0.05], [0.5], [0.95]], (3,), box([-np.pi], [np.pi]))


@pytest.fixture
def square():
    """Four nodes on the corners of a box 2 wide and 10 high."""
    return network([[0, 0], [0, 1], [1, 0], [1, 1]], (2, 2), box([0, -5], [2, 5]))


def test_the_winner_is_found_across_the_seam_of_a_whole_turn(ring):
    distance, index = ring.nearest(np.array([[0.99], [0.01], [1.02], [-0.03], [0.4]]))
    assert index[:, 0].tolist() == [2, 0, 0, 2, 1]
    np.testing.assert_allclose(distance[:, 0], [0.04, 0.04, 0.03, 0.02, 0.1], atol=1e-12)


@pytest.mark.parametrize("turning", [[False, False], [True, False]])
def test_a_few_places_are_answered_without_scipy_as_by_its_tree(turning, monkeypatch):
    rng = np.random.default_rng(3)
    scale = box([-np.pi, -1.0], [np.pi, 1.0], turning)
    points, places = rng.random((60, 2)), rng.uniform(-0.2, 1.2, (40, 2))
    import scipy.spatial  # noqa: F401

    wanted = network(points, (6, 10), scale).nearest(places, 4)
    monkeypatch.delitem(sys.modules, "scipy.spatial")
    found = network(points, (6, 10), scale).nearest(places, 4)
    assert (found[1] == wanted[1]).all()
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-12, atol=1e-15)


def test_quantization_error_is_the_mean_distance_in_own_units(square):
    # a fifth of the width beside the first node; a tenth of the height below the last
    x = [[0.4, -5.0], [2.0, 4.0]]
    assert square.quantization_error(x) == pytest.approx((0.4 + 1.0) / 2)
    assert square.quantization_error(square.weights) == 0.0


def test_topographic_error_counts_samples_between_nodes_that_are_no_neighbours():
    # a line of four nodes folded over: nodes 0 and 3 lie side by side
    folded = network([[0.0, 0.0], [0.5, 0.0], [0.5, 0.4], [0.0, 0.1]], (4,), box([0, 0], [1, 1]))
    fold, middle = [0.0, 0.05], [0.3, 0.0]
    assert folded.topographic_error([fold]) == 1.0
    assert folded.topographic_error([middle]) == 0.0
    assert folded.topographic_error([fold, middle, middle, middle]) == 0.25


def test_spacings_are_the_mean_distances_to_joined_nodes():
    plane = box([0, 0], [1, 1], [False, False])
    units = [[0.0, 0.0], [0.0, 0.2], [0.4, 0.0], [0.3, 0.3]]
    kite = network(units, (2, 2), plane)
    sides = {(0, 1): 0.2, (0, 2): 0.4, (1, 3): np.hypot(0.3, 0.1), (2, 3): np.hypot(0.1, 0.3)}
    assert kite.spacing == pytest.approx(np.mean(list(sides.values())))
    own = [np.mean([d for pair, d in sides.items() if k in pair]) for k in range(4)]
    np.testing.assert_allclose(kite.spacings, own)


shapes = st.lists(st.integers(2, 6), min_size=1, max_size=3).map(tuple)


@given(shapes)
def test_edges_join_exactly_the_nodes_at_lattice_distance_one(shape):
    lattice = Lattice(shape)
    r = lattice.positions()
    distance = np.abs(r[:, None] - r[None]).sum(axis=2)
    expected = {(i, j) for i, j in np.argwhere(distance == 1).tolist() if i < j}
    edges = [tuple(e) for e in lattice.edges().tolist()]
    assert set(edges) == expected
    assert len(edges) == len(expected)


@given(shapes, shapes)
def test_resampling_keeps_linear_functions_of_the_cell_middles(coarse, fine):
    if len(coarse) != len(fine):
        fine = (fine * 3)[: len(coarse)]
    slope = np.arange(1.0, len(coarse) + 1)

    def plane(lattice):
        middles = (lattice.positions() + 0.5) / lattice.shape
        return np.stack([middles @ slope, 1 - middles @ slope], axis=1)

    old, new = Lattice(coarse), Lattice(fine)
    np.testing.assert_allclose(old.resample(plane(old), new), plane(new), atol=1e-12)
