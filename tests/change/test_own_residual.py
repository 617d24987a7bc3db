"""A smooth residual of one log: kept where held-out rows ask for it, nothing far away."""

from __future__ import annotations

import numpy as np
import pytest
from beliefs import joints, noise

from calib.body.likeness import matern
from calib.change.own_residual import own_residual
from calib.common.rows import thinned

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def test_a_smooth_residual_is_kept_and_fades():
    q = joints(200, 15)
    wave = 2e-3 * np.stack([np.sin(2 * q[:, 0]), np.cos(2 * q[:, 1])], axis=1)
    rows = wave + noise(200, 15, 1e-4)
    lengths = np.array([0.5, 0.5])
    own = own_residual(q, rows, rows, np.ones(200), lengths)
    assert own is not None
    fresh = joints(100, 16)
    truth = 2e-3 * np.stack([np.sin(2 * fresh[:, 0]), np.cos(2 * fresh[:, 1])], axis=1)
    assert np.abs(own.value(fresh) - truth).mean() < 2e-4
    far = fresh + 20.0
    assert np.abs(own.value(far)).max() < 1e-9
    np.testing.assert_allclose(own.deviation(far), own.sd)
    assert own.deviation(fresh).mean() < 0.2 * own.sd


def test_noise_is_no_residual():
    for seed in range(5):
        rows = noise(150, seed)
        assert own_residual(joints(150, seed), rows, rows, np.ones(150), np.ones(2)) is None


def test_a_correlation_is_one_at_home_and_falls():
    q = joints(30, 17)
    alike = matern(q, q, np.array([0.3, 0.6]))
    np.testing.assert_allclose(np.diag(alike), 1.0)
    assert np.linalg.eigvalsh(alike).min() > -1e-10
    line = np.stack([np.linspace(0, 3, 20), np.zeros(20)], axis=1)
    falling = matern(line, line[:1], np.ones(2))[:, 0]
    assert (np.diff(falling) < 0).all()


def test_rows_are_thinned_evenly_and_in_order():
    rows = thinned(1000, 10)
    assert rows[0] == 0
    assert rows[-1] == 999
    assert (np.diff(rows) == 111).all()
    np.testing.assert_array_equal(thinned(5, 10), np.arange(5))


def test_a_residual_of_single_places_is_not_carried_elsewhere():
    """Rows of each place tell of that place alone: half of the log says nothing of the other."""
    rng = np.random.default_rng(5)
    places = rng.uniform(0.0, 3.0, (20, 2))
    q = np.repeat(places, 6, axis=0) + 0.005 * rng.standard_normal((120, 2))
    q = q[np.argsort(np.tile(np.arange(6), 20), kind="stable")]  # six rounds of all places
    value = np.tile(rng.standard_normal((20, 2)), (6, 1))
    kept = own_residual(q, value, value, np.ones(120), np.full(2, 0.5))
    assert kept is not None  # every block has seen all the places
    order = np.argsort(np.tile(np.arange(20), 6), kind="stable")  # one place after another
    q, value = q[order], value[order]
    assert own_residual(q, value, value, np.ones(120), np.full(2, 0.5)) is None
