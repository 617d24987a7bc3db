"""Clocks of a camera and of joints: what is accepted is right, what is doubtful is refused."""

import numpy as np
import pytest

from calib.recording.clocks import SURE, ClockError, align_clocks, joints_at
from calib.samples.delays import estimate_delay

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


def filmed(time, q, rng, rate=0.0):
    """A track at 30 frames a second whose clock starts at 0 and runs too fast by `rate`."""
    true = np.arange(5.0, 23.0, 1 / 30)
    x = pixels(joints_at(true, time, q))
    return (true - 5.0) * (1 + rate), x + rng.normal(0, 0.05, x.shape), true


@pytest.mark.parametrize(("rate", "epoch"), [(0.0, 0.0), (0.001, 1.7e9), (-0.004, 0.0)])
def test_offset_and_rate_are_found(rate, epoch):
    rng = np.random.default_rng(1)
    joint_time, q = stops(40, rng, dof=3 if epoch else 2)
    time, x, true = filmed(joint_time, q, rng, rate)
    x[rng.random(len(x)) < 0.05] = rng.uniform(0, 700, 2)  # jumps of the track
    x[rng.random(len(x)) < 0.1] = np.nan
    clocks = align_clocks(time, x, joint_time + epoch, q)
    miss = np.abs(clocks.joints_time(time) - (true + epoch)).max()
    assert miss < min(2e-3, 4.0 * clocks.doubt)
    assert clocks.doubt < SURE
    assert "sure to 1.5 ms" in clocks.words()


@pytest.mark.parametrize("case", ["repeats itself", "another run", "rate", "still", "joints still"])
def test_what_is_doubtful_is_refused(case):
    rng = np.random.default_rng(3)
    joint_time, q = stops(40, rng)
    if case == "repeats itself":
        wave = 2 * np.pi * joint_time / 4.0
        q = 0.5 * np.stack([np.sin(wave), np.cos(wave)], 1)
    time, x, _ = filmed(joint_time, q, rng, 0.02 if case == "rate" else 0.0)
    if case == "another run":
        joint_time, q = stops(40, rng)
    if case == "still":
        x = x[:1] + rng.normal(0, 0.05, x.shape)
    if case == "joints still":
        q = q[:1] + 0 * q
    with pytest.raises(ClockError, match="never moves" if "still" in case else "no offset"):
        align_clocks(time, x, joint_time, q)


def test_a_delay_is_as_sure_as_its_interval_says():
    rng = np.random.default_rng(0)
    time = np.linspace(-1.0, 1.0, 200)
    velocity = np.stack([np.sin(4.0 * time), np.cos(3.0 * time)], axis=1)
    waves = [np.sin(w * time + p) for w in (1.0, 2.0, 3.0, 4.0, 5.0) for p in (0.0, 1.5)]
    columns = np.stack([np.stack(waves), np.stack(waves)[::-1]], axis=0).transpose(2, 0, 1)
    apart = []
    for _ in range(200):
        residual = 1e-3 * rng.standard_normal((200, 2)) - 0.02 * velocity
        delay, _ = estimate_delay(residual, velocity, columns, np.full(10, 1e-6), np.zeros(10))
        apart.append((delay.value - 0.02) / delay.sd)
    assert 0.8 < np.std(apart) < 1.2
