"""Cross-validation: noise asks for no correction, structure for one; folds are honest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.common.scale import Scale
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.model_selection import FOLDS, better, blocks, of_trends, outdoes
from calib.maps.model_selection import select as choose

N = 3000
SPAN = np.array([1.5, 2.3])


@pytest.fixture(scope="module")
def motor():
    lattice = Lattice((20, 20))
    scale = Scale(np.zeros(2), SPAN, np.zeros(2, dtype=bool))
    return Map((lattice.positions() + 0.5) / 20, lattice, scale, np.zeros((0, 4)))


def select(motor, u, x):
    return choose(motor, u, of_trends(motor.scale, (True, True), u, x))


def arm(u):
    a, b = (u * SPAN).T
    x = 0.3 * np.cos(a) + 0.25 * np.cos(a + b)
    return np.stack([x, 0.3 * np.sin(a) + 0.25 * np.sin(a + b)], axis=1)


def ripple(u):
    """Gear teeth: finer than any trend can follow."""
    return arm(u) + 2e-3 * np.sin(45 * u[:, :1])


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
    selected = select(motor, u, arm(u))
    assert selected.predictor.models.degree == -1
    assert selected.errors.max() < 1e-8


def test_noise_asks_for_no_narrow_correction(motor):
    u = points(N)
    selected = select(motor, u, arm(u) + noise(N, 1e-3))
    models = selected.predictor.models
    assert models.degree == -1 or models.samples >= 200
    fresh = points(1000, seed=1)
    gap = np.linalg.norm(selected.predictor.value(fresh) - arm(fresh), axis=1)
    assert gap.mean() < 0.13e-3


def test_structure_finer_than_the_trend_is_corrected_locally(motor):
    u = points(N)
    predictor = select(motor, u, ripple(u)).predictor
    assert predictor.models.degree >= 1
    fresh = points(1000, seed=1)
    gap = np.linalg.norm(predictor.value(fresh) - ripple(fresh), axis=1)
    plain = np.linalg.norm(predictor.smooth.value(fresh) - ripple(fresh), axis=1)
    assert gap.mean() < 0.25 * plain.mean()


def test_with_more_noise_more_samples_stand_behind_each_coefficient(motor):
    u = points(N)

    def samples_per_term(size):
        x = ripple(u) + noise(N, size)
        models = select(motor, u, x).predictor.models
        terms = models.coefficients.shape[1]
        return models.samples / terms if models.degree >= 0 else np.inf

    assert samples_per_term(1e-5) < samples_per_term(3e-3)


def test_held_out_errors_are_those_of_rows_unseen(motor):
    """On an exact arm with noise they are the noise itself: sigma sqrt(pi / 2) on average."""
    u = points(N)
    selected = select(motor, u, arm(u) + noise(N, 1e-3))
    assert selected.errors.mean() == pytest.approx(1e-3 * np.sqrt(np.pi / 2), rel=0.05)
    assert len(np.unique(selected.rows)) == len(selected.rows) == len(selected.errors)


def test_rows_that_repeat_within_a_block_flatter_no_one(motor):
    """Noise repeated ten times in neighbouring rows is still not learned."""
    u = np.repeat(points(N // 10), 10, axis=0)
    x = arm(u) + np.repeat(noise(N // 10, 1e-3), 10, axis=0)
    selected = select(motor, u, x)
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
    selected = select(motor, u, ripple(u) + noise(5200, 1e-4))
    fold = np.unique(selected.rows // 520)
    assert fold.tolist() == [0, 3, 6, 9]
    assert len(np.unique(selected.rows)) == len(selected.rows)
    assert 1000 <= len(selected.rows) <= 1100
    few = select(motor, u[:2000], arm(u[:2000]))
    assert np.unique(few.rows // 200).tolist() == list(range(10))


def test_what_is_exact_to_rounding_is_not_mended(motor):
    u = points(300)
    tiny = arm(u) + 1e-13 * ripple(u)
    assert select(motor, u, tiny).predictor.models.degree == -1


def test_a_wilder_trend_has_its_price():
    errors = np.full(50, 1.0)
    assert outdoes(errors, np.full(50, 1.01), 10)  # 10 functions cost half a percent
    assert not outdoes(errors, np.full(50, 1.004), 10)
    assert outdoes(errors, np.full(50, 0.996), -10)
    assert not outdoes(errors, errors, 0)
