"""Check: what undisturbed and changed arms look like to a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, log, model

import calib
from calib.change.systematic import orthonormal, systematic
from calib.errors import LogError, ModelError


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("trained_noise", [0.0, 1e-3])
def test_nothing_changed(seed, trained_noise):
    drift = model(trained_noise).check(log(seed=seed + 50))
    assert not drift.drifted
    assert drift.score < 1
    assert drift.fired == ()


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ("shoulder.length=+5%", "length:shoulder"),
        ("elbow.length=-5%", "length:elbow"),
        ("elbow.offset=0.0174533", "offset:elbow"),
        ("sensor.shift=0.01,0", "sensor"),
        ("sensor.mirror=x", "sensor"),
        ("sensor.scale=1000", "sensor"),
        ("elbow.lock=1.0", "lost:elbow"),
        ("elbow.length=0.001", "lost:elbow"),
        ("tip.offset=0.01,0.02", "geometry"),
    ],
)
def test_a_change_is_found_and_named(change, cause):
    drift = model(1e-3).check(log(change))
    assert drift.drifted
    assert "links" in drift.fired
    assert cause in drift.causes
    assert "noise" not in drift.causes


def test_a_turned_sensor_and_an_offset_of_the_first_joint_are_the_same():
    for change in ("sensor.rotate=0.02", "shoulder.offset=0.02"):
        drift = model(1e-3).check(log(change))
        assert {"sensor", "offset:shoulder"} <= set(drift.causes)
        assert any("are the same" in text for text in drift.explanations)


def test_the_size_of_a_change_is_told():
    drift = model().check(log("elbow.length=+8%", noise=0.0))
    assert any("8 % (20 mm) longer" in text for text in drift.explanations)
    drift = model().check(log("elbow.offset=0.05", noise=0.0))
    assert any(f"off by {np.degrees(0.05):.3g} deg" in text for text in drift.explanations)


def test_more_noise_alone_is_noise():
    drift = model(1e-3).check(log(noise=2e-3))
    assert not drift.drifted
    assert drift.causes == ("noise",)
    assert drift.noise == pytest.approx(2e-3, rel=0.1)
    assert drift.usual_noise == pytest.approx(1e-3, rel=0.1)


def test_a_shorter_arm_leaves_part_of_the_workspace():
    drift = model(1e-3).check(log("elbow.length=-40%"))
    assert "reverse" in drift.fired
    assert "workspace" in drift.causes


def test_a_longer_arm_leaves_the_sensory_map():
    drift = model(1e-3).check(log("elbow.length=+20%"))
    assert "sensory" in drift.fired


def test_outliers_are_no_drift():
    drift = model(1e-3).check(log("sensor.outliers=0.05"))
    assert not drift.drifted
    assert drift.outliers >= 3


def test_a_log_of_one_corner():
    samples = log(n=2000)
    corner = samples.take((samples.q < arm().lower + 0.3 * (arm().upper - arm().lower)).all(axis=1))
    drift = model(1e-3).check(corner)
    assert not drift.drifted
    assert any("covers" in note for note in drift.notes)


def test_json_holds_values_thresholds_and_the_verdict():
    found = model(1e-3).check(log()).to_json()
    assert found["threshold"] == 1
    assert set(found["distortion"]) == {"motor", "sensory", "reverse", "links"}
    ratios = [s["value"] / s["threshold"] for s in found["distortion"].values()]
    assert found["score"] == pytest.approx(max(ratios))


def test_order_and_repeated_rows_do_not_matter():
    samples = log("elbow.length=+5%")
    order = np.random.default_rng(0).permutation(len(samples))
    twice = samples.take(np.concatenate([order, order]))
    one, two = model(1e-3).check(samples), model(1e-3).check(twice)
    assert two.samples == one.samples
    assert two.score == pytest.approx(one.score, rel=1e-6)
    assert any("repeated" in note for note in two.notes)


def test_systematic_part_is_a_projection():
    rng = np.random.default_rng(0)
    basis = orthonormal(rng.standard_normal((50, 4)))
    assert np.allclose(basis.T @ basis, np.eye(4))
    inside = basis @ rng.standard_normal((4, 2))
    part = systematic(basis, inside, floor=1e-9)
    assert part.value == pytest.approx(np.sqrt(np.mean(np.sum(inside**2, axis=1))))
    assert part.noise < 1e-12
    assert part.fired


def test_another_robot():
    foreign = replace(log(), joint_names=("a", "b"))
    with pytest.raises(LogError, match=r"a, b.*shoulder, elbow"):
        model().check(foreign)


def test_joints_in_another_order_are_sorted():
    samples = log()
    turned = replace(
        samples,
        joint_names=("elbow", "shoulder"),
        q=samples.q[:, ::-1],
        lower=samples.lower[::-1],
        upper=samples.upper[::-1],
    )
    assert model().check(turned).score == model().check(samples).score


def test_three_rows():
    with pytest.raises(LogError, match="3 different rows, expected at least 10"):
        model().check(log(n=3))


def test_identical_rows():
    with pytest.raises(LogError, match="1 different rows"):
        model().check(log().take(np.zeros(50, dtype=int)))


def test_swapped_joint_columns():
    samples = calib.babble(arm().with_range({"elbow": (0.3, 1.5)}), 300, seed=0, noise=1e-3)
    wrong = replace(samples, q=samples.q[:, ::-1], simulation=None)
    with pytest.raises(LogError, match=r"exchanged.*--columns shoulder=elbow,elbow=shoulder"):
        model().check(wrong)


def test_degrees():
    wrong = replace(log(), q=np.rad2deg(log().q), simulation=None)
    with pytest.raises(LogError, match="degrees"):
        model().check(wrong)


def test_a_model_without_a_baseline():
    with pytest.raises(ModelError, match="train it again"):
        replace(model(), baseline=None).check(log())


def test_the_baseline_travels_with_the_file(tmp_path):
    model(1e-3).save(tmp_path / "m.calib")
    loaded = calib.load(tmp_path / "m.calib")
    samples = log("elbow.offset=0.01")
    assert loaded.check(samples).to_json() == model(1e-3).check(samples).to_json()
