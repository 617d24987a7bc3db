"""Check: what undisturbed and changed arms look like to a model."""

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib import OptionError


def names(drift):
    return {cause.cause for cause in drift.causes}


def test_a_turned_sensor_and_an_offset_of_the_first_joint_are_the_same():
    for change in ("sensor.rotate=0.02", "shoulder.offset=0.02"):
        drift = calib.check(model(1e-3), log(change))
        assert {"sensor", "offset:shoulder"} <= names(drift)
        assert any("are the same" in text for text in drift.notes)
        sizes = {c.cause: c.value for c in drift.causes}
        assert sizes["sensor"] == pytest.approx(0.02, abs=2e-3)
        assert sizes["offset:shoulder"] == pytest.approx(0.02, abs=2e-3)


def test_what_is_known_of_a_change_is_believed():
    turned = log("sensor.rotate=0.02")
    assert names(calib.check(model(1e-3), turned, cause="joints")) == {"offset:shoulder"}
    longer = log("elbow.length=+5%")
    assert "length:elbow" in names(calib.check(model(1e-3), longer, cause="joints"))
    assert "length:elbow" not in names(calib.check(model(1e-3), longer, cause="sensor"))
    with pytest.raises(OptionError, match="sensor, joints"):
        calib.check(model(1e-3), longer, cause="wind")


def test_the_size_of_a_change_is_told():
    drift = calib.check(model(), log("elbow.length=+8%", noise=0.0))
    (length,) = [c for c in drift.causes if c.cause == "length:elbow"]
    assert length.unit == "m"
    assert length.value == pytest.approx(0.02, rel=1e-3)
    assert length.interval[0] < 0.02 < length.interval[1]
    assert length.words.startswith("the link of elbow is 8 % (20 ± ")
    assert length.words.endswith("mm) longer")
    drift = calib.check(model(), log("elbow.offset=0.05", noise=0.0))
    assert any("elbow is off by +2.86 ± " in text for text in drift.explanations)


def test_rows_that_show_too_little_say_so():
    corner = log(n=2000)
    corner = corner.take((corner.q < arm().lower + 0.15 * (arm().upper - arm().lower)).all(axis=1))
    fine, coarse = (calib.check(model(1e-3), s) for s in (log(n=400), corner))
    assert coarse.smallest > 3 * fine.smallest
    between = (fine.smallest * coarse.smallest) ** 0.5
    assert calib.check(model(1e-3), log(n=400), tolerance=between).drifted is False
    assert calib.check(model(1e-3), corner, tolerance=between).drifted is None
    # what changed has changed, whatever is tolerated
    assert calib.check(model(1e-3), log("elbow.length=+5%"), tolerance=1e-9).drifted is True


@pytest.mark.parametrize("spoil", ["shuffled", "lag", "other"])
def test_a_log_that_nothing_explains(spoil):
    rng = np.random.default_rng(0)
    u = np.cumsum(rng.normal(0, 0.03, (400, 2)), axis=0)
    u = 0.5 + 0.45 * np.sin(3 * u)
    q = arm().lower + u * (arm().upper - arm().lower)
    x = arm().forward(q) + 1e-3 * rng.standard_normal((400, 2))
    if spoil == "shuffled":
        x = x[rng.permutation(400)]
    elif spoil == "lag":
        q, x = q[12:], x[:-12]
    else:
        q = arm().lower + rng.random((400, 2)) * (arm().upper - arm().lower)
    bad = replace(log(n=len(q)), q=q, x=x, simulation=None)
    drift = calib.check(model(1e-3), bad)
    assert drift.drifted
    assert names(drift) == {"unknown"}
    assert "nothing explains the log" in drift.explanations[0]
    assert ("by 12 rows" in drift.explanations[0] or "by -12 rows" in drift.explanations[0]) == (
        spoil == "lag"
    )
    found = calib.adapt(model(1e-3), bad)
    assert not found.improved
    assert found.model is model(1e-3)
    assert any("nothing explains the log" in note for note in found.notes)


def test_a_sensor_moved_by_its_own_noise_is_found():
    arm = calib.load_arm("two_link")
    trained = calib.train(replace(calib.babble(arm, 1000, noise=1e-4), simulation=None), size=8)
    samples = calib.babble(arm, 400, seed=3, noise=1e-4, changes=["sensor.shift=0.0001,0"])
    drift = calib.check(trained, replace(samples, simulation=None))
    assert drift.drifted
    assert "sensor" in names(drift)
    assert drift.adapts is calib.adapt(trained, replace(samples, simulation=None)).improved
