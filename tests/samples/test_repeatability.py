"""The sensor's noise and the arm's return, apart, from poses that were measured again."""

import numpy as np
import pytest

import calib
from calib.errors import LogError
from calib.samples.repeatability import repeatability

SENSOR, RETURN = 1e-5, 4e-5  # [m]


def visited(poses=12, cycles=10, readings=3, encoder=0.0, seed=0):
    """A log of an arm that goes round its poses, and is read a few times at each."""
    rng = np.random.default_rng(seed)
    arm = calib.load_arm("six_axis")
    places = rng.uniform(arm.lower, arm.upper, (poses, arm.dof))
    pose = np.tile(np.arange(poses), cycles)
    attained = arm.forward(places[pose]) + rng.normal(0.0, RETURN, (len(pose), 3))
    rows = np.repeat(np.arange(len(pose)), readings)
    q = places[pose[rows]] + rng.normal(0.0, encoder, (len(rows), arm.dof))
    x = attained[rows] + rng.normal(0.0, SENSOR, (len(rows), 3))
    return calib.Samples(q, x, arm.joint_names)


@pytest.mark.parametrize("encoder", [0.0, 1e-5, 1e-3])
def test_sensor_and_return_are_told_apart(encoder):
    """Whatever the encoders read at one pose."""
    result = repeatability(visited(encoder=encoder))
    assert (result.poses, result.returns, result.repeats) == (12, 108, 348)
    assert result.sensor == pytest.approx(SENSOR, rel=0.15)
    assert result.arm == pytest.approx(RETURN, rel=0.15)


def test_intervals_hold_the_truth():
    hits = np.zeros(2)
    for seed in range(40):
        result = repeatability(visited(poses=5, cycles=4, readings=2, seed=seed))
        low, high = result.sensor_interval
        hits[0] += low < SENSOR < high
        low, high = result.arm_interval
        hits[1] += low < RETURN < high
    assert (hits >= 34).all()


def test_what_a_log_cannot_tell_is_not_told():
    once_a_visit = repeatability(visited(readings=1))
    assert np.isnan(once_a_visit.sensor)
    assert once_a_visit.arm == pytest.approx(np.hypot(SENSOR, RETURN), rel=0.15)
    at_rest = repeatability(visited(poses=4, cycles=1, readings=5))
    assert np.isnan(at_rest.arm)
    assert at_rest.sensor == pytest.approx(SENSOR, rel=0.4)
    with pytest.raises(LogError, match="none of the log's"):
        repeatability(visited(cycles=1, readings=1))
