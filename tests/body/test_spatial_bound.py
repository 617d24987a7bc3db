"""What a spatial body promises: new mountings, few rows, never worse than the drawing."""

import numpy as np
import pytest
from models import in_space

from calib.arm.loading import load_arm
from calib.body import body_fit
from calib.body.belief import Body
from calib.body.rows import Rows
from calib.body.sensor_pose import SensorPose, without_gauge
from calib.body.spatial import structure_of
from calib.body.starts import frame

NOISE = 5e-5


@pytest.fixture(scope="module")
def arm():
    return load_arm("spatial_three")


def true_arm(structure, seed, *, size=1.0):
    """Parameters of an arm as it might be built, in a sensor's frame that stands anywhere."""
    rng, groups = np.random.default_rng(seed), structure.groups
    beta = structure.neutral()
    beta[groups["view.rotation"]], beta[groups["view.shift"]] = rng.normal(0, 1, (2, 3))
    beta[groups["tool"]] = rng.normal(0, 0.02, 3)
    beta[structure.shifts] = size * rng.normal(0, 1e-3, (3, 3))
    beta[structure.turns] = size * rng.normal(0, 2e-3, (3, 3))
    return beta


def seen(arm, structure, beta, n, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (n, arm.dof))
    return q, structure.predict(q, beta) + rng.normal(0, NOISE, (n, 3))


def fitted(structure, q, z) -> Body:
    extent = float(np.sqrt(((z - z.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return body_fit.fit(structure.with_sensor(extent=extent), [Rows(q, z)]).body


def apart(body, q, z):
    return np.linalg.norm(z - body.predict(q), axis=1)


@pytest.mark.parametrize("rows", [12, 30])
def test_a_fit_is_never_worse_than_the_drawing_with_fitted_frames(arm, rows):
    structure = structure_of(arm)
    beta = true_arm(structure, 0, size=0.3)
    q, z = seen(arm, structure, beta, rows, 30)
    fresh, true = seen(arm, structure, beta, 300, 40)
    plain = structure.predict(fresh, frame(structure, q, z))
    error = apart(fitted(structure, q, z), fresh, true).mean()
    assert error <= 1.0001 * np.linalg.norm(true - plain, axis=1).mean()


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
