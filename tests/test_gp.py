"""The Gaussian process against brute force: closed forms, likelihood, outliers, seams."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from calib.body import gp
from calib.common.scale import TURN, Scale

PLAIN = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
TURNING = Scale(np.zeros(2), np.array([TURN, 1.0]), np.array([True, False]))


@pytest.fixture(autouse=True)
def one_thread():
    """As in training, where sums must not depend on threads."""
    with threadpool_limits(1, user_api="blas"):
        yield


def points(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def bent(u):
    return np.stack([np.sin(3 * u[:, 0]) + u[:, 1], np.cos(2 * u[:, 1]) * u[:, 0]], axis=1)


def measured(n, noise, seed=0):
    u = points(n, seed)
    return u, bent(u) + np.random.default_rng(seed + 1).normal(scale=noise, size=(n, 2))


def fit(u, x, scale=PLAIN):
    return gp.fit(u, x, scale, np.random.default_rng(0))


def kernel(process, u, v, lengths=None, signal=None):
    """A linear function plus a squared exponential, written out."""
    lengths = process.lengths if lengths is None else lengths
    signal = process.signal if signal is None else signal
    square = (((u[:, None] - v[None]) / lengths) ** 2).sum(axis=2)
    return signal * np.exp(-square / 2) + 30 * (1 + (u - 0.5) @ (v - 0.5).T)


def likelihood(process, u, x, lengths, signal, noise):
    """Logarithm of the marginal likelihood of both coordinates, up to a constant."""
    y = (x - process.mean) / process.unit
    k = kernel(process, u, u, lengths, signal) + noise * np.eye(len(u))
    sign, logdet = np.linalg.slogdet(k)
    assert sign > 0
    return -0.5 * np.sum(y * np.linalg.solve(k, y)) - logdet


@pytest.fixture(scope="module")
def fitted():
    u, x = measured(60, 0.02)
    process, kept = fit(u, x)
    assert len(kept) == 60
    return u, x, process


def test_the_posterior_mean_is_the_textbooks(fitted):
    u, x, process = fitted
    fresh = points(40, seed=5)
    k = kernel(process, u, u) + process.noise * np.eye(60)
    y = (x - x.mean(axis=0)) / process.unit
    expected = x.mean(axis=0) + process.unit * kernel(process, fresh, u) @ np.linalg.solve(k, y)
    np.testing.assert_allclose(process.value(fresh), expected, atol=1e-8)


def test_the_deviation_is_the_textbooks(fitted):
    u, _, process = fitted
    fresh = points(40, seed=5)
    k = kernel(process, u, u) + process.noise * np.eye(60)
    cross = kernel(process, fresh, u)
    prior = np.diag(kernel(process, fresh, fresh))
    variance = prior + process.noise - np.sum(cross * np.linalg.solve(k, cross.T).T, axis=1)
    expected = process.unit * np.sqrt(variance)
    np.testing.assert_allclose(process.deviation(fresh), expected, rtol=1e-4)


@pytest.mark.parametrize("rows", [[7], [0, 1, 2, 3, 4], [10, 30, 50]])
def test_rows_held_out_in_closed_form_are_a_refit_without_them(fitted, rows):
    u, x, process = fitted
    rows = np.array(rows)
    others = np.setdiff1d(np.arange(60), rows)
    k = kernel(process, u[others], u[others]) + process.noise * np.eye(len(others))
    y = (x - process.mean) / process.unit
    said = kernel(process, u[rows], u[others]) @ np.linalg.solve(k, y[others])
    expected = process.unit * np.linalg.norm(y[rows] - said, axis=1)
    np.testing.assert_allclose(process.held_out(rows, x), expected, rtol=1e-5)


def test_no_step_of_any_hyperparameter_makes_the_data_likelier(fitted):
    u, x, process = fitted
    theta = np.log([*process.lengths, process.signal, process.noise])

    def at(theta):
        value = np.exp(theta)
        return likelihood(process, u, x, value[:2], value[2], value[3])

    best = at(theta)
    for k in range(4):
        for step in (-0.2, 0.2):
            assert at(theta + step * np.eye(4)[k]) < best
    h = 1e-4
    gradient = [
        (at(theta + h * np.eye(4)[k]) - at(theta - h * np.eye(4)[k])) / (2 * h) for k in range(4)
    ]
    np.testing.assert_allclose(gradient, 0.0, atol=0.1)


def test_the_noise_of_the_data_is_found():
    u, x = measured(200, 0.02, seed=3)
    process, _ = fit(u, x)
    assert process.unit * np.sqrt(process.noise) == pytest.approx(0.02, rel=0.15)


def test_exact_data_are_interpolated():
    u = points(80)
    process, _ = fit(u, bent(u))
    np.testing.assert_allclose(process.value(u), bent(u), atol=1e-4)
    fresh = 0.1 + 0.8 * points(100, seed=1)
    assert np.abs(process.value(fresh) - bent(fresh)).max() < 2e-3


def test_a_linear_function_goes_on_beyond_the_data():
    u, slope = points(40), np.array([[0.3, -1.0], [0.5, 2.0]])
    process, _ = fit(u, u @ slope)
    far = np.array([[1.5, 1.5], [-0.5, 0.5]])
    np.testing.assert_allclose(process.value(far), far @ slope, atol=1e-3)


def test_deviation_grows_away_from_the_data_and_is_the_noise_among_them():
    u, x = measured(150, 0.02, seed=3)
    process, _ = fit(0.5 * u, x)
    among, away = process.deviation(np.array([[0.25, 0.25], [1.0, 1.0]]))
    assert among == pytest.approx(0.02, rel=0.4)
    assert away > 5 * among


def test_a_length_scale_tells_which_joint_matters():
    u = points(80)
    x = np.stack([np.sin(6 * u[:, 0]), np.cos(6 * u[:, 0])], axis=1)
    process, _ = fit(u, x)
    assert process.lengths[1] > 5 * process.lengths[0]


def test_a_row_that_contradicts_its_neighbours_is_left_out():
    u, x = measured(80, 1e-3)
    x[[11, 42]] += [[0.8, -0.5], [-0.3, 0.9]]
    process, kept = fit(u, x)
    assert sorted(set(range(80)) - set(kept.tolist())) == [11, 42]
    fresh = 0.1 + 0.8 * points(100, seed=4)
    assert np.linalg.norm(process.value(fresh) - bent(fresh), axis=1).mean() < 3e-3


def test_where_half_of_the_rows_contradict_each_other_none_is_left_out():
    u = points(60)
    x = np.random.default_rng(1).normal(size=(60, 2))
    assert len(fit(u, x)[1]) == 60


def test_where_more_than_a_fifth_contradict_the_others_none_is_left_out():
    u, rng = points(60), np.random.default_rng(3)
    wrong = rng.permutation(60)[:15]
    x = bent(u)
    x[wrong] += rng.normal(size=(15, 2))
    assert len(fit(u, x)[1]) == 60


@pytest.mark.parametrize(("rows", "left_out"), [(19, []), (20, [7])])
def test_of_fewer_than_twenty_rows_none_is_left_out(rows, left_out):
    u, slope = points(rows), np.array([[0.3, -1.0], [0.5, 2.0]])
    x = u @ slope + np.random.default_rng(1).normal(scale=1e-2, size=(rows, 2))
    x[7] += [0.4, -0.4]
    kept = fit(u, x)[1]
    assert np.setdiff1d(np.arange(rows), kept).tolist() == left_out


def test_of_many_rows_some_are_drawn_without_repeats(monkeypatch):
    monkeypatch.setattr(gp, "MOST_ROWS", 60)
    u, x = measured(100, 0.02)
    process, kept = fit(u, x)
    assert len(process.u) == len(kept) == 60
    assert (np.diff(kept) > 0).all()
    assert (process.u == u[kept]).all()


def test_a_joint_that_turns_round_has_no_seam():
    u = points(80)
    angle = TURN * u[:, 0]
    x = np.stack([np.cos(angle) + 0.2 * u[:, 1], np.sin(2 * angle)], axis=1)
    # only the linear part, which the data do not need, could tell the two ends apart
    y = np.linspace(0.2, 0.8, 9)
    before, after = (np.stack([np.full(9, e), y], axis=1) for e in (1 - 1e-6, 1e-6))
    process, _ = fit(u, x, TURNING)
    np.testing.assert_allclose(process.value(before), process.value(after), atol=5e-3)
    plain, _ = fit(u, x, PLAIN)
    truth = np.stack([1 + 0.2 * y, np.zeros(9)], axis=1)
    periodic_error = np.abs(process.value(after) - truth).max()
    assert periodic_error < 5e-3
    assert periodic_error <= np.abs(plain.value(after) - truth).max()
