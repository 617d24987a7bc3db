"""A log that was misread is told in check and adapt as it is in train."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Samples


def posed(n=150, seed=0):
    arm = calib.load_arm("spatial_three")
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (n, 3))
    x, turns = arm.pose(q)
    x = x + rng.normal(0.0, 1e-4, x.shape)
    known = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
    return Samples(q, x, *known, arm=arm, orientation=turns)


def test_quaternions_that_begin_with_w_are_refused_by_adapt():
    """It said "tool turned by 171 deg", exit 0."""
    model = calib.train(posed(), size=6)
    log = posed(60, seed=1)
    wrong = replace(log, orientation=log.orientation[:, [3, 0, 1, 2]])
    with pytest.raises(calib.LogError, match="order w, x, y, z"):
        calib.adapt(model, wrong)
    with pytest.raises(calib.LogError, match="inverted"):
        calib.check(model, replace(log, orientation=log.orientation * (-1, -1, -1, 1)))
    assert not calib.check(model, log).drifted


def test_a_late_log_is_no_drift():
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(1)
    t = np.arange(400) / 25.0

    def q(t):
        return np.stack([0.8 + 0.6 * np.sin(0.9 * t), 1.4 + 0.8 * np.sin(1.6 * t + 1)], axis=1)

    def log(late):
        x = arm.forward(q(t - late)) + rng.normal(0.0, 1e-4, (400, 2))
        known = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
        return Samples(q(t), x, *known, arm=arm, time=t)

    model = calib.train(log(0.0), size=8)
    found = calib.check(model, log(0.03))
    assert not found.drifted
    assert any("late against the joints" in note for note in found.notes)


def test_a_flipped_elbow_is_told_and_the_shoulder_is_not_blamed():
    """An elbow's sign flipped in 100 rows: the shoulder was blamed."""
    arm = calib.load_arm("two_link_full")

    def log(n, seed):
        return replace(calib.babble(arm, n, seed=seed, noise=2e-4), simulation=None)

    model, flipped = calib.train(log(300, 0), size=8), log(100, 1)
    flipped = replace(flipped, q=flipped.q * [1.0, -1.0])
    drift, made = calib.check(model, flipped), calib.adapt(model, flipped)
    for causes in (drift.causes, made.changed):
        assert [cause.cause for cause in causes] == ["sign:elbow"]
        assert "elbow turns the other way" in causes[0].words
    assert drift.drifted
    assert made.improved
    assert made.after["mean"] < 5e-4
