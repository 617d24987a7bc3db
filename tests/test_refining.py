"""Refining a trend by all rows of a long log: sums of pieces that are least squares of all."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.body import trend_refinement as refining
from calib.body.basis import Basis
from calib.body.trend import Trend
from calib.body.trend_refinement import refine
from calib.common.scale import Scale

UNIT = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))


def noisy(n, seed, noise=1e-2):
    """Joints in the unit square, and a function of the basis with noise."""
    rng = np.random.default_rng(seed)
    basis = Basis((0.0, 0.0), 2)
    truth = Trend(basis, np.random.default_rng(0).standard_normal((len(basis.orders), 2)))
    u = rng.random((n, 2))
    return truth, u, truth.value(u) + noise * rng.standard_normal((n, 2))


def in_parts(u, x, length):
    return [(u[i : i + length], x[i : i + length]) for i in range(0, len(u), length)]


def least_squares(trend, u, x):
    return np.linalg.lstsq(trend.basis.values(u), x, rcond=None)[0]


def test_a_refined_trend_is_the_least_squares_fit_to_all_rows():
    truth, u, x = noisy(9000, 1)
    start = replace(truth, coefficients=truth.coefficients + 1e-2)
    found = refine(start, UNIT, [(u[:10], x[:10]), (u[10:], x[10:])], np.inf)
    np.testing.assert_allclose(found.trend.coefficients, least_squares(truth, u, x), atol=1e-9)
    assert (found.rows, found.left_out) == (9000, 0)


@pytest.mark.parametrize("rows", [300, 4096, 8192, 8200])
@pytest.mark.parametrize("length", [77, 4096, 5000])
def test_how_the_rows_are_parted_makes_no_difference(rows, length):
    truth, u, x = noisy(rows, 1)
    parted = refine(truth, UNIT, in_parts(u, x, length), np.inf)
    whole = refine(truth, UNIT, [(u, x)], np.inf)
    assert parted.rows == rows
    np.testing.assert_array_equal(parted.trend.coefficients, whole.trend.coefficients)
    np.testing.assert_allclose(whole.trend.coefficients, least_squares(truth, u, x), atol=1e-9)


def test_joints_are_told_in_their_own_units():
    truth, u, x = noisy(500, 4)
    scale = Scale(np.array([-1.0, 0.2]), np.array([2.5, 0.3]), np.zeros(2, dtype=bool))
    found = refine(truth, scale, [(scale.from_unit(u), x)], np.inf)
    np.testing.assert_allclose(found.trend.coefficients, least_squares(truth, u, x), atol=1e-8)


def test_rows_that_are_far_off_do_not_refine():
    truth, u, x = noisy(5000, 2, 0.0)
    x[::50] += 3.0
    found = refine(truth, UNIT, [(u, x)], 1.0)
    assert (found.rows, found.left_out) == (4900, 100)
    np.testing.assert_allclose(found.trend.coefficients, truth.coefficients, atol=1e-12)


def test_the_fit_is_to_the_rows_within_the_limit_of_the_trend_that_was_given():
    truth, u, x = noisy(6000, 5, 0.1)
    good = np.linalg.norm(x - truth.value(u), axis=1) <= 0.12
    assert 1000 < np.count_nonzero(good) < 5000
    found = refine(truth, UNIT, in_parts(u, x, 700), 0.12)
    assert (found.rows, found.left_out) == (np.count_nonzero(good), np.count_nonzero(~good))
    expected = least_squares(truth, u[good], x[good])
    np.testing.assert_allclose(found.trend.coefficients, expected, atol=1e-9)


def test_without_a_row_to_believe_the_trend_stays_itself():
    truth, u, x = noisy(5000, 2, 0.0)
    none = refine(truth, UNIT, [(u, x + 9.0)], 1.0)
    assert none.trend is truth
    assert (none.rows, none.left_out) == (0, 5000)
    for empty in ([], [(u[:0], x[:0])]):
        assert refine(truth, UNIT, empty, 1.0) == refining.Refined(truth, 0, 0)


def test_what_no_row_tells_stays_as_it_was():
    truth, u, _ = noisy(5000, 3)
    u[:, 1] = 0.3
    found = refine(truth, UNIT, [(u, truth.value(u) + 0.1)], np.inf)
    np.testing.assert_allclose(found.trend.value(u), truth.value(u) + 0.1, atol=1e-6)
    assert np.abs(found.trend.coefficients).max() < 10


@given(st.lists(st.integers(0, 20), max_size=12), st.integers(1, 15))
def test_pieces_are_all_rows_in_order_and_of_one_length_but_for_the_last(lengths, size):
    rows = np.arange(sum(lengths))
    ends = np.cumsum(lengths)
    batches = [
        (rows[e - n : e, None], -rows[e - n : e, None]) for e, n in zip(ends, lengths, strict=True)
    ]
    pieces = list(refining._pieces(batches, size))
    assert [len(q) for q, _ in pieces[:-1]] == [size] * (len(pieces) - 1)
    assert all(0 < len(q) <= size for q, _ in pieces)
    assert [k for q, _ in pieces for k in q[:, 0]] == rows.tolist()
    assert all((x == -q).all() for q, x in pieces)
