"""Readings of equations 7 and 8: what each gain says of hand-made maps."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import OptionError
from calib.maps.density import (
    READINGS,
    Visit,
    border,
    border_strength,
    error,
    gain_of,
    kind_of,
    rationed,
    residual,
    rho,
)
from calib.maps.graph import Graph
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


@pytest.mark.parametrize("gain", BUILT_IN, ids=lambda g: g.__name__)
def test_every_gain_is_positive_and_one_per_sample(gain):
    v = visit(1.0, winners=[0, 4, 4, 8], distances=[0.0, 0.1, 0.2, 0.0])
    g = gain(v)
    assert g.shape == (4,)
    assert (g > 0).all()
    assert np.isfinite(g).all()


def test_border_is_largest_in_the_corners_and_1_inside():
    g = border(visit(1 / 3)).reshape(3, 3)  # of a small lattice the strength is 1.5
    corner, edge = np.exp(0.75 * 5 / 8), np.exp(0.75 * 3 / 8)
    expected = [[corner, edge, corner], [edge, 1, edge], [corner, edge, corner]]
    np.testing.assert_allclose(g, expected)


def test_error_is_the_squared_distance_over_its_mean():
    g = error(visit(1.0, winners=[0, 1, 2], distances=[1.0, 2.0, 3.0]))
    np.testing.assert_allclose(g, np.array([1.0, 4.0, 9.0]) / (14 / 3), atol=1e-5)


def test_error_is_1_where_every_sample_stands_on_its_node():
    assert (error(visit(1.0, winners=[0, 1], distances=[0.0, 0.0])) == 1.0).all()


def test_a_gain_of_ones_own_has_what_eq_7_asks_for():
    """A line of three nodes with gaps of 1 and 2: sums of squares 1, 1 + 4, 4."""
    v = visit(1.0, [[0.0], [1.0], [3.0]], (3,))
    np.testing.assert_allclose(v.sums, [1.0, 5.0, 4.0])
    assert repr(v) == "Visit(3 samples of 3 nodes, t / T 1)"
    assert (v.sigma, v.per_node) == pytest.approx((np.nan, np.inf), nan_ok=True)


def test_a_gain_follows_the_winner_of_each_sample():
    per_node = border(visit(1.0))
    assert (border(visit(1.0, winners=[8, 4, 4])) == per_node[[8, 4, 4]]).all()


def test_names_find_their_gain_and_the_plain_som_has_none():
    assert gain_of("som") is None
    assert gain_of("vdsom") is gain_of("vdsom:border") is border
    assert gain_of("vdsom:residual") is residual
    assert gain_of("vdsom:error") is gain_of("gng:error") is error
    assert gain_of("dsom") is gain_of("gng") is None
    assert [kind_of(n) for n in ("som", "vdsom:error", "dsom", "gng:border", border)] == [
        "som",
        "som",
        "dsom",
        "gng",
        "som",
    ]


def test_at_the_border_of_a_graph_are_nodes_with_few_edges():
    star = Graph(5, np.array([[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [3, 4]]))
    v = Visit(1.0, np.arange(5), np.zeros(5), np.zeros((5, 2)), star)
    g = border(v)
    assert g[0] == g.min()
    assert (g[1:] >= g[0]).all()


def test_an_unknown_name_is_refused_with_the_choices():
    with pytest.raises(OptionError, match=r"'sum' is unknown, choose one of som, vdsom") as caught:
        gain_of("sum")
    assert "\n" not in str(caught.value)


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


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("per_node", [6.0, 20.0, 50.0])
def test_no_node_is_left_with_fewer_than_five_samples(per_node, dim):
    wrong = np.random.default_rng(0).exponential(size=2000) * (np.arange(2000) % 50 == 0)
    share = rationed(wrong, per_node, dim)
    dense = share ** (dim / (dim + 2))
    rows = per_node * dense.mean() / dense  # of each node, where the density follows the gain
    plain = np.clip(wrong / wrong.mean(), 0.05, 50)
    capped = share.max() < plain.max()
    assert rows.min() == pytest.approx(5.0) if capped else rows.min() > 5.0
    free = share < share.max()
    np.testing.assert_array_equal(share[free], plain[free])


def test_with_few_samples_per_node_a_residual_draws_none_and_with_many_all_it_asks_for():
    wrong = np.arange(100.0)
    np.testing.assert_array_equal(rationed(wrong, 5.0, 2), 1.0)
    plain = np.clip(wrong / wrong.mean(), 0.05, 50)
    np.testing.assert_array_equal(rationed(wrong, 1e6, 2), plain)
    np.testing.assert_array_equal(rationed(wrong, np.inf, 2), plain)


def test_the_border_weighs_less_on_a_small_lattice_and_with_few_samples_per_node():
    strengths = [border_strength(Lattice((n, n))) for n in (2, 6, 10, 20, 70, 200)]
    assert strengths == sorted(strengths)
    assert (strengths[0], strengths[-1]) == (1.5, 9.0)
    big = Lattice((70, 70))
    assert [border_strength(big, n) for n in (1, 2, 3, 4, 50)] == [4.5, 4.5, 6.75, 9.0, 9.0]
    small = visit(1.0)
    np.testing.assert_allclose(residual(small), border(small) ** (2 / 3))
