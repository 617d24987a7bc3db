"""Maps: trained by every equation of the paper and by other rules; nearest nodes, errors."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import refused
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from small_maps import UNIT_BOX, box, network, points

import calib
from calib import SOM, LogError
from calib.common.scale import Scale
from calib.maps.density import GAINS, border, error, residual, rho
from calib.maps.lattice import Lattice
from calib.maps.links import WIRINGS
from calib.maps.vdsom import ONLINE, VDSOM, Layer, Rates, zeta

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
    if name == "gng":  # it grows to its size
        assert 95 <= som.size <= 100
        assert som.history[0, 0] < som.history[-1, 0]


def test_history_ends_with_the_errors_of_the_map():
    x = points(300)
    som = SOM((8, 8), "som", epochs=100, sigma=(0.5, 0.5)).fit(x, scale=UNIT_BOX)
    assert_allclose(som.history[-1, 2:], [som.quantization_error(x), som.topographic_error(x)])


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
    assert square.quantization_error([[0.4, -5.0], [2.0, 4.0]]) == pytest.approx((0.4 + 1.0) / 2)
    assert square.quantization_error(square.weights) == 0.0
    # a line of four nodes folded over: nodes 0 and 3 lie side by side
    folded = network([[0.0, 0.0], [0.5, 0.0], [0.5, 0.4], [0.0, 0.1]], (4,))
    fold, middle = [0.0, 0.05], [0.3, 0.0]
    assert folded.topographic_error([fold]) == 1.0
    assert folded.topographic_error([middle]) == 0.0
    assert folded.topographic_error([fold, middle, middle, middle]) == 0.25
    nodes = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert zeta(nodes, np.array([[0.3, 0.0], [1.0, 0.9]])) == pytest.approx((0.09 + 0.01) / 2)


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


X = points(600)
WRONG = {
    "shape": lambda n: np.ones(n + 1),
    "a scalar": lambda n: 1.0,
    "negative": lambda n: np.where(np.arange(n) == 3, -1.0, 1.0),
    "nan": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
    "zeros": np.zeros,
    "text": lambda n: "gain",
}


def rates(n, sigma, alpha, maps=1, eta=0.13, beta=1.0):
    progress = np.linspace(0.1, 1.0, n)
    return Rates((sigma,) * maps, alpha, progress, np.full(n, eta), np.full(n, beta))


@pytest.mark.parametrize("shape", [(9,), (7, 8), (4, 5, 3)])
def test_a_step_is_eq_1_to_3(shape):
    rng, lattice = np.random.default_rng(0), Lattice(shape)
    w, x, r = rng.random((lattice.size, 2)), rng.random((5, 2)), lattice.positions()
    sigma, alpha = np.linspace(3.0, 2.0, 5), np.linspace(0.9, 0.5, 5)
    wanted, distances = w.copy(), []
    for sample, s, a in zip(x, sigma, alpha, strict=True):
        away = np.linalg.norm(wanted - sample, axis=1)
        winner = away.argmin()  # eq. 1
        distances.append(away[winner])
        h = np.exp(-np.sum((r - r[winner]) ** 2, axis=1) / (2 * s**2))  # eq. 3
        wanted += a * h[:, None] * (sample - wanted)  # eq. 2
    net = VDSOM([Layer(w, lattice, UNIT_BOX)])
    (found,) = net.show([x], rates(5, sigma, alpha))
    assert_allclose(net.layers[0].weights, wanted, atol=5 * np.exp(-8.0))
    assert_allclose(found, distances, atol=5 * np.exp(-8.0))


def test_sigma_and_alpha_fall_as_eq_4_says():
    told = Rates.training(np.arange(100), (8.0, 0.5), 100, 2)
    T = 99 / np.log(8.0 / 0.5)  # the time constant at which it ends at half a node
    assert_allclose(told.sigma[0], 8.0 * np.exp(-np.arange(100) / T))
    assert_allclose(told.alpha, 0.5 * np.exp(-np.arange(100) / T))


def test_eq_7_and_8_as_printed_step_by_step():
    lattice, sigma, alpha = Lattice((4, 5)), 1.5, 0.4
    rng = np.random.default_rng(3)
    w, x = 0.3 * rng.random((20, 2)), rng.random((4, 2))
    net = VDSOM([Layer(w, lattice, UNIT_BOX, GAINS["printed"])])
    told = rates(4, np.full(4, sigma), np.full(4, alpha))
    net.show([x], told)
    r = lattice.positions()
    for sample, t in zip(x, told.progress, strict=True):
        winner = np.linalg.norm(w - sample, axis=1).argmin()
        beside = np.abs(r - r[winner]).max(axis=1) == 1  # O, diagonals included
        rho = np.exp(-np.sum((w[winner] - w[beside]) ** 2))  # eq. 7
        h = (t / rho) ** 4 * np.exp(-t / sigma**2)  # eq. 8
        w = w + min(alpha * h, 1.0) * (sample - w)
    assert_allclose(net.layers[0].weights, w, atol=1e-12)


def test_eq_8_as_printed_gathers_all_nodes_in_one_place_and_only_online():
    x = np.random.default_rng(0).random((2000, 2))
    maps = (SOM(10, f"vdsom:{name}", rule="online", epochs=3) for name in ("printed", "rho"))
    printed, stable = (each.fit(x) for each in maps)
    assert np.ptp(printed.units, axis=0).max() < 0.02
    assert printed.quantization_error(x) > 0.3
    assert stable.quantization_error(x) < 0.06
    refused(calib.OptionError, "one sample at a time", SOM(10, "vdsom:printed").fit, x)


@pytest.mark.parametrize("beta", [1.0, 0.25])
def test_links_are_those_of_eq_5_and_11_step_by_step(beta):
    rng = np.random.default_rng(2)
    samples = [rng.random((ONLINE.chunk + 30, 2)) for _ in range(2)]
    c, eta, n = rng.random((3, 3)), 0.4, len(samples[0])
    layer = Layer(np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]), Lattice((3,)), UNIT_BOX)
    net = VDSOM([layer, layer], WIRINGS["oja"], c)
    activities = (WIRINGS["oja"].activity(layer.map, x).toarray() for x in samples)
    for i, j in zip(*activities, strict=True):
        c = c + eta * (np.outer(i, j) - beta * c * j**2)
    none = np.zeros(n)
    net.show(samples, rates(n, none + 1, none, 2, eta, beta))
    assert_allclose(net.links, c, rtol=2e-3)


@pytest.mark.parametrize("side", [8, 16])
def test_a_varying_density_helps_small_lattices_too(side):
    """At one strength for all sizes it tore a lattice of 8x8, and the map was useless."""
    q = calib.babble(calib.load_arm("two_link"), 3000, seed=0).q
    maps = (SOM(side, name, rule="online", sigma=(side / 2, 1.5)) for name in ("som", "vdsom"))
    plain, varying = (each.fit(q).history[-1, 2:] for each in maps)
    assert varying[0] < plain[0]  # distance to the winner
    assert varying[1] < 0.02  # topographic error


@pytest.mark.parametrize("rule", ["batch", "online"])
def test_nodes_are_denser_at_the_contour_than_a_soms(rule):
    """The figures of docs/paper.md: 2.4 times for 0.6 (online) and 1.0 (batch)."""
    q = calib.babble(calib.load_arm("two_link"), 20_000, seed=0).q
    density = {}
    for name in ("som", "vdsom"):
        options = {"epochs": 3} if rule == "online" else {}
        w = SOM(30, name, rule=rule, **options).fit(q).units
        away = np.minimum(w, 1 - w).min(axis=1)
        density[name] = np.mean(away < 0.05) / 0.19 / (np.mean(away > 0.25) / 0.25)
    assert 2.2 < density["vdsom"] < 2.6
    assert 0.5 < density["som"] < 1.1


def visit(progress, **values):
    grid = Lattice((3, 3))
    plain = calib.Visit(progress, np.arange(9), np.full(9, 0.1), grid.positions() / 2, grid)
    return replace(plain, **{name: np.array(value) for name, value in values.items()})


def test_gains_are_1_at_the_start_of_the_training_and_then_those_by_hand():
    rng = np.random.default_rng(0)
    start = visit(0.0, weights=rng.random((9, 2)), distances=rng.random(9))
    for name in {*GAINS} - {"printed"}:
        assert_allclose(GAINS[name](start), 1.0, atol=1e-12)
    # of a small lattice the strength of the border is 1.5
    corner, edge = np.exp(0.75 * 5 / 8), np.exp(0.75 * 3 / 8)
    expected = [[corner, edge, corner], [edge, 1, edge], [corner, edge, corner]]
    assert_allclose(border(visit(1 / 3)).reshape(3, 3), expected)
    # the squared distance over its mean
    g = error(visit(1.0, winners=[0, 1, 2], distances=[1.0, 2.0, 3.0]))
    assert_allclose(g, np.array([1.0, 4.0, 9.0]) / (14 / 3), atol=1e-5)
    # equations 7 and 8 over the whole lattice, with a factor: 1 + (t mean(rho) / (rho T))^4
    v = visit(0.7, weights=points(9, seed=3))
    total = ((v.weights[:, None] - v.weights) ** 2).sum(axis=(1, 2))
    sparse = np.exp(-total / total.mean())
    assert_allclose(rho(v), 1 + (0.7 * sparse.mean() / sparse) ** 4)
    # the default: the border times where a smooth model is wrong
    plain = visit(1.0)
    wrong = np.array([0.0, 0, 0, 0, 4.0, 0, 0, 0, 5.0])
    told = visit(1.0, residual=wrong)
    assert_allclose(residual(plain), border(plain) ** (2 / 3))
    share = np.clip(wrong / wrong.mean(), 0.05, 50)
    assert_allclose(residual(told), border(plain) ** (2 / 3) * share)
    assert_allclose(residual(replace(told, progress=0.0)), 1.0)


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_gain_that_makes_no_sense_is_an_error(wrong, rule):
    som = SOM((4, 4), map=lambda visit: wrong(len(visit.winners)), rule=rule, epochs=2)
    refused(calib.OptionError, "gain returned", som.fit, X)
