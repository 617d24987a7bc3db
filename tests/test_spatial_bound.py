"""What a spatial body promises: new mountings, few rows, never worse than the drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from models import in_space

from calib.arm.loading import load_arm
from calib.body.belief import Body
from calib.body.derivative import Derivative
from calib.body.fitting import fit_structure
from calib.body.normal import sums_of
from calib.body.remount import remount
from calib.body.sensor import SensorPose, without_gauge
from calib.body.spatial import structure_of
from calib.body.spatial_start import frame

NOISE = 5e-5


@pytest.fixture(scope="module")
def arm():
    return load_arm("spatial_three")


def true_arm(structure, seed, *, size=1.0):
    """Parameters of an arm as it might be built, in a sensor's frame that stands anywhere."""
    rng, groups, layout = np.random.default_rng(seed), structure.groups, structure.layout
    beta = structure.neutral()
    beta[groups["view.rotation"]], beta[groups["view.shift"]] = rng.normal(0, 1, (2, 3))
    beta[groups["tool"]] = rng.normal(0, 0.02, 3)
    beta[layout.shifts] = size * rng.normal(0, 1e-3, (3, 3))
    beta[layout.turns] = size * rng.normal(0, 2e-3, (3, 3))
    return beta


def seen(arm, structure, beta, n, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (n, arm.dof))
    return q, structure.predict(q, beta) + rng.normal(0, NOISE, (n, 3))


def fitted(structure, q, z) -> Body:
    extent = float(np.sqrt(((z - z.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return fit_structure(replace(structure, extent=extent), q, z).body


def apart(body, q, z):
    return np.linalg.norm(z - body.predict(q), axis=1)


@pytest.fixture(scope="module")
def mounted(arm):
    """An arm that was fitted, and where it stands now, with another tool."""
    structure = structure_of(arm)
    beta = true_arm(structure, 0)
    body = fitted(structure, *seen(arm, structure, beta, 150, 1))
    groups, rng = structure.groups, np.random.default_rng(2)
    beta[groups["view.rotation"]], beta[groups["view.shift"]] = rng.normal(0, 1, (2, 3))
    beta[groups["tool"]] = rng.normal(0, 0.02, 3)
    return structure, beta, body


def test_a_new_mounting_keeps_what_was_known_of_the_arm(arm, mounted):
    structure, beta, body = mounted
    fresh = seen(arm, structure, beta, 400, 5)
    new = remount(body, *seen(arm, structure, beta, 10, 4))
    alone = frame(structure, *seen(arm, structure, beta, 10, 4))
    drawn = np.linalg.norm(fresh[1] - structure.predict(fresh[0], alone), axis=1)
    assert apart(new, *fresh).mean() < 0.1 * drawn.mean()


def test_the_bound_of_a_new_mounting_covers(arm, mounted):
    structure, beta, body = mounted
    inside = []
    for seed in range(2):
        new = remount(body, *seen(arm, structure, beta, 30, 10 + seed))
        q, z = seen(arm, structure, beta, 300, 20 + seed)
        inside.append(np.mean(apart(new, q, z) <= new.bound(q)))
    assert np.mean(inside) > 0.93
    assert new.kappa >= 1.0


def test_rows_of_another_arm_widen_the_bound_of_a_new_mounting(arm, mounted):
    structure, beta, body = mounted
    other = beta.copy()
    other[structure.layout.shifts] += np.random.default_rng(3).normal(0, 2e-3, (3, 3))
    same = remount(body, *seen(arm, structure, beta, 40, 6))
    changed = remount(body, *seen(arm, structure, other, 40, 6))
    q, z = seen(arm, structure, other, 300, 7)
    assert changed.noise[0] > 3 * same.noise[0]
    assert np.mean(apart(changed, q, z) <= changed.bound(q)) > 0.9


@pytest.mark.parametrize("rows", [12, 30])
def test_a_fit_is_never_worse_than_the_drawing_with_fitted_frames(arm, rows):
    structure = structure_of(arm)
    beta = true_arm(structure, 0, size=0.3)
    q, z = seen(arm, structure, beta, rows, 30)
    fresh, true = seen(arm, structure, beta, 300, 40)
    plain = structure.predict(fresh, frame(structure, q, z))
    error = apart(fitted(structure, q, z), fresh, true).mean()
    assert error <= 1.0001 * np.linalg.norm(true - plain, axis=1).mean()


def test_blocks_add_up_to_the_normal_equations():
    rng = np.random.default_rng(0)
    x, r, w = rng.normal(size=(25, 2, 4)), rng.normal(size=(25, 2)), rng.random((25, 2))
    each = Derivative.of(x)
    (sums,) = sums_of(each, r, w, (2,), np.array([0, 7, 25]))
    (kept,) = sums_of(each, r, w, (2,), np.array([0, 7, 25]), [sums])
    flat, heavy = x.reshape(-1, 4), w.ravel()
    np.testing.assert_allclose(sums.grams.sum(axis=0), (flat * heavy[:, None]).T @ flat, atol=1e-10)
    np.testing.assert_allclose(sums.gram, sums.grams.sum(axis=0))
    np.testing.assert_allclose(sums.moment, flat.T @ (heavy * r.ravel()), atol=1e-10)
    np.testing.assert_allclose(kept.moments, sums.moments, atol=1e-12)


def test_the_spectrum_of_curves_carries_over_to_joints_that_turn_elsewhere(arm):
    structure, rng = structure_of(arm), np.random.default_rng(0)
    prior = structure.prior(["curve.1"])
    true = structure.neutral()
    waves = structure.groups["curve.1"][[6, 7, 54, 55]]  # cycles a turn that no prior says
    true[waves] = rng.normal(0, 1e-3, 4)
    middle = 0.5 * (arm.lower + arm.upper)

    def rows(n, lower, upper):
        q = rng.uniform(lower, upper, (n, arm.dof))
        return q, structure.predict(q, true) + rng.normal(0, NOISE, (n, 3))

    q, z = rows(200, arm.lower, middle)
    nominal, x = structure.linearise(q, structure.neutral(), prior.active)
    x = x.reshape(-1, len(prior.active)) / NOISE
    covariance = np.linalg.inv(x.T @ x + np.diag(prior.sd[prior.active] ** -2.0))
    beta, none = structure.neutral(), np.zeros(3)
    beta[prior.active] = covariance @ x.T @ ((z - nominal).ravel() / NOISE)
    scales = {h.name: h.scale for h in prior.hypers}
    body = Body(structure, beta, prior.active, covariance, none + NOISE, 1.0, none, none, np.inf,
                1.0, scales, len(q), member="curves")  # fmt: skip
    few, fresh = rows(14, middle, arm.upper), rows(200, middle, arm.upper)
    learned, plain = remount(body, *few), remount(replace(body, scales={}), *few)
    assert apart(learned, *fresh).mean() < 0.8 * apart(plain, *fresh).mean()


def test_a_gauge_is_what_no_reading_tells():
    body = in_space().body
    structure, active = body.structure, body.active
    left = without_gauge(structure, body, size=True)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    x = structure.linearise(q, body.beta, active)[1].reshape(-1, len(active))
    spreads = [((x @ each) * x).sum(axis=1) for each in (body.covariance, left)]
    np.testing.assert_allclose(*spreads, rtol=1e-4)  # of readings: nothing is lost
    tracker = SensorPose.of(body)
    assert tracker.told_sd.max() < 0.1 * tracker.position_sd.max()
    assert "no reading tells" in " ".join(tracker.words("sensor's frame"))


def test_sums_of_harmonics_are_those_of_all_columns():
    body = in_space().body
    rng = np.random.default_rng(2)
    q, w, r = rng.uniform(-1, 1, (30, 3)), rng.random((30, 3)), rng.normal(size=(30, 3))
    for kept in (body.active, np.delete(body.active, -1)):  # without one of the harmonics
        x = body.structure.derivative(q, body.beta, kept)[1]
        flat = body.structure.linearise(q, body.beta, kept)[1].reshape(90, -1)
        np.testing.assert_array_equal(x.dense().reshape(90, -1), flat)
        np.testing.assert_allclose(x.gram(w), (flat.T * w.ravel()) @ flat, atol=1e-12)
        np.testing.assert_allclose(x.moment(r), flat.T @ r.ravel(), atol=1e-12)
        step = rng.normal(size=len(kept))
        np.testing.assert_allclose(x.rows(slice(3, 9)).times(step).ravel(), flat[9:27] @ step)
    assert len(x.waves) == 3
