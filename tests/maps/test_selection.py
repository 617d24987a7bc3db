"""Cross-validation: noise asks for no correction, structure for one; folds are honest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.body.fitting import fit_body
from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.model_selection import (
    FOLDS,
    SmoothCandidate,
    better,
    blocks,
    of_body,
    of_trends,
    outdoes,
    select,
)
from calib.maps.predictor import BodyInBox, Both

N = 3000
SPAN = np.array([1.5, 2.3])


@pytest.fixture(scope="module")
def motor():
    lattice = Lattice((20, 20))
    scale = Scale(np.zeros(2), SPAN, np.zeros(2, dtype=bool))
    return Map((lattice.positions() + 0.5) / 20, lattice, scale, np.zeros((0, 4)))


def arm(u):
    a, b = (u * SPAN).T
    x = 0.3 * np.cos(a) + 0.25 * np.cos(a + b)
    return np.stack([x, 0.3 * np.sin(a) + 0.25 * np.sin(a + b)], axis=1)


def ripple(u):
    """Gear teeth: finer than any trend can follow."""
    return arm(u) + 2e-3 * np.sin(45 * u[:, :1])


def chosen(motor, u, x):
    """What is selected among trends alone."""
    return select(motor, u, of_trends(motor.scale, (True, True), u, x))


def points(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def noise(n, size, seed=7):
    return np.random.default_rng(seed).normal(scale=size, size=(n, 2))


@given(st.integers(1, 200), st.integers(1, 12))
def test_folds_are_contiguous_and_hold_every_row_once(n, folds):
    parts = blocks(n, folds)
    assert len(parts) == min(n, folds)
    assert np.concatenate(parts).tolist() == list(range(n))
    sizes = [len(p) for p in parts]
    assert max(sizes) - min(sizes) <= 1


def test_there_are_ten_folds_unless_told_otherwise():
    assert len(blocks(1000)) == FOLDS == 10


def test_an_exact_arm_needs_no_correction(motor):
    u = points(N)
    selected = chosen(motor, u, arm(u))
    assert selected.predictor.models.degree == -1
    assert selected.errors.max() < 1e-8


def test_noise_asks_for_no_narrow_correction(motor):
    u = points(N)
    selected = chosen(motor, u, arm(u) + noise(N, 1e-3))
    models = selected.predictor.models
    assert models.degree == -1 or models.samples >= 200
    fresh = points(1000, seed=1)
    gap = np.linalg.norm(selected.predictor.value(fresh) - arm(fresh), axis=1)
    assert gap.mean() < 0.13e-3


def test_structure_finer_than_the_trend_is_corrected_locally(motor):
    u = points(N)
    predictor = chosen(motor, u, ripple(u)).predictor
    assert predictor.models.degree >= 1
    fresh = points(1000, seed=1)
    gap = np.linalg.norm(predictor.value(fresh) - ripple(fresh), axis=1)
    plain = np.linalg.norm(predictor.smooth.value(fresh) - ripple(fresh), axis=1)
    assert gap.mean() < 0.25 * plain.mean()


def test_with_more_noise_more_samples_stand_behind_each_coefficient(motor):
    u = points(N)

    def samples_per_term(size):
        x = ripple(u) + noise(N, size)
        models = chosen(motor, u, x).predictor.models
        terms = models.coefficients.shape[1]
        return models.samples / terms if models.degree >= 0 else np.inf

    assert samples_per_term(1e-5) < samples_per_term(3e-3)


def test_held_out_errors_are_those_of_rows_unseen(motor):
    """On an exact arm with noise they are the noise itself: sigma sqrt(pi / 2) on average."""
    u = points(N)
    selected = chosen(motor, u, arm(u) + noise(N, 1e-3))
    assert selected.errors.mean() == pytest.approx(1e-3 * np.sqrt(np.pi / 2), rel=0.05)
    assert len(np.unique(selected.rows)) == len(selected.rows) == len(selected.errors)


def test_rows_that_repeat_within_a_block_flatter_no_one(motor):
    """Noise repeated ten times in neighbouring rows is still not learned."""
    u = np.repeat(points(N // 10), 10, axis=0)
    x = arm(u) + np.repeat(noise(N // 10, 1e-3), 10, axis=0)
    selected = chosen(motor, u, x)
    assert selected.predictor.models.degree == -1
    assert selected.errors.mean() > 1e-3


def test_better_asks_for_more_than_chance_and_three_percent():
    rng = np.random.default_rng(0)
    errors = 1 + 0.1 * rng.random(400)
    assert better(errors * 0.9, errors)
    assert not better(errors * 0.98, errors)
    assert not better(errors, errors)
    assert not better(errors + rng.normal(scale=2.0, size=400) - 0.05, errors)
    assert not better(errors * 0.9, errors, least=0.5)


def test_of_many_rows_every_third_fold_is_held_out(motor):
    u = points(5200)
    selected = chosen(motor, u, ripple(u) + noise(5200, 1e-4))
    fold = np.unique(selected.rows // 520)
    assert fold.tolist() == [0, 3, 6, 9]
    assert len(np.unique(selected.rows)) == len(selected.rows)
    assert 1000 <= len(selected.rows) <= 1100
    few = chosen(motor, u[:2000], arm(u[:2000]))
    assert np.unique(few.rows // 200).tolist() == list(range(10))


def body_of(motor, u, x):
    """The candidate that a body of the arm is, fitted as to a simulation."""
    q = motor.scale.from_unit(u)
    fit = fit_body(
        q,
        x,
        joint_names=("shoulder", "elbow"),
        revolute=(True, True),
        simulated=True,
        lower=np.zeros(2),
        upper=SPAN,
    )
    return of_body(fit, motor.scale, u, x)


def test_the_unseen_residuals_of_a_body_are_those_of_its_held_out_blocks(motor):
    u = points(1200)
    body = body_of(motor, u, arm(u) + noise(1200, 1e-3))
    assert isinstance(body.smooth, BodyInBox)
    assert len(body.unseen) == FOLDS
    for fold, unseen in zip(blocks(1200), body.unseen, strict=True):
        rest = np.setdiff1d(np.arange(1200), fold)
        np.testing.assert_array_equal(unseen[rest], body.residual[rest])
        # rows that the fit has not seen are missed by more
        assert np.linalg.norm(unseen[fold]) > np.linalg.norm(body.residual[fold])


def test_a_body_of_its_arm_is_preferred_to_trends(motor):
    u = points(800)
    x = arm(u) + noise(800, 1e-3)
    body = body_of(motor, u, x)
    selected = select(motor, u, [body, *of_trends(motor.scale, (True, True), u, x)])
    assert selected.predictor.smooth is body.smooth
    fresh = points(1000, seed=1)
    gap = np.linalg.norm(selected.predictor.value(fresh) - arm(fresh), axis=1)
    assert gap.mean() < 0.15e-3


def test_a_trend_of_what_the_body_leaves_over_is_added_where_it_pays(motor):
    """A distortion of order 5 over the workspace: smooth, and not in the body."""
    u = points(1500)

    def bent(u):
        x = arm(u)
        return x + 0.03 * np.stack([x[:, 0] ** 5, x[:, 0] ** 2 * x[:, 1] ** 3], axis=1)

    smooth = body_of(motor, u, arm(u)).smooth
    left = bent(u) - smooth.value(u)
    body = SmoothCandidate(smooth, left, [left] * FOLDS)
    both = of_trends(motor.scale, (True, True), u, bent(u), body)
    selected = select(motor, u, [body, *both])
    smooth = selected.predictor.smooth
    assert isinstance(smooth, Both)
    assert smooth.first is body.smooth
    fresh = points(1000, seed=1)
    alone = np.linalg.norm(body.smooth.value(fresh) - bent(fresh), axis=1).mean()
    gap = np.linalg.norm(selected.predictor.value(fresh) - bent(fresh), axis=1).mean()
    assert gap < 0.02 * alone
    slope = smooth.value_and_slope(fresh[:50])[1]
    step = 1e-6
    for k in range(2):
        moved = fresh[:50] + step * np.eye(2)[k]
        back = fresh[:50] - step * np.eye(2)[k]
        numeric = (smooth.value(moved) - smooth.value(back)) / (2 * step)
        np.testing.assert_allclose(slope[:, :, k], numeric, atol=1e-8)


def test_the_only_candidate_is_the_smooth_part(motor):
    u = points(800)
    (first, *_) = of_trends(motor.scale, (True, True), u, arm(u))
    rippled = SmoothCandidate(
        first.smooth,
        ripple(u) - first.smooth.value(u),
        [ripple(u) - first.smooth.value(u)] * FOLDS,
    )
    selected = select(motor, u, [rippled])
    assert selected.predictor.smooth is first.smooth
    assert selected.predictor.models.degree >= 0


def test_what_is_exact_to_rounding_is_not_mended(motor):
    u = points(300)
    tiny = arm(u) + 1e-13 * ripple(u)
    assert chosen(motor, u, tiny).predictor.models.degree == -1


def test_a_wilder_trend_has_its_price():
    errors = np.full(50, 1.0)
    assert outdoes(errors, np.full(50, 1.01), 10)  # 10 functions cost half a percent
    assert not outdoes(errors, np.full(50, 1.004), 10)
    assert outdoes(errors, np.full(50, 0.996), -10)
    assert not outdoes(errors, errors, 0)


def test_a_rival_has_to_be_much_better_than_what_is_better_founded(motor):
    from copy import copy
    from dataclasses import replace

    lattice = Lattice((8, 8))
    motor = Map((lattice.positions() + 0.5) / 8, lattice, motor.scale, np.zeros((0, 4)))
    u = points(1200)
    trend = of_trends(motor.scale, (True, True), u, ripple(u))[0]
    # as a body whose local models mend less than those of the trend
    unseen = [r + noise(1200, 2e-4) for r in trend.unseen]
    body = replace(trend, smooth=copy(trend.smooth), unseen=unseen)
    for share, better_one in ((0.9, trend), (1e-6, body)):
        found = select(motor, u, [body, replace(trend, rival=share)])
        assert found.predictor.smooth is better_one.smooth
