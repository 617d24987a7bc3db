"""Judge: one verdict on a log, with its causes, its intervals and what the rows cannot tell."""

import numpy as np
import pytest

import calib
from calib import OptionError

NOISE = 2e-4
DEGREE = float(np.radians(1.0))


@pytest.fixture(scope="module")
def planar():
    arm = calib.load_arm("two_link")
    return arm, calib.train(calib.babble(arm, 400, noise=NOISE, seed=7), size=6)


@pytest.fixture(scope="module")
def spatial():
    arm = calib.load_arm("six_axis")
    return arm, calib.train(calib.babble(arm, 400, noise=NOISE, seed=7), size=6)


@pytest.mark.parametrize("changes", [(), ("elbow.offset=0.005",)])
def test_few_rows_say_nothing(spatial, changes):
    arm, model = spatial
    log = calib.babble(arm, 11, noise=NOISE, seed=3, changes=list(changes))
    verdict = calib.judge(model, log)
    assert verdict.changed is None
    assert verdict.words == "too few rows to say"
    assert calib.check(model, log).drifted is None
    assert calib.recognise([model], log).index is None


def test_the_drawing_is_trusted_but_the_zeros(spatial):
    arm, model = spatial
    log = calib.babble(arm, 60, noise=NOISE, seed=11, changes=["elbow.offset=0.0174533"])
    made = calib.adapt(model, log, free="offsets")
    (cause,) = made.changed
    assert cause.cause == "offset:elbow"
    assert cause.interval[0] < DEGREE < cause.interval[1]
    assert made.after["mean"] < 2 * NOISE
    with pytest.raises(OptionError, match="free 'links' is unknown"):
        calib.adapt(model, log, free="links")


def test_noise_that_lasts_raises_no_alarm(planar):
    """Of noise alike from sample to sample (.98) 12 alarms rose in 10,000 samples."""
    arm, model = planar
    rng = np.random.default_rng(0)
    samples = 1500
    q = rng.uniform(arm.lower, arm.upper, (samples, 2))
    noise = np.zeros((samples, 2))
    fresh = np.sqrt(1 - 0.98**2) * rng.standard_normal((samples, 2))
    for k in range(1, samples):
        noise[k] = 0.98 * noise[k - 1] + fresh[k]
    monitor = calib.monitor(model)
    x = arm.forward(q) + NOISE * noise
    alarms = [monitor.update(*sample).drifted for sample in zip(q, x, strict=True)]
    assert not any(alarms)
