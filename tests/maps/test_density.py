"""Readings of equations 7 and 8 on hand-made maps, gains of one's own, and what none may be."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from small_maps import points

import calib
from calib import OptionError, Visit
from calib.maps.density import READINGS, border, error, residual, rho
from calib.maps.lattice import Lattice

BUILT_IN = [gain for name, gain in READINGS.items() if name != "printed"]


def visit(progress, weights=None, shape=(3, 3), winners=None, distances=None):
    grid = Lattice(shape)
    weights = grid.positions() / 2 if weights is None else np.array(weights, dtype=float)
    winners = np.arange(grid.size) if winners is None else np.array(winners)
    distances = np.full(len(winners), 0.1) if distances is None else np.array(distances)
    return Visit(progress, winners, distances, weights, grid)


@pytest.mark.parametrize("gain", BUILT_IN, ids=lambda g: g.__name__)
def test_every_gain_is_1_at_the_start_of_the_training(gain):
    rng = np.random.default_rng(0)
    start = visit(0.0, rng.random((9, 2)), distances=rng.random(9))
    np.testing.assert_allclose(gain(start), 1.0, atol=1e-12)


@pytest.mark.parametrize("gain", BUILT_IN, ids=lambda g: g.__name__)
def test_every_gain_departs_from_1_as_training_goes_on(gain):
    rng = np.random.default_rng(0)
    weights, distances = rng.random((9, 2)), rng.random(9)
    spread = [np.ptp(np.log(gain(visit(t, weights, distances=distances)))) for t in (0.3, 0.6, 1.0)]
    assert 0 < spread[0] < spread[1] < spread[2]


def test_border_is_largest_in_the_corners_and_1_inside():
    g = border(visit(1 / 3)).reshape(3, 3)  # of a small lattice the strength is 1.5
    corner, edge = np.exp(0.75 * 5 / 8), np.exp(0.75 * 3 / 8)
    expected = [[corner, edge, corner], [edge, 1, edge], [corner, edge, corner]]
    np.testing.assert_allclose(g, expected)


def test_error_is_the_squared_distance_over_its_mean():
    g = error(visit(1.0, winners=[0, 1, 2], distances=[1.0, 2.0, 3.0]))
    np.testing.assert_allclose(g, np.array([1.0, 4.0, 9.0]) / (14 / 3), atol=1e-5)


def test_rho_is_equations_7_and_8_with_a_factor():
    """1 + (t mean(rho) / (rho T))^4 over the whole lattice, by hand."""
    rng = np.random.default_rng(3)
    v = visit(0.7, rng.random((9, 2)))
    total = ((v.weights[:, None] - v.weights) ** 2).sum(axis=(1, 2))
    sparse = np.exp(-total / total.mean())
    np.testing.assert_allclose(rho(v), 1 + (0.7 * sparse.mean() / sparse) ** 4)


def test_the_default_is_the_border_times_where_a_smooth_model_is_wrong():
    plain = visit(1.0)
    wrong = np.array([0.0, 0, 0, 0, 4.0, 0, 0, 0, 5.0])
    told = replace(plain, residual=wrong)
    np.testing.assert_allclose(residual(plain), border(plain) ** (2 / 3))
    share = np.clip(wrong / wrong.mean(), 0.05, 50)
    np.testing.assert_allclose(residual(told), border(plain) ** (2 / 3) * share)
    np.testing.assert_allclose(residual(replace(told, progress=0.0)), 1.0)


X = points(600)


def test_a_gain_draws_nodes():
    def right(visit: calib.Visit):
        assert visit.weights.shape == (64, 2)
        return 1.0 + 20.0 * visit.progress * (visit.weights[visit.winners, 0] > 0.7)

    drawn = calib.SOM((8, 8), map=right).fit(X)
    plain = calib.SOM((8, 8), map="som").fit(X)
    assert (drawn.units[:, 0] > 0.7).sum() > 1.3 * (plain.units[:, 0] > 0.7).sum()


WRONG = {
    "shape": lambda n: np.ones(n + 1),
    "a scalar": lambda n: 1.0,
    "negative": lambda n: np.where(np.arange(n) == 3, -1.0, 1.0),
    "nan": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
    "zeros": np.zeros,
    "text": lambda n: "gain",
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("rule", ["batch", "online"])
def test_a_gain_that_makes_no_sense_is_an_error(wrong, rule):
    som = calib.SOM((4, 4), map=lambda visit: wrong(len(visit.winners)), rule=rule, epochs=2)
    refused(OptionError, "gain returned", som.fit, X)
