"""The trend: its terms, their orthogonality and slopes, and what it fits exactly."""

import itertools
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from calib.body.basis import Basis, exponents, largest_degree, largest_harmonic
from calib.body.trend import Trend
from calib.body.trend_choice import choose_trends
from calib.common.scale import TURN, Scale
from calib.maps.model_selection import blocks

SPAN = (np.pi / 2, 2.3)  # of two joints [rad]


def points(n, d=2, seed=0):
    return np.random.default_rng(seed).random((n, d))


def two_link(u, span=SPAN, start=(0.1, 0.26)):
    """Closed form of a 2R arm on the unit box of its joints."""
    a, b = (np.array(start) + u * span).T
    x = 0.3 * np.cos(a) + 0.25 * np.cos(a + b)
    return np.stack([x, 0.3 * np.sin(a) + 0.25 * np.sin(a + b)], axis=1)


def scale_of(span, revolute):
    return Scale.of_range(np.zeros(len(span)), np.array(span), revolute)


def random_trend(basis, seed=0):
    rng = np.random.default_rng(seed)
    return Trend(basis, rng.normal(size=(len(basis.orders), 2 + seed % 2)))


bases = st.builds(
    Basis,
    st.lists(st.sampled_from([0.0, 1.5, 3.0, TURN]), min_size=1, max_size=3).map(tuple),
    st.integers(1, 4),
    st.integers(0, 2),
)


@given(st.integers(1, 4), st.integers(0, 5))
def test_exponents_are_all_of_a_total_degree_once_lowest_first(dim, degree):
    rows = exponents(dim, degree)
    expected = [e for e in itertools.product(range(degree + 1), repeat=dim) if sum(e) <= degree]
    assert sorted(map(tuple, rows.tolist())) == sorted(expected)
    assert len(rows) == comb(dim + degree, dim)
    assert (np.diff(rows.sum(axis=1)) >= 0).all()


@given(st.integers(1, 4), st.integers(1, 500))
def test_largest_degree_needs_at_most_so_many_terms_and_the_next_more(dim, terms):
    degree = largest_degree(dim, terms)
    assert comb(dim + degree, dim) <= terms < comb(dim + degree + 1, dim)


def test_terms_of_polynomials_harmonics_and_both():
    assert [Basis((0.0, 0.0), 4).terms(k) for k in range(5)] == [1, 3, 6, 10, 15]
    # 1, cos, sin of each, then cos 2, sin 2 of each and four products
    assert [Basis((2.0, 2.0), 2).terms(k) for k in range(3)] == [1, 5, 13]
    # 1; cos, sin, slide; cos 2, sin 2, slide cos, slide sin, slide^2
    assert [Basis((2.0, 0.0), 2).terms(k) for k in range(3)] == [1, 4, 9]


def test_affine_in_each_joint_is_all_products_of_first_harmonics():
    basis = Basis((2.0, 2.0, 2.0), 3, each=1)
    assert [basis.terms(k) for k in range(4)] == [1, 7, 19, 27]
    assert basis.orders.max() == 2


@given(bases)
def test_terms_of_a_lower_degree_are_the_first_of_a_higher(basis):
    u = points(7, len(basis.turns))
    lower = Basis(basis.turns, max(1, basis.degree - 1), basis.each)
    count = basis.terms(lower.degree)
    assert count == len(lower.orders)
    assert (basis.orders[:count] == lower.orders).all()
    np.testing.assert_allclose(basis.values(u)[:, :count], lower.values(u), atol=1e-9)


@pytest.mark.parametrize("turn", [1.5, 3.0, TURN])
def test_harmonics_are_orthonormal_over_their_range(turn):
    grid = (np.arange(2000)[:, None] + 0.5) / 2000
    value = Basis((turn,), 3).values(grid)
    np.testing.assert_allclose(value.T @ value / 2000, np.eye(7), atol=1e-3)


def test_polynomials_are_orthogonal_over_the_unit_interval():
    node, weight = np.polynomial.legendre.leggauss(8)
    value = Basis((0.0,), 5).values((node[:, None] + 1) / 2)
    gram = value.T @ (weight[:, None] / 2 * value)
    np.testing.assert_allclose(gram, np.diag(1 / (2 * np.arange(6) + 1.0)), atol=1e-12)


@given(bases, st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_slopes_agree_with_finite_differences(basis, seed):
    d = len(basis.turns)
    trend = random_trend(basis, seed)
    u, h = 0.05 + 0.9 * points(5, d, seed), 1e-5
    slope = trend.value_and_slope(u)[1]
    assert slope.shape == (5, trend.outputs, d)
    size = np.abs(trend.basis.values(u)).max() * len(basis.orders)
    for k in range(d):
        step = h * np.eye(d)[k]
        difference = (trend.value(u + step) - trend.value(u - step)) / (2 * h)
        np.testing.assert_allclose(slope[:, :, k], difference, atol=1e-6 * size)


@given(bases, st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_a_trend_is_the_weighted_sum_of_its_terms(basis, seed):
    trend, u = random_trend(basis, seed), points(5, len(basis.turns), seed)
    terms = basis.values(u)
    size = np.abs(terms).max() * len(basis.orders)
    np.testing.assert_allclose(trend.value(u), terms @ trend.coefficients, atol=1e-10 * size)


def test_a_value_with_its_slope_is_the_value_alone():
    trend, u = random_trend(Basis((2.0, 0.0), 3)), points(5)
    np.testing.assert_allclose(trend.value_and_slope(u)[0], trend.value(u), atol=1e-12)


def test_harmonics_of_a_whole_turn_join_at_its_seam():
    trend = random_trend(Basis((TURN,), 4))
    value, slope = trend.value_and_slope(np.array([[0.0], [1.0]]))
    np.testing.assert_allclose(value[0], value[1], atol=1e-12)
    np.testing.assert_allclose(slope[0], slope[1], atol=1e-10)


def test_second_harmonics_hold_the_kinematics_of_two_revolute_joints():
    u = points(300)
    value = Basis(SPAN, 2).values(u)
    coefficients = np.linalg.lstsq(value, two_link(u), rcond=None)[0]
    fresh = points(200, seed=1)
    said = Trend(Basis(SPAN, 2), coefficients).value(fresh)
    np.testing.assert_allclose(said, two_link(fresh), atol=1e-12)


def test_first_harmonics_do_not():
    u = points(300)
    value = Basis(SPAN, 1).values(u)
    coefficients = np.linalg.lstsq(value, two_link(u), rcond=None)[0]
    assert np.abs(value @ coefficients - two_link(u)).max() > 1e-3


def test_a_small_angle_allows_few_harmonics_and_a_turn_many():
    assert 1 <= largest_harmonic(0.3) < largest_harmonic(1.5) < largest_harmonic(TURN)


def test_on_exact_kinematics_the_second_harmonics_are_chosen_and_all_but_exact():
    u = points(500)
    x = two_link(u)
    first = choose_trends(scale_of(SPAN, (True, True)), (True, True), u, x, blocks(500))[0]
    assert first.trend.basis.turns == SPAN
    assert first.trend.basis.degree == 2
    fresh = points(500, seed=1)
    assert np.abs(first.trend.value(fresh) - two_link(fresh)).max() < 1e-8


def test_a_joint_that_slides_gets_polynomials():
    u = points(500)
    x = np.stack([u[:, 0] ** 2, u[:, 1] - u[:, 0] * u[:, 1]], axis=1)
    chosen = choose_trends(scale_of((0.2, 0.3), (False, False)), (False, False), u, x, blocks(500))
    assert chosen[0].trend.basis.turns == (0.0, 0.0)
    assert chosen[0].trend.basis.degree == 2
    fresh = points(200, seed=1)
    truth = np.stack([fresh[:, 0] ** 2, fresh[:, 1] - fresh[:, 0] * fresh[:, 1]], axis=1)
    assert np.abs(chosen[0].trend.value(fresh) - truth).max() < 1e-8


def test_a_trend_without_a_fold_has_not_seen_it():
    u = points(60)
    x = two_link(u)
    folds = blocks(60, 5)
    spoilt = x.copy()
    spoilt[folds[2]] += 5.0
    scale = scale_of(SPAN, (True, True))
    first, wrong = (
        choose_trends(scale, (True, True), u, y, folds)[0].without[2] for y in (x, spoilt)
    )
    if wrong.basis == first.basis:
        np.testing.assert_allclose(wrong.value(u), first.value(u), atol=1e-8)
    assert np.abs(first.value(u[folds[2]]) - x[folds[2]]).max() < 1e-6


def test_noise_does_not_make_the_trend_wilder_than_the_arm():
    u = points(400)
    x = two_link(u) + np.random.default_rng(1).normal(scale=3e-3, size=(400, 2))
    choices = choose_trends(scale_of(SPAN, (True, True)), (True, True), u, x, blocks(400))
    for choice in choices:
        assert len(choice.trend.coefficients) <= 30
        assert np.linalg.norm(choice.trend.value(u) - two_link(u), axis=1).mean() < 1.5e-3


def test_plain_functions_are_harmonics_of_the_angle_from_the_middle_and_legendre_polynomials():
    u = np.array([[0.5, 0.5], [0.75, 1.0], [0.1, 0.0]])
    turned, slid = Basis((2.0, 0.0), 3).plain(u)
    angle = 2.0 * (u[:, 0] - 0.5)
    rows = [np.ones(3)]
    for k in (1, 2, 3):
        rows += [np.cos(k * angle), np.sin(k * angle)]
    np.testing.assert_allclose(turned, rows, atol=1e-15)
    z = 2 * u[:, 1] - 1
    expected = [np.ones(3), z, (3 * z**2 - 1) / 2, (5 * z**3 - 3 * z) / 2]
    np.testing.assert_allclose(slid, expected, atol=1e-15)


def chain(u, span, links):
    angle = np.cumsum(u * span, axis=1)
    return np.stack([np.cos(angle) @ links, np.sin(angle) @ links], axis=1)


@pytest.mark.parametrize("dof", [4, 6])
def test_many_joints_are_a_chain_of_rigid_links_affine_in_each(dof):
    """Four joints have 81 such functions, six 729: of those only some rows are looked at."""
    span, links = np.full(dof, 1.7), np.linspace(0.3, 0.1, dof)
    rng = np.random.default_rng(0)
    u, turning = rng.random((3000, dof)), (True,) * dof
    with threadpool_limits(1, user_api="blas"):
        folds = blocks(3000)
        chosen = choose_trends(scale_of(span, turning), turning, u, chain(u, span, links), folds)
    trend = chosen[-1].trend
    assert (trend.basis.each, trend.basis.degree, trend.terms) == (1, dof, 3**dof)
    fresh = rng.random((200, dof))
    assert np.abs(trend.value(fresh) - chain(fresh, span, links)).max() < 1e-6
    assert len(chosen[-1].without) == 10


def test_the_first_choice_is_the_simplest_that_is_nearly_as_good():
    u = points(400)
    x = two_link(u) + np.random.default_rng(2).normal(scale=1e-3, size=(400, 2))
    choices = choose_trends(scale_of(SPAN, (True, True)), (True, True), u, x, blocks(400))
    assert [c.trend.terms for c in choices] == sorted(c.trend.terms for c in choices)
    errors = []
    for choice in choices:
        held = [
            np.linalg.norm(x[rows] - without.value(u[rows]), axis=1).mean()
            for rows, without in zip(blocks(400), choice.without, strict=True)
        ]
        errors.append(np.mean(held))
    assert errors[0] <= 1.6 * errors[-1]


def test_a_joint_that_turns_round_may_have_harmonics_of_the_whole_turn_alone():
    span = (TURN, 2.3)
    u = points(600)
    x = two_link(u, span)
    scale = scale_of(span, (True, True))
    assert scale.periodic.tolist() == [True, False]
    chosen = choose_trends(scale, (True, True), u, x, blocks(600))[0].trend
    assert chosen.basis.turns == span
    left, right = np.array([[0.0, 0.4]]), np.array([[1.0, 0.4]])
    np.testing.assert_allclose(chosen.value(left), chosen.value(right), atol=1e-9)


def test_too_few_rows_for_many_functions_still_get_a_trend():
    u = points(10)
    x = np.stack([u[:, 0] + 2 * u[:, 1], 1 - u[:, 1]], axis=1)
    chosen = choose_trends(scale_of((1.0, 1.0), (False, False)), (False, False), u, x, blocks(10))
    assert chosen[0].trend.basis.degree == 1
    np.testing.assert_allclose(chosen[0].trend.value(u), x, atol=1e-6)


def test_many_points_are_answered_as_few_are():
    trend, u = random_trend(Basis((0.0, 2.0), 2)), points(40_000)
    few = np.concatenate([trend.value(part) for part in np.array_split(u, 40)])
    np.testing.assert_allclose(trend.value(u), few, rtol=1e-12)
