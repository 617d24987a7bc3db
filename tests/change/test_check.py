"""Check: what undisturbed and changed arms look like to a model."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib.errors import LogError, ModelError, OptionError


def names(drift):
    return {cause.cause for cause in drift.causes}


@cache
def measured_model():
    return calib.train(waved(0.0, 120, seed=5), size=5)


def waved(size, n, seed):
    """A measured log of an arm whose joints follow waves of `size` rad."""
    q = log(n=n, seed=seed).q
    x = arm().forward(q + size * np.sin([11.0, 17.0] * q))
    x += 2e-4 * np.random.default_rng(seed).standard_normal(q.shape)
    return calib.Samples(q, x, arm().joint_names, arm().lower, arm().upper, (True, True))


@pytest.mark.parametrize("size", [0.0, 2e-3])
def test_waves_look_like_noise_to_the_tests_of_groups(size):
    """Waves finer than the rows are those of a noisy encoder; `adapt` says what `check` says."""
    worn = waved(size, 60, seed=7)
    drift, found = calib.check(measured_model(), worn), calib.adapt(measured_model(), worn)
    assert drift.fired == ()
    assert drift.drifted is found.improved
    # one joint is named, the waves of the other are scatter
    assert names(drift) == ({"noise:shoulder", "noise"} if size else set())
    json.dumps(drift.to_json())


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


def test_rows_beyond_their_bound_that_no_test_explains_are_drift():
    measured = replace(log(n=400, noise=2e-4, seed=3), simulation=None)
    trained = calib.train(measured, size=20)
    # 12 rows of one corner, 1 mm off in a way that is none of an arm
    rng = np.random.default_rng(0)
    q = arm().lower + (arm().upper - arm().lower) * rng.uniform(0.7, 0.95, (12, 2))
    x = arm().forward(q) + 2e-4 * rng.standard_normal((12, 2))
    bent = replace(log(n=12), q=q, x=x + 1e-3 * np.sin(40.0 * x[:, ::-1]), simulation=None)
    drift = calib.check(trained, bent)
    assert drift.drifted
    assert any("of the rows are further" in text for text in drift.notes)
    assert not calib.check(trained, replace(bent, x=x)).drifted
    # as far off, without any order
    noisy = calib.check(model(1e-3), log(n=120, noise=8e-3))
    assert not noisy.drifted
    assert any("a noisier sensor" in text for text in noisy.notes)


def test_a_shorter_arm_leaves_part_of_the_workspace():
    drift = calib.check(model(1e-3), log("elbow.length=-40%"))
    assert drift.distortion["reverse"].score > 1
    assert "length:elbow" in names(drift)


def test_a_log_of_one_corner():
    samples = log(n=2000)
    corner = samples.take((samples.q < arm().lower + 0.3 * (arm().upper - arm().lower)).all(axis=1))
    drift = calib.check(model(1e-3), corner)
    assert not drift.drifted
    assert any("covers" in note for note in drift.notes)


def test_json_holds_values_thresholds_and_the_verdict():
    found = calib.check(model(1e-3), log()).to_json()
    assert found["threshold"] == 1
    assert set(found["distortion"]) == {"motor", "sensory", "reverse", "links"}
    assert found["score"] < 1
    assert found["drifted"] is False
    assert 0 < found["smallest"] < 5e-3
    assert found["smallest"] == max(found["smallest_by_group"].values())
    changed = calib.check(model(1e-3), log("elbow.offset=0.0174533")).to_json()
    assert set(changed["causes"][0]) == {"cause", "group", "value", "interval", "unit", "words"}
    assert changed["causes"][0]["group"] == "offset"
    assert "offset:elbow" in changed["fired"]


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


def test_order_and_repeated_rows_do_not_matter():
    samples = log("elbow.length=+5%")
    order = np.random.default_rng(0).permutation(len(samples))
    twice = samples.take(np.concatenate([order, order]))
    one, two = calib.check(model(1e-3), samples), calib.check(model(1e-3), twice)
    assert two.samples == one.samples
    # rows that err together count once: their order tells which do
    assert two.score == pytest.approx(one.score, rel=0.3)
    assert any("repeated" in note for note in two.notes)


def test_swapped_joint_columns():
    samples = calib.babble(arm().with_range({"elbow": (0.3, 1.5)}), 300, seed=0, noise=1e-3)
    wrong = replace(samples, q=samples.q[:, ::-1], simulation=None)
    with pytest.raises(LogError, match=r"exchanged.*columns=.*shoulder.*elbow"):
        calib.check(model(), wrong)


def test_a_model_without_a_baseline():
    with pytest.raises(ModelError, match="train it again"):
        calib.check(replace(model(), baseline=None), log())


def test_the_baseline_travels_with_the_file(tmp_path):
    model(1e-3).save(tmp_path / "m.calib")
    loaded = calib.load(tmp_path / "m.calib")
    samples = log("elbow.offset=0.01")
    assert calib.check(loaded, samples).to_json() == calib.check(model(1e-3), samples).to_json()


@pytest.mark.parametrize(
    ("robot", "joint", "size"),
    [("three_link", "shoulder", 0.003), ("six_axis", "elbow", 0.005)],
)
def test_a_noisy_encoder_has_its_size_and_its_mean_is_no_offset(robot, joint, size):
    """Robust weights took its larger errors for outliers: 3 mrad passed for 2, and drifted."""
    arm = calib.load_arm(robot)
    rows = calib.babble(arm, 400, seed=78, noise=1e-4)
    trained = calib.train(replace(rows, simulation=None), size=8)
    samples = calib.babble(arm, 100, seed=2001, noise=1e-4, changes=[f"{joint}.noise={size}"])
    samples = replace(samples, simulation=None)
    drift = calib.check(trained, samples)
    assert not drift.drifted
    assert drift.causes[0].cause == f"noise:{joint}"
    assert drift.causes[0].value == pytest.approx(size, rel=0.25)
    assert not calib.adapt(trained, samples).improved


def test_a_sensor_moved_by_its_own_noise_is_found():
    arm = calib.load_arm("two_link")
    trained = calib.train(replace(calib.babble(arm, 1000, noise=1e-4), simulation=None), size=8)
    samples = calib.babble(arm, 400, seed=3, noise=1e-4, changes=["sensor.shift=0.0001,0"])
    drift = calib.check(trained, replace(samples, simulation=None))
    assert drift.drifted
    assert "sensor" in names(drift)
    assert drift.adapts is calib.adapt(trained, replace(samples, simulation=None)).improved
