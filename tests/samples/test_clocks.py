"""Clocks of a camera and of joints: what is accepted is right, what is doubtful is refused."""

import numpy as np
import pytest

from calib.recording.clocks import SURE, ClockError, align_clocks, joints_at
from calib.recording.track import row_shift

LENGTHS = np.array([0.18, 0.14, 0.09])


def pixels(q):
    """A tilted camera with a lens over a planar arm."""
    phi = np.cumsum(q + np.array([0.6, 0.5, -0.4])[: q.shape[1]], axis=1)
    p = (np.stack([np.cos(phi), np.sin(phi)], -1) * LENGTHS[: q.shape[1], None]).sum(1)
    n = (p - [0.2, 0.1]) / (1 + 0.35 * (p[:, 1:] - 0.1))
    return 640 + 1100 * n * (1 - 0.15 * (n**2).sum(1, keepdims=True))


def stops(duration, rng, dof=2, pace=1.2):
    """Joints at 100 Hz that go from stop to stop."""
    time = np.arange(0.0, duration, 0.01)
    goals = rng.uniform(-0.9, 0.9, (int(duration / pace) + 2, dof))
    k = (time / pace).astype(int)
    s = np.clip((time / pace - k) / 0.5, 0, 1)[:, None]
    s = s**3 * (10 - 15 * s + 6 * s**2)
    return time, goals[k] * (1 - s) + goals[k + 1] * s


def filmed(time, q, start, length, rate=0.0, noise=0.05, rng=None):
    """A track at 30 frames a second whose clock starts at 0 and runs too fast by `rate`."""
    true = np.arange(start, start + length, 1 / 30)
    x = pixels(joints_at(true, time, q))
    if rng is not None:
        x = x + rng.normal(0, noise, x.shape)
    return (true - start) * (1 + rate), x, true


@pytest.mark.parametrize(("rate", "epoch"), [(0.0, 0.0), (0.001, 1.7e9), (-0.004, 0.0)])
def test_offset_and_rate_are_found(rate, epoch):
    rng = np.random.default_rng(1)
    joint_time, q = stops(40, rng, dof=3 if epoch else 2)
    time, x, true = filmed(joint_time, q, 5.0, 18.0, rate, rng=rng)
    x[rng.random(len(x)) < 0.05] = rng.uniform(0, 700, 2)  # jumps of the track
    x[rng.random(len(x)) < 0.1] = np.nan
    clocks = align_clocks(time, x, joint_time + epoch, q)
    error = clocks.joints_time(time) - (true + epoch)
    assert np.abs(error).max() < 2e-3
    assert clocks.doubt < SURE


def test_a_motion_that_repeats_itself_is_refused():
    rng = np.random.default_rng(2)
    t = np.arange(0, 40, 0.01)
    wave = 2 * np.pi * t / 4.0
    q = 0.5 * np.stack([np.sin(wave), np.cos(wave), 0.5 * np.sin(2 * wave)], 1)
    time, x, _ = filmed(t, q, 6.0, 20.0, rng=rng)
    with pytest.raises(ClockError, match="no offset"):
        align_clocks(time, x, t, q)


def test_the_joints_of_another_run_are_refused():
    rng = np.random.default_rng(3)
    joint_time, q = stops(30, rng)
    time, x, _ = filmed(joint_time, q, 5.0, 18.0, rng=rng)
    with pytest.raises(ClockError, match="no offset"):
        align_clocks(time, x, *stops(30, rng))


def test_an_arm_that_stands_still_matches_nothing():
    rng = np.random.default_rng(4)
    joint_time, q = stops(20, rng)
    time, x, _ = filmed(joint_time, q, 2.0, 12.0)
    with pytest.raises(ClockError, match="never moves"):
        align_clocks(time, x[:1] + rng.normal(0, 0.05, x.shape), joint_time, q)
    with pytest.raises(ClockError, match="never moves"):
        align_clocks(time, x, joint_time, q[:1] + 0 * q)


def test_a_frame_rate_that_is_far_off_is_refused():
    rng = np.random.default_rng(5)
    joint_time, q = stops(30, rng)
    time, x, _ = filmed(joint_time, q, 5.0, 18.0, 0.02, rng=rng)
    with pytest.raises(ClockError, match="no offset"):
        align_clocks(time, x, joint_time, q)


@pytest.mark.parametrize("shift", [-2, -1, 1, 2])
def test_a_shift_of_rows_is_noticed(shift):
    rng = np.random.default_rng(8)
    q = rng.uniform(-1, 1, (58, 3))
    x = pixels(q) + rng.normal(0, 0.05, (58, 2))
    assert row_shift(q, x)[0] == 0
    assert row_shift(np.roll(q, shift, axis=0), x)[0] == shift
