"""The paper's algorithm: every equation against plain NumPy, gains, and what it reaches."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import refused
from numpy.testing import assert_allclose
from small_maps import UNIT_BOX, points

import calib
from calib.maps.density import GAINS, border, error, residual, rho
from calib.maps.lattice import Lattice
from calib.maps.links import WIRINGS
from calib.maps.vdsom import ONLINE, VDSOM, Layer, Rates, zeta

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
    printed, stable = (
        calib.SOM(10, f"vdsom:{name}", rule="online", epochs=3).fit(x)
        for name in ("printed", "rho")
    )
    assert np.ptp(printed.units, axis=0).max() < 0.02
    assert printed.quantization_error(x) > 0.3
    assert stable.quantization_error(x) < 0.06
    refused(calib.OptionError, "one sample at a time", calib.SOM(10, "vdsom:printed").fit, x)


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


def test_zeta_is_the_mean_square_distance_to_the_winner():
    nodes = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert zeta(nodes, np.array([[0.3, 0.0], [1.0, 0.9]])) == pytest.approx((0.09 + 0.01) / 2)


@pytest.mark.parametrize("side", [8, 16])
def test_a_varying_density_helps_small_lattices_too(side):
    """At one strength for all sizes it tore a lattice of 8x8, and the map was useless."""
    q = calib.babble(calib.load_arm("two_link"), 3000, seed=0).q
    plain, varying = (
        calib.SOM(side, network, rule="online", sigma=(side / 2, 1.5)).fit(q).history[-1, 2:]
        for network in ("som", "vdsom")
    )
    assert varying[0] < plain[0]  # distance to the winner
    assert varying[1] < 0.02  # topographic error


@pytest.mark.parametrize("rule", ["batch", "online"])
def test_nodes_are_denser_at_the_contour_than_a_soms(rule):
    """The figures of docs/paper.md: 2.4 times for 0.6 (online) and 1.0 (batch)."""
    q = calib.babble(calib.load_arm("two_link"), 20_000, seed=0).q
    density = {}
    for network in ("som", "vdsom"):
        options = {"epochs": 3} if rule == "online" else {}
        w = calib.SOM(30, network, rule=rule, **options).fit(q).units
        away = np.minimum(w, 1 - w).min(axis=1)
        density[network] = np.mean(away < 0.05) / 0.19 / (np.mean(away > 0.25) / 0.25)
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
    som = calib.SOM((4, 4), map=lambda visit: wrong(len(visit.winners)), rule=rule, epochs=2)
    refused(calib.OptionError, "gain returned", som.fit, X)
