"""ISO 9283: accuracy and repeatability of poses, beside the truth of a simulation."""

import numpy as np
import pytest

import calib
from calib.errors import LogError
from calib.use.iso9283 import iso9283

RETURN = 5e-5  # sd of the place that the arm returns to, along an axis [m]


@pytest.fixture(scope="module")
def model():
    """Learned from a log of an arm whose elbow stands 3 mrad off."""
    arm = calib.load_arm("two_link")
    log = calib.babble(arm, 150, noise=2e-5, changes=["elbow.offset=0.003"], seed=1)
    measured = calib.Samples(log.q, log.x, log.joint_names, log.lower, log.upper, arm=arm)
    return calib.train(measured, size=4, view="base")


@pytest.fixture(scope="module")
def cycles():
    """Five poses, thirty cycles, and where the nominal arm would be."""
    arm = calib.load_arm("two_link")
    poses = np.array([[0.4, 0.8], [0.8, 1.2], [1.2, 1.6], [0.5, 2.0], [1.0, 0.7]])
    q = np.tile(poses, (30, 1))
    rng = np.random.default_rng(3)
    x = arm.forward(q + np.array([0.0, 0.003])) + rng.normal(0.0, RETURN, (len(q), 2))
    return arm, q, x


def test_figures_are_those_of_the_worst_pose(model, cycles):
    arm, q, x = cycles
    result = iso9283(model, calib.Samples(q, x, arm.joint_names))
    middle = np.array([x[k::5].mean(axis=0) for k in range(5)])
    away = [np.linalg.norm(x[k::5] - middle[k], axis=1) for k in range(5)]
    repeatability = max(row.mean() + 3.0 * row.std(ddof=1) for row in away)
    delivered = np.linalg.norm(arm.forward(q[:5]) - middle, axis=1).max()
    document = result.to_json()
    assert document["RP"] == pytest.approx(repeatability)
    assert document["as_delivered"]["AP"] == pytest.approx(delivered, rel=0.1)
    assert document["as_corrected"]["AP"] < 0.1 * delivered
    assert (document["poses"], document["cycles"], result.notes) == (5, 30, ())


def test_what_falls_short_of_the_standard_is_told(model, cycles):
    arm, q, x = cycles
    few = iso9283(model, calib.Samples(q[:12], x[:12], arm.joint_names))
    assert "5 poses with 30 cycles" in few.notes[0]
    with pytest.raises(LogError, match="no pose twice"):
        iso9283(model, calib.Samples(q[:5], x[:5], arm.joint_names))
