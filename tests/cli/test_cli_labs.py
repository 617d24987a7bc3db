"""What labs ask next: noise, ISO 9283, a ROS 2 package, zeros alone, plans above a table."""

import json

import numpy as np
import pytest

import calib

SENSOR, RETURN, OFFSET = 1e-5, 4e-5, 0.004  # [m], [m], [rad] of the elbow


@pytest.fixture(scope="module")
def lab(tmp_path_factory, run):
    """A folder with a log of five poses and thirty cycles, a log to learn from, and a model."""
    folder = tmp_path_factory.mktemp("lab")
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    poses = np.array([[0.4, 0.8], [0.8, 1.2], [1.2, 1.6], [0.5, 2.0], [1.0, 0.7]])
    q = np.repeat(np.tile(poses, (30, 1)), 2, axis=0)
    attained = np.repeat(rng.normal(0.0, RETURN, (150, 2)), 2, axis=0)
    x = arm.forward(q + np.array([0.0, OFFSET])) + attained + rng.normal(0.0, SENSOR, (300, 2))
    q = q + rng.normal(0.0, 1e-5, q.shape)  # encoders read one pose a little otherwise
    calib.write_log(calib.Samples(q, x, arm.joint_names), folder / "cycles.csv")
    learned = calib.babble(arm, 120, noise=2e-5, changes=[f"elbow.offset={OFFSET}"], seed=1)
    calib.write_log(learned, folder / "log.csv")
    train = ("train", "two_link", "--data", folder / "log.csv", "--view", "base", "--size", 4)
    done = run(*train, "-o", folder / "m.calib")
    assert done.code == 0, done.err
    return folder


def test_noise_tells_sensor_and_return_apart(lab, run):
    done = run("noise", lab / "cycles.csv", "--json")
    assert done.code == 0, done.err
    document = done.document
    assert document["sensor"] == pytest.approx(SENSOR, rel=0.15)
    assert document["return"] == pytest.approx(RETURN, rel=0.15)
    assert (document["poses"], document["repeats"]) == (5, 295)
    for name in ("sensor", "return"):
        low, high = document["intervals"][name]
        assert low < document[name] < high
    assert "expected" not in run("noise", lab / "cycles.csv").out
    done = run("noise", lab / "log.csv")
    assert done.code == 1
    assert "none of the log's" in done.err


def test_iso_9283_is_as_delivered_and_as_corrected(lab, run):
    done = run("evaluate", lab / "m.calib", "--data", lab / "cycles.csv", "--iso9283", "--json")
    assert done.code == 3, done.err  # the bound does not hold for these readings
    standard = done.document["iso9283"]
    assert (standard["poses"], standard["cycles"]) == (5, 30)
    # the elbow turns the forearm, 0.25 m to the tip
    assert standard["as_delivered"]["AP"] == pytest.approx(0.25 * OFFSET, rel=0.1)
    assert standard["as_corrected"]["AP"] < 5e-5
    x = calib.read_log(lab / "cycles.csv", calib.load_arm("two_link")).x[::2]
    away = [np.linalg.norm(x[k::5] - x[k::5].mean(axis=0), axis=1) for k in range(5)]
    repeatability = max(row.mean() + 3.0 * row.std(ddof=1) for row in away)
    assert standard["RP"] == pytest.approx(repeatability, rel=0.05)
    assert run("evaluate", lab / "m.calib", "--iso9283").code == 2


def test_zeros_alone_are_told_to_a_fraction_of_all(lab, run):
    urdf = ("urdf", lab / "m.calib", "-o", lab / "new.urdf", "--json")
    everything = run(*urdf).document["offsets"]["elbow"]
    alone = run(*urdf, "--free", "offsets").document["offsets"]["elbow"]
    assert alone["value"] == pytest.approx(OFFSET, abs=2e-4)
    assert alone["interval"] < 0.5 * everything["interval"]


def test_a_plan_stays_above_a_table(tmp_path, run):
    plan = ("plan", "six_axis", "-n", 6, "--above", 0.1, "-o", tmp_path / "poses.csv", "--json")
    done = run(*plan)
    assert done.code == 0, done.err
    assert min(done.document["poses"]["expected_z"]) > 0.1
    assert json.loads(run("plan", "two_link", *plan[2:]).out)["error"]["parameter"] == "--above"
