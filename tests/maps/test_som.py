"""Maps: trained by the equations and other rules, nearest nodes, errors, lattices."""

import sys

import numpy as np
import pytest
from conftest import refused
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from small_maps import UNIT_BOX, box, network, points

from calib import SOM, LogError
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.vdsom import VDSOM, Layer, Rates

BOUND = 0.377  # quantization error of the best (hexagonal) quantizer: 0.377 sqrt(A / N)
NETWORKS = {  # nodes along a side, samples, quantization error over the best, topographic error
    "som": (40, 10_000, 1.15, 0.05),
    "vdsom": (40, 10_000, 1.4, 0.05),  # it spends nodes on the border
    "gng": (10, 3000, 1.15, 0.05),
    "dsom": (10, 4000, 1.6, 0.1),
}
shapes = st.lists(st.integers(2, 6), min_size=1, max_size=3).map(tuple)
NO_SAMPLES = [
    (np.zeros((0, 2)), r"samples of shape \(0, 2\)"),
    (np.zeros((5, 0)), r"samples of shape \(5, 0\)"),
    (np.zeros(5), r"samples of shape \(5,\)"),
    ([[0.0, 1.0], [np.nan, 1.0]], "sample 1 is .*expected finite numbers"),
]


def batch_target(weights, lattice, x, gain=1.0):
    """Mean of all samples, weighted by gain and by eq. 3 (sigma 1) of their winners."""
    r = lattice.positions()
    winners = ((x[:, None] - weights[None]) ** 2).sum(axis=2).argmin(axis=1)
    h = gain * np.exp(-((r[:, None] - r[winners]) ** 2).sum(axis=2) / 2)
    return (h @ x) / h.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("strength", [1.0, 5.0])
def test_batch_weights_are_the_mean_of_the_samples_weighted_by_the_gain(strength):
    x = points(300)
    heavy = np.where(x[:, 0] > 0.5, strength, 1.0)
    som = SOM((3, 3), lambda visit: heavy, epochs=200, sigma=(1.0, 1.0)).fit(x, scale=UNIT_BOX)
    expected = batch_target(som.units, som.lattice, x, heavy)
    assert_allclose(som.units, expected, atol=1e-9)
    assert (som.units[:, 0].mean() > 0.6) == (strength > 1.0)


def test_the_online_rule_comes_to_rest_where_the_batch_rule_does():
    x, every = points(400), np.ones(400)
    settled = SOM((3, 3), "som", epochs=200, sigma=(1.0, 1.0)).fit(x, scale=UNIT_BOX)
    start = settled.units + 0.05 * (points(9, seed=5) - 0.5)
    net = VDSOM([Layer(start.copy(), settled.lattice, UNIT_BOX)])
    for rate in np.geomspace(0.02, 1e-4, 60):
        net.show([x], Rates((every,), rate * every, every, every, every))
    weights = net.layers[0].weights
    assert np.abs(weights - batch_target(weights, settled.lattice, x)).max() < 2e-3
    assert np.abs(start - settled.units).max() > 2e-2


@pytest.mark.parametrize("name", NETWORKS)
def test_a_map_is_ordered_and_close_to_the_best_quantizer(name):
    side, n, near, folded = NETWORKS[name]
    x, fresh = points(n), points(5000, seed=1)
    som = SOM((side, side), name).fit(x, scale=UNIT_BOX)
    assert som.quantization_error(x) < near * BOUND / side
    assert som.quantization_error(fresh) < (near + 0.05) * BOUND / side
    assert som.topographic_error(fresh) < folded
    if name == "som":
        assert_allclose(som.history[-1, 2:], [som.quantization_error(x), som.topographic_error(x)])
    if name == "gng":  # it grows to its size
        assert 95 <= som.size <= 100
        assert som.history[0, 0] < som.history[-1, 0]


@pytest.mark.parametrize(("x", "message"), NO_SAMPLES)
def test_samples_that_are_none_are_refused_in_one_line(x, message):
    refused(LogError, message, SOM((3, 3)).fit, x)
    refused(LogError, message, SOM((3, 3), rule="online").fit_pair, x, x)


def test_the_winner_is_found_across_the_seam_of_a_whole_turn():
    ring = network([[0.05], [0.5], [0.95]], (3,), box(True))
    distance, index = ring.nearest(np.array([[0.99], [0.01], [1.02], [-0.03], [0.4]]))
    assert index[:, 0].tolist() == [2, 0, 0, 2, 1]
    assert_allclose(distance[:, 0], [0.04, 0.04, 0.03, 0.02, 0.1], atol=1e-12)


@pytest.mark.parametrize("turning", [[False, False], [True, False]])
def test_a_few_places_are_answered_without_scipy_as_by_its_tree(turning, monkeypatch):
    rng = np.random.default_rng(3)
    scale = box(*turning)
    points, places = rng.random((60, 2)), rng.uniform(-0.2, 1.2, (40, 2))
    import scipy.spatial  # noqa: F401

    wanted = network(points, (6, 10), scale).nearest(places, 4)
    monkeypatch.delitem(sys.modules, "scipy.spatial")
    found = network(points, (6, 10), scale).nearest(places, 4)
    assert (found[1] == wanted[1]).all()
    assert_allclose(found[0], wanted[0], rtol=1e-12, atol=1e-15)


def test_errors_are_mean_distances_in_own_units_and_shares_between_nodes_that_are_no_neighbours():
    scale = Scale.of_range(np.array([0.0, -5.0]), np.array([2.0, 5.0]), (False, False))
    square = network([[0, 0], [0, 1], [1, 0], [1, 1]], (2, 2), scale)
    # a fifth of the width beside the first node; a tenth of the height below the last
    x = [[0.4, -5.0], [2.0, 4.0]]
    assert square.quantization_error(x) == pytest.approx((0.4 + 1.0) / 2)
    assert square.quantization_error(square.weights) == 0.0
    # a line of four nodes folded over: nodes 0 and 3 lie side by side
    folded = network([[0.0, 0.0], [0.5, 0.0], [0.5, 0.4], [0.0, 0.1]], (4,))
    fold, middle = [0.0, 0.05], [0.3, 0.0]
    assert folded.topographic_error([fold]) == 1.0
    assert folded.topographic_error([middle]) == 0.0
    assert folded.topographic_error([fold, middle, middle, middle]) == 0.25


@given(shapes)
def test_edges_join_exactly_the_nodes_at_lattice_distance_one(shape):
    lattice = Lattice(shape)
    r = lattice.positions()
    distance = np.abs(r[:, None] - r[None]).sum(axis=2)
    expected = [[i, j] for i, j in np.argwhere(distance == 1).tolist() if i < j]
    assert sorted(lattice.edges().tolist()) == expected


@given(shapes, shapes)
def test_resampling_keeps_linear_functions_of_the_cell_middles(coarse, fine):
    if len(coarse) != len(fine):
        fine = (fine * 3)[: len(coarse)]
    slope = np.arange(1.0, len(coarse) + 1)

    def plane(lattice):
        middles = (lattice.positions() + 0.5) / lattice.shape
        return np.stack([middles @ slope, 1 - middles @ slope], axis=1)

    old, new = Lattice(coarse), Lattice(fine)
    assert_allclose(old.resample(plane(old), new), plane(new), atol=1e-12)
