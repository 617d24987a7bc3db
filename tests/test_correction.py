"""The pure parts of adaptation: smooth corrections, trust, the radius to start again from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, model
from threadpoolctl import threadpool_limits

import calib
from calib.change.correction import Correction, choose_correction
from calib.change.features import Chain, Frame
from calib.change.radius import matching_sigma
from calib.change.rehearsal import imagine, options_of
from calib.change.smooth_correction import _held_out, fit_smooth
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.model_selection import blocks


@pytest.fixture(autouse=True)
def _one_thread():
    """Threads of a BLAS would wait for each other on matrices as small as these."""
    with threadpool_limits(1, user_api="blas"):
        yield


BOX = Scale(np.array([0.0, 0.2]), np.array([1.5, 2.3]), np.zeros(2, dtype=bool))
LINKS = Chain(BOX, (1, 1))
TURN = np.array([[0.98, -0.2], [0.2, 0.98]])


def old(u):
    """Two links of 0.30 and 0.25 m."""
    q = BOX.from_unit(u)
    angle = q[:, 0] + q[:, 1]
    return np.stack(
        [
            0.30 * np.cos(q[:, 0]) + 0.25 * np.cos(angle),
            0.30 * np.sin(q[:, 0]) + 0.25 * np.sin(angle),
        ],
        axis=1,
    )


def longer(u):
    """The same with a second link of 0.30 m."""
    angle = BOX.from_unit(u).sum(axis=1)
    return old(u) + 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def moved(u):
    return old(u) @ TURN.T + [0.03, -0.01]


def bent(u):
    x = old(u)
    return x + 0.1 * np.stack([x[:, 0] * x[:, 1], x[:, 0] ** 2], axis=1)


def points(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def noise(n, size=1e-3):
    return size * np.random.default_rng(9).standard_normal((n, 2))


def fitted(truth, u, degree=None, chain=None, extra=0.0, folds=None):
    frame = None if degree is None else Frame.of(old(u), degree)
    return fit_smooth(old, frame, chain, u, truth(u) + extra, folds or blocks(len(u)))


# --- smooth -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("truth", "degree", "chain", "name", "terms"),
    [
        (old, None, None, "nothing", 0),
        (moved, 1, None, "sensor frame", 3),
        (longer, None, LINKS, "links", 5),
        (lambda u: longer(u) @ TURN.T + 0.1, 1, LINKS, "sensor frame and links", 8),
        (bent, 2, None, "sensor frame bent (degree 2)", 6),
    ],
)
def test_what_can_explain_a_change_explains_it_everywhere(truth, degree, chain, name, terms):
    u, fresh = points(60), points(200, 1)
    smooth = fitted(truth, u, degree, chain)
    assert (smooth.name, smooth.terms) == (name, terms)
    np.testing.assert_allclose(smooth.value(fresh), truth(fresh), atol=1e-9)
    assert smooth.errors.max() < 1e-9
    assert smooth.noise < 1e-10
    assert smooth.shift == pytest.approx(
        np.sqrt(np.mean(np.sum((truth(u) - old(u)) ** 2, axis=1))), abs=1e-12
    )


def test_a_correction_of_nothing_is_the_old_map_without_doubt():
    u = points(30)
    smooth = fitted(moved, u)
    np.testing.assert_array_equal(smooth.value(u), old(u))
    np.testing.assert_array_equal(smooth.doubt(u), np.zeros(30))
    np.testing.assert_array_equal(smooth.leverage, np.zeros(30))
    np.testing.assert_allclose(smooth.errors, np.linalg.norm(moved(u) - old(u), axis=1))
    left = moved(u) - old(u)
    assert smooth.noise == pytest.approx(np.sqrt(np.sum(left**2) / 60))
    assert smooth.shift == 0.0


@pytest.mark.parametrize(
    ("truth", "degree", "chain"), [(moved, 1, None), (longer, None, LINKS), (bent, 2, None)]
)
def test_noise_and_doubt_are_those_of_linear_regression(truth, degree, chain):
    u, fresh = points(50), points(20, 1)
    smooth = fitted(truth, u, degree, chain, noise(50))
    part = smooth.frame if chain is None else chain
    features, new = (part.values(v if chain is not None else old(v)) for v in (u, fresh))
    target = truth(u) + noise(50) - (0.0 if chain is None else old(u))
    left = target - features @ np.linalg.lstsq(features, target, rcond=None)[0]
    rank = np.linalg.matrix_rank(features)
    assert smooth.noise == pytest.approx(np.sqrt(np.sum(left**2) / (2 * (50 - rank))))
    inverse = np.linalg.pinv(features.T @ features, rcond=1e-9, hermitian=True)
    power = np.sum((new @ inverse) * new, axis=1)
    np.testing.assert_allclose(smooth.doubt(fresh), smooth.noise * np.sqrt(power), rtol=1e-5)
    hat = features @ inverse @ features.T
    np.testing.assert_allclose(smooth.leverage, np.diag(hat), atol=1e-6)
    assert smooth.leverage.sum() == pytest.approx(rank)


def test_a_doubtful_correction_shrinks_towards_the_old_map():
    u = 0.2 * points(12)
    smooth = fitted(moved, u, 2, extra=noise(12, 0.02))
    far = np.array([[0.9, 0.9], [0.1, 0.1]])
    doubt = smooth.doubt(far)[:, None]
    assert doubt[0] > 3 * doubt[1]
    full = smooth.frame.values(old(far)) @ smooth.moved
    keep = smooth.shift**2 / (smooth.shift**2 + 2 * doubt**2)
    np.testing.assert_allclose(smooth.value(far), old(far) + keep * (full - old(far)), rtol=1e-12)
    assert keep[0] < 0.5


@pytest.mark.parametrize("truth", [moved, bent])
@pytest.mark.parametrize("degree", [1, 2])
def test_errors_are_those_of_a_fit_that_has_not_seen_the_fold(truth, degree):
    u, x = points(40), truth(points(40)) + noise(40)
    folds = blocks(40)
    frame = Frame.of(old(u), degree)
    features = frame.values(old(u))
    expected = np.empty(40)
    for rows in folds:
        rest = np.setdiff1d(np.arange(40), rows)
        weights = np.linalg.lstsq(features[rest], x[rest], rcond=None)[0]
        expected[rows] = np.linalg.norm(x[rows] - features[rows] @ weights, axis=1)
    np.testing.assert_allclose(
        fit_smooth(old, frame, None, u, x, folds).errors, expected, rtol=1e-6
    )


def test_errors_of_links_are_those_of_a_fit_that_has_not_seen_the_fold():
    u, x = points(40), longer(points(40)) + noise(40)
    features, expected = LINKS.values(u), np.empty(40)
    for rows in blocks(40):
        rest = np.setdiff1d(np.arange(40), rows)
        weights = np.linalg.lstsq(features[rest], (x - old(u))[rest], rcond=None)[0]
        expected[rows] = np.linalg.norm((x - old(u))[rows] - features[rows] @ weights, axis=1)
    said = fit_smooth(old, None, LINKS, u, x, blocks(40)).errors
    np.testing.assert_allclose(said, expected, rtol=1e-6)


def test_the_units_of_the_functions_do_not_change_what_is_held_out():
    u = points(40)
    features, x = Frame.of(old(u), 2).values(old(u)), moved(u) + noise(40)
    errors, leverage = _held_out(features, x, blocks(40))
    units = np.array([1.0, 1e-12, 1e9, 1.0, 1e5, 1e-3])
    same, power = _held_out(features * units, x, blocks(40))
    np.testing.assert_allclose(same, errors, atol=1e-12)
    np.testing.assert_allclose(power, leverage, atol=1e-9)
    # a function that is zero everywhere tells nothing
    more, power = _held_out(np.column_stack([features, np.zeros(40)]), x, blocks(40))
    np.testing.assert_allclose(more, errors, atol=1e-12)
    np.testing.assert_allclose(power, leverage, atol=1e-9)


def test_a_row_that_alone_tells_a_coefficient_has_no_prediction_but_the_old_one():
    u = np.concatenate([np.full((5, 2), 0.5), [[0.9, 0.1]]])
    x = old(u)
    frame = Frame.of(x, 1)
    said = fit_smooth(old, frame, None, u, x, [np.array([k]) for k in range(6)])
    assert said.leverage[5] == pytest.approx(1.0)
    assert said.errors[5] == pytest.approx(np.linalg.norm(x[5]))


# --- trust, doubt, value ----------------------------------------------------------------

SIDE = np.linspace(0.0, 0.45, 10)
ROWS = np.stack(np.meshgrid(SIDE, SIDE, indexing="ij"), axis=-1).reshape(-1, 2)  # 0.05 apart
REACH = 2.5 * 0.05


def by_hand(detail=None, scratch=False, errors=None, size=0.0, smooth=None):
    errors = np.zeros(100) if errors is None else errors
    smooth = smooth or fitted(old, points(30))
    return Correction(
        "", smooth, detail, scratch, ROWS, errors, np.ones(100, dtype=bool), size, BOX
    )


def test_trust_is_full_near_the_rows_and_falls_as_a_gaussian_beyond():
    away = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 4.5, 4.9])
    u = np.stack([0.45 + REACH * away, np.full(7, 0.25)], axis=1)
    u[:, 1] = ROWS[5, 1]
    expected = np.exp(-(np.maximum(away - 1.0, 0.0) ** 2))
    expected[-1] = 0.0  # below a millionth
    np.testing.assert_allclose(by_hand().trust(u), expected, rtol=1e-9)


def test_a_detail_counts_as_far_as_it_is_trusted():
    u = np.array([[0.2, 0.2], [0.45 + 1.7 * REACH, 0.25], [0.99, 0.99]])
    u[1, 1] = ROWS[5, 1]
    trust = np.array([[1.0], [np.exp(-0.49)], [0.0]])
    wild = np.array([[0.01, 0.02], [0.03, 0.04], [5.0, 6.0]])
    said = by_hand(lambda v: wild).value(u)
    expected = old(u) + trust * wild
    np.testing.assert_allclose(said, expected, rtol=1e-9)
    alone = by_hand(lambda v: moved(v), scratch=True).value(u)
    np.testing.assert_allclose(alone, (1 - trust) * old(u) + trust * moved(u), rtol=1e-9)
    np.testing.assert_array_equal(by_hand().value(u), old(u))


def test_doubt_is_the_errors_the_smooth_parts_and_the_details_where_it_is_not_trusted():
    errors = np.concatenate([np.full(50, 3e-3), np.full(49, 4e-3), [np.nan]])
    smooth = fitted(moved, points(40), 1, extra=noise(40))
    u = np.array([[0.2, 0.2], [0.99, 0.99]])
    said = by_hand(errors=errors, size=0.02, smooth=smooth).doubt(u)
    usual = (50 * 9e-6 + 49 * 16e-6) / 99
    away = np.array([0.0, 0.02])
    np.testing.assert_allclose(said, np.sqrt(usual + 2 * smooth.doubt(u) ** 2 + away**2))


# --- the choice -------------------------------------------------------------------------


def chosen(truth, n=80, extra=0.0):
    u = points(n)
    lattice = Lattice((8, 8))
    motor = Map(lattice.positions() / 7, lattice, BOX, np.zeros((0, 4)))
    rng = np.random.default_rng(0)
    return choose_correction(old, motor, (True, True), u, truth(u) + extra, rng)


@pytest.mark.parametrize(
    ("truth", "name"),
    [
        (old, "nothing"),
        (moved, "sensor frame"),
        (longer, "links"),
        (bent, "sensor frame bent (degree 2)"),
    ],
)
def test_the_simplest_explanation_is_chosen_and_holds(truth, name):
    correction = chosen(truth)
    assert correction.name == name
    assert not correction.scratch
    assert correction.detail is None
    assert correction.size == 0.0
    assert correction.kept.all()
    np.testing.assert_array_equal(correction.rows, points(80))
    gap = np.linalg.norm(correction.value(points(200, 1)) - truth(points(200, 1)), axis=1)
    assert np.sqrt(np.mean(gap**2)) <= 1e-9
    assert correction.doubt(points(200, 1)).max() <= 1e-9


def test_noise_leaves_the_simplest_explanation_the_simplest():
    correction = chosen(moved, 40, noise(40, 2e-4))
    assert correction.name == "sensor frame"
    assert correction.detail is None
    fresh = points(200, 1)
    gap = np.linalg.norm(correction.value(fresh) - moved(fresh), axis=1)
    assert gap.mean() < 1.5e-4
    assert 2e-4 < correction.doubt(fresh).min() <= correction.doubt(fresh).max() < 8e-4


def test_what_no_simple_change_explains_is_left_to_a_detail():
    def waved(u):
        return old(u) + 0.01 * np.stack([np.sin(9 * u[:, 0]), np.cos(7 * u[:, 1])], axis=1)

    correction = chosen(waved, 70)
    assert correction.detail is not None
    assert correction.size > 0.001
    fresh = points(200, 1)
    gap = np.linalg.norm(correction.value(fresh) - waved(fresh), axis=1)
    assert gap.mean() < 1e-3
    np.testing.assert_array_equal(np.isfinite(correction.errors), True)


def test_wrong_detections_are_left_out():
    extra = np.zeros((80, 2))
    extra[[3, 40, 77]] = 0.2
    correction = chosen(moved, extra=extra)
    assert np.flatnonzero(~correction.kept).tolist() == [3, 40, 77]
    assert correction.name == "sensor frame"
    assert len(correction.rows) == len(correction.errors) == 77


def test_an_arm_of_which_the_old_map_knows_nothing_is_learned_from_the_log_alone():
    def other(u):
        return np.stack([np.cos(3 * u[:, 1]) * u[:, 0], 2 * np.sin(2 * u[:, 0] * u[:, 1])], axis=1)

    correction = chosen(other, 70)
    assert correction.scratch
    assert correction.name == "the log alone"
    fresh = points(200, 1)
    assert np.linalg.norm(correction.value(fresh) - other(fresh), axis=1).mean() < 5e-3


def other_arm(u):
    return np.stack([np.cos(3 * u[:, 1]) * u[:, 0], 2 * np.sin(2 * u[:, 0] * u[:, 1])], axis=1)


def test_a_long_log_tries_some_of_its_rows_and_says_nothing_of_the_others():
    correction = chosen(other_arm, 2200)
    assert correction.detail is not None
    tried = np.isfinite(correction.errors)
    kept = len(correction.rows)
    assert len(correction.errors) == kept > 2000
    # every second row of each tenth
    expected = np.concatenate([part[::2] for part in blocks(kept)])
    np.testing.assert_array_equal(np.flatnonzero(tried), expected)
    fresh = points(200, 1)
    gap = np.linalg.norm(correction.value(fresh) - other_arm(fresh), axis=1)
    assert gap.mean() < 1e-3
    assert correction.errors[tried].mean() < 1e-3
    assert np.isfinite(correction.doubt(fresh)).all()


def test_a_long_log_of_noise_tells_no_detail():
    correction = chosen(moved, 1200, noise(1200, 1e-3))
    assert correction.name == "sensor frame"
    assert correction.detail is None
    assert np.isfinite(correction.errors).all()
    # Rayleigh distributed
    assert correction.errors.mean() == pytest.approx(1e-3 * np.sqrt(np.pi / 2), rel=0.05)


# --- the radius -------------------------------------------------------------------------


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


def test_without_a_past_the_radius_is_half_of_the_longest_side():
    assert matching_sigma(trained_like((600, 3.0, 0.5), shape=(20, 30)), 0.1) == 15.0


def test_an_error_that_came_twice_is_matched_to_the_later_radius():
    network = trained_like((900, 8.0, 0.5), (900, 4.0, 0.3), (900, 2.0, 0.4), (900, 1.0, 0.2))
    assert matching_sigma(network, 0.3) == pytest.approx(4.0 * 0.5**0.5)
    level = trained_like((900, 8.0, 0.5), (900, 4.0, 0.3), (900, 2.0, 0.3), (900, 1.0, 0.1))
    assert matching_sigma(level, 0.3) == pytest.approx(4.0)


# --- rehearsal --------------------------------------------------------------------------


def test_a_rehearsal_learns_as_the_model_did_but_coarse_to_fine_and_taught():
    options = options_of(model().about)
    assert options.map == model().about.options["map"]
    assert options.motor_size == options.sensory_size == (30, 30)
    assert (options.rule, options.epochs, options.sigma, options.taught) == (
        "batch",
        None,
        None,
        True,
    )
    about = replace(
        model().about,
        options={**model().about.options, "map": "my_gain", "rule": "online", "epochs": 3},
    )
    assert options_of(about).map == "vdsom"
    assert (options_of(about).rule, options_of(about).epochs) == ("batch", None)


def test_joints_are_imagined_where_the_model_or_the_log_know_of_them():
    rng = np.random.default_rng(0)
    everywhere = imagine(model(), points(10), rng)
    assert everywhere.shape == (20_000, 2)
    assert np.abs(everywhere.mean(axis=0) - 0.5).max() < 0.01
    # a model that knows only the lower half of the first joint
    half = arm().with_range({"shoulder": (0.0, 0.7)})
    samples = calib.babble(half, 400, seed=0)
    wide = replace(samples, lower=arm().lower, upper=arm().upper)
    narrow = calib.train(wide, size=6)
    row = np.array([[0.9, 0.5]])
    u = imagine(narrow, row, np.random.default_rng(1))
    known = np.isfinite(narrow.expected_error(narrow.motor.scale.from_unit(u)))
    near = np.linalg.norm(u - row, axis=1) <= narrow.motor.spacing
    assert (known | near).all()
    assert np.count_nonzero(near & ~known) > 50
    assert 0.3 < known.mean() < 1.0


def test_a_frame_that_is_bent_beyond_polynomials_is_bent_by_a_gaussian_process():
    def lens(u):
        x = old(u)
        return x + 0.01 * np.sin(9 * x[:, ::-1]) + [0.02, 0.0]

    correction = chosen(lens, 90)
    assert correction.name == "sensor frame bent"
    assert not correction.scratch
    assert 1e-4 < correction.size < 0.02
    fresh = points(200, 1)
    np.testing.assert_allclose(correction.value(fresh), lens(fresh), atol=2e-3)
    assert np.linalg.norm(correction.value(fresh) - lens(fresh), axis=1).mean() < 2e-4
