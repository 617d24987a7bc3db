"""The monitor: a stream of samples, one at a time."""

import numpy as np
import pytest
from drifting import log, model

import calib


def last(monitor, samples):
    for q, x in zip(samples.q, samples.x, strict=True):
        monitor.update(q, x)
    return monitor.state


def alarm(monitor, samples):
    for k, (q, x) in enumerate(zip(samples.q, samples.x, strict=True)):
        if monitor.update(q, x).drifted:
            return k
    return None


@pytest.mark.parametrize("trained_noise", [0.0, 1e-3])
@pytest.mark.parametrize("noise", [1e-3, 2e-3])
def test_a_calm_stream_raises_no_alarm(trained_noise, noise):
    assert alarm(calib.monitor(model(trained_noise)), log(n=1500, noise=noise)) is None


@pytest.mark.parametrize(
    "change",
    ["shoulder.length=-5%", "elbow.offset=0.0174533", "sensor.rotate=0.0174533", "elbow.lock=1.0"],
)
def test_a_change_within_a_stream(change):
    monitor = calib.monitor(model(1e-3))
    assert alarm(monitor, log(n=300)) is None
    assert alarm(monitor, log(change, n=200, seed=2)) is not None


def test_an_alarm_ends_when_the_change_is_undone():
    monitor = calib.monitor(model(1e-3))
    assert last(monitor, log("elbow.length=+5%", n=100)).drifted
    assert not last(monitor, log(n=1500, seed=3)).drifted


def test_noise_and_systematic_part_are_told_apart():
    state = last(calib.monitor(model()), log(n=2000, noise=2e-3))
    assert state.noise == pytest.approx(2e-3, rel=0.15)
    state = last(calib.monitor(model()), log("sensor.shift=0.01,0", n=2000, noise=2e-3))
    assert state.links == pytest.approx(0.01, rel=0.05)


def test_wrong_detections_raise_no_alarm():
    assert alarm(calib.monitor(model(1e-3)), log("sensor.outliers=0.02", n=1000)) is None


def test_samples_that_say_nothing_change_nothing():
    monitor = calib.monitor(model(1e-3))
    before = last(monitor, log(n=100))
    assert monitor.update([np.nan, 1.0], [0.1, 0.1]) == before
    assert monitor.update([9.0, 1.0], [0.1, 0.1]) == before
