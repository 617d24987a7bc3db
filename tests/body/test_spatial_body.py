"""Spatial bodies: derivatives, what a fit finds, and what it says that it does not know."""

import json

import numpy as np
import pytest
from models import built, in_pixels, in_space

from calib.arm.loading import load_arm
from calib.arm.rotations import exponential, logarithm
from calib.body import body_fit
from calib.body.belief import Body
from calib.body.rows import Rows
from calib.body.sensor_pose import SensorPose, without_gauge
from calib.body.spatial import structure_of, unknown_structure
from calib.body.starts import candidates, frame
from calib.errors import LogError
from calib.model_file.fields import read, write
from calib.model_file.storage import KINDS


def rows(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, arm.dof))


def spread(z):
    return float(np.sqrt(((z - z.mean(axis=0)) ** 2).sum(axis=1).mean()))


def test_a_fit_finds_the_arm_and_its_bound_holds_the_errors():
    arm, structure, beta, _ = built()
    q, fresh = rows(arm, 80, 1), rows(arm, 400, 2)
    rng = np.random.default_rng(3)
    z = structure.predict(q, beta) + rng.normal(0, 5e-5, (len(q), 3))
    body = body_fit.fit(structure.with_sensor(extent=spread(z)), [Rows(q, z)]).body
    error = np.linalg.norm(body.predict(fresh) - structure.predict(fresh, beta), axis=1)
    assert error.mean() < 1.5e-4
    assert np.mean(error <= body.bound(fresh, noise=False)) > 0.93
    told, arrays = write(body, Body, KINDS)
    again = read(Body, json.loads(json.dumps(told)), arrays, KINDS)
    np.testing.assert_array_equal(again.predict(fresh), body.predict(fresh))
    np.testing.assert_allclose(again.bound(fresh), body.bound(fresh), rtol=1e-5)
    words = " ".join(body.describe())
    assert "zero by convention" in words
    assert "elbow" in words


def test_curves_are_found_where_they_are():
    arm, structure, beta, _ = built(curves=True)
    q, fresh = rows(arm, 150, 1), rows(arm, 300, 2)
    z = structure.predict(q, beta) + np.random.default_rng(3).normal(0, 3e-5, (len(q), 3))
    fit = body_fit.fit(structure.with_sensor(extent=spread(z)), [Rows(q, z)])
    error = np.linalg.norm(fit.body.predict(fresh) - structure.predict(fresh, beta), axis=1)
    assert fit.body.member == "curves"
    plain = structure.prior(("offset", "placement")).mean  # the arm as drawn, without curves
    plain[: structure.groups["curve.0"][0]] = beta[: structure.groups["curve.0"][0]]
    waves = structure.predict(fresh, plain) - structure.predict(fresh, beta)
    assert error.mean() < 0.25 * np.linalg.norm(waves, axis=1).mean()


def test_a_pose_tells_the_tools_orientation():
    arm, structure, beta, _ = built("pose")
    beta[structure.groups["tool.rotation"]] = (0.3, -1.0, 0.5)
    q, fresh = rows(arm, 60, 1), rows(arm, 100, 2)
    rng = np.random.default_rng(3)
    z = structure.predict(q, beta)
    z[:, :3] += rng.normal(0, 5e-5, (len(q), 3))
    z[:, 3:] = logarithm(exponential(rng.normal(0, 1e-4, (len(q), 3))) @ exponential(z[:, 3:]))
    body = body_fit.fit(structure.with_sensor(extent=spread(z[:, :3])), [Rows(q, z)]).body
    error = structure.residual(structure.predict(fresh, beta), body.predict(fresh))
    assert np.linalg.norm(error[:, :3], axis=1).mean() < 2e-4
    assert np.linalg.norm(error[:, 3:], axis=1).mean() < 5e-4


def test_millimetres_and_a_free_scale():
    arm, structure, beta, _ = built("similarity")
    beta[structure.groups["view.scale"]] = np.log(1000.0)
    q = rows(arm, 60, 1)
    z = structure.predict(q, beta)
    body = body_fit.fit(structure.with_sensor(extent=spread(z), unit="sensor"), [Rows(q, z)]).body
    scale = np.exp(body.beta[structure.groups["view.scale"][0]])
    assert scale == pytest.approx(1000.0, rel=5e-3)
    with pytest.raises(LogError, match="does not explain the positions"):
        candidates(structure.with_sensor(view="rigid"), Rows(q, z))
    in_mm = structure_of(arm, "rigid", unit="mm", metre=1000.0, extent=spread(z))
    assert np.abs(body_fit.fit(in_mm, [Rows(q, z)]).held_out).mean() < 1.0


def test_rows_that_no_arm_explains_are_refused_in_one_line():
    arm, structure, beta, _ = built()
    q = rows(arm, 60, 1)
    z = structure.predict(q, beta)
    for bad, words in (
        ((q[:3], z[:3]), "3 rows cannot place"),
        ((q, z * 0.0), "same in every row"),
        ((q, np.random.default_rng(0).normal(0, 0.3, z.shape)), "does not explain"),
        ((q[:, ::-1], z), "does not explain"),
        ((q, z[:, [1, 0, 2]]), "does not explain"),
    ):
        with pytest.raises(LogError, match=words) as caught:
            candidates(structure, Rows(*bad))
        assert "\n" not in str(caught.value)


def test_shuffled_orientations_and_pixels_are_refused_in_one_line():
    arm, structure, beta, _ = built("pose")
    q, rng = rows(arm, 60, 1), np.random.default_rng(2)
    poses = structure.predict(q, beta)
    assert len(candidates(structure, Rows(q, poses))) == 1
    with pytest.raises(LogError, match="do not turn as the joints do"):
        candidates(structure, Rows(q, np.hstack([poses[:, :3], rng.permutation(poses[:, 3:])])))
    body = in_pixels().body
    pixels = body.predict(q)
    assert len(candidates(body.structure, Rows(q, pixels))) == 1
    with pytest.raises(LogError, match="does not explain the pixels"):
        candidates(body.structure, Rows(q, rng.permutation(pixels)))


def test_ten_rows_tell_no_less_than_the_drawing_with_its_frames():
    arm, structure, beta, _ = built()
    q = rows(arm, 10, 1)
    z = structure.predict(q, beta) + np.random.default_rng(0).normal(0, 2e-4, (10, 3))
    structure = structure.with_sensor(extent=spread(z))
    body = body_fit.fit(structure, [Rows(q, z)]).body
    fresh = rows(arm, 100, 2)
    true = structure.predict(fresh, beta)
    error = np.linalg.norm(body.predict(fresh) - true, axis=1)
    plain = np.linalg.norm(structure.predict(fresh, frame(structure, q, z)) - true, axis=1)
    assert error.mean() <= plain.mean()
    assert np.mean(error <= body.bound(fresh)) > 0.93


def test_without_a_drawing_the_chain_is_found():
    arm = load_arm("spatial_three")
    q, fresh = rows(arm, 60, 1), rows(arm, 100, 2)
    z = arm.forward(q) + np.random.default_rng(0).normal(0, 1e-4, (60, 3))
    unknown = unknown_structure(arm.joint_names, arm.revolute, spread(z))
    body = body_fit.fit(unknown, [Rows(q, z)]).body
    error = np.linalg.norm(body.predict(fresh) - arm.forward(fresh), axis=1)
    assert error.mean() < 3e-4
    assert np.mean(error <= body.bound(fresh, noise=False)) > 0.9


def test_exact_rows_give_the_chain_to_rounding():
    arm = load_arm("spatial_three")
    q, fresh = rows(arm, 200, 1), rows(arm, 100, 2)
    z = arm.forward(q)
    unknown = unknown_structure(arm.joint_names, arm.revolute, spread(z), simulated=True)
    body = body_fit.fit(unknown, [Rows(q, z)]).body
    assert body.member == "chain"
    assert np.abs(body.predict(fresh) - arm.forward(fresh)).max() < 1e-12


def test_a_joint_that_never_moved_keeps_its_drawing_and_a_wide_bound():
    arm, structure, beta, _ = built()
    q = rows(arm, 100, 1)
    q[:, 1] = 0.3
    z = structure.predict(q, beta) + np.random.default_rng(3).normal(0, 5e-5, (len(q), 3))
    body = body_fit.fit(structure.with_sensor(extent=spread(z)), [Rows(q, z)]).body
    moved = q.copy()
    moved[:, 1] += 1.0
    error = np.linalg.norm(body.predict(moved) - structure.predict(moved, beta), axis=1)
    assert np.mean(error <= body.bound(moved)) > 0.93
    assert np.median(body.bound(moved)) > 1.5 * np.median(body.bound(q))


def test_a_gauge_is_what_no_reading_tells():
    body = in_space().body
    structure, active = body.structure, body.active
    left = without_gauge(structure, body, size=True)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3))
    x = structure.linearise(q, body.beta, active)[1].reshape(-1, len(active))
    spreads = [((x @ root) ** 2).sum(axis=1) for root in (body.root, left)]
    np.testing.assert_allclose(*spreads, rtol=1e-4)  # of readings: nothing is lost
    tracker = SensorPose.of(body)
    assert tracker.told_sd.max() < 0.1 * tracker.position_sd.max()
    assert "no reading tells" in " ".join(tracker.words("sensor's frame"))
