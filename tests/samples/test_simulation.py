"""The simulated arm and sensor against closed forms; changes are read as typed, or refused."""

import numpy as np
import pytest
from models import L1, L2, two_link
from numpy.testing import assert_allclose
from refusals import refused

from calib import OptionError, Simulation, babble

CHANGES = [
    ("elbow.length=+20%", lambda q: two_link(q, l2=1.2 * L2)),
    ("elbow.length=0.1", lambda q: two_link(q, l2=0.1)),
    ("shoulder.length=-10%", lambda q: two_link(q, l1=0.9 * L1)),
    ("shoulder.offset=0.05", lambda q: two_link(q + np.array([0.05, 0]))),
    ("elbow.gear=1.02", lambda q: two_link(q * [1, 1.02])),
    ("elbow.lock=1.0", lambda q: two_link(q * [1, 0] + [0, 1.0])),
    ("tip.offset=0.01,0.02", lambda q: two_link(q, tip=(0.01, 0.02))),
    ("sensor.mirror=x", lambda q: two_link(q) * [-1, 1]),
    ("sensor.mirror=y", lambda q: two_link(q) * [1, -1]),
    ("sensor.scale=1.05", lambda q: 1.05 * two_link(q)),
    ("sensor.rotate=0.14", lambda q: two_link(q) @ rotation(0.14).T),
    ("sensor.shift=0.03,-0.02", lambda q: two_link(q) + np.array([0.03, -0.02])),
    ("elbow.noise=0.1", two_link),
    ("elbow.backlash=0.1", two_link),
    ("sensor.outliers=0.5", two_link),
]
IMPOSSIBLE = [
    ({"n": 0}, "samples is 0, expected a whole number, 1 to"),
    ({"n": 10_000_001}, "10,000,000"),
    ({"n": True}, "samples is True, expected a whole number"),
    ({"seed": -1}, "seed is -1"),
    *(({"noise": bad}, "noise is") for bad in (-1e-9, float("nan"), float("inf"), "1", None)),
    ({"changes": "wrist.length=1"}, "no joint 'wrist'; choices: shoulder, elbow, sensor, tip"),
]
UNREADABLE = [
    ("", "WHO.WHAT=VALUE"),
    (".length=3", "WHO.WHAT=VALUE"),
    ("elbow.colour=3", r"length\|offset\|gear\|noise\|backlash\|lock"),
    ("sensor.colour=3", r"mirror\|scale\|rotate\|shift\|outliers"),
    ("tip.length=x", "tip.offset"),
    ("tip.size=1", "tip.offset"),
    ("elbow.length=20%", r"\+20% or 0.3"),
    ("elbow.length=-100%", "above zero"),
    ("elbow.offset=5%", "0.05"),
    ("elbow.gear=0", "lock"),
    ("elbow.noise=-1", "negative"),
    ("sensor.shift=1", "0.03,-0.02"),
    ("sensor.mirror=z", "x or y"),
    ("sensor.outliers=1", "below 1"),
    ("tip.offset=1,inf", "0.01,0.02"),
]


@pytest.fixture(scope="module")
def q(arm):
    return np.random.default_rng(1).uniform(arm.lower, arm.upper, (500, 2))


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize(("change", "truth"), CHANGES)
def test_each_change_in_closed_form(arm, q, change, truth):
    sim = Simulation(arm, 0.01, [change])
    assert_allclose(sim.exact(q), truth(q), atol=1e-12)
    assert_allclose(sim.exact(q[3]), truth(q)[3], atol=1e-12)


def test_sensor_changes_apply_as_mirror_scale_rotate_shift_in_any_order_given(arm, q):
    given = ["sensor.shift=1,2", "sensor.rotate=0.5", "sensor.scale=3", "sensor.mirror=y"]
    expected = (3 * two_link(q) * [1, -1]) @ rotation(0.5).T + [1, 2]
    for order in (given, given[::-1]):
        assert_allclose(Simulation(arm, changes=order).exact(q), expected, atol=1e-12)


def test_sensor_noise_has_the_stated_deviation_on_each_axis(arm, q):
    many = np.repeat(q, 100, axis=0)
    sim = Simulation(arm, 2e-3)
    error = sim.measure(many, np.random.default_rng(0)) - sim.exact(many)
    assert_allclose(error.std(axis=0), 2e-3, rtol=0.02)
    assert_allclose(error.mean(axis=0), 0.0, atol=4e-5)
    assert abs(np.corrcoef(error.T)[0, 1]) < 0.02


def test_outliers_hit_the_stated_share_and_stay_in_the_box(arm, q):
    many = np.repeat(q, 40, axis=0)
    sim = Simulation(arm, changes=["sensor.outliers=0.05", "sensor.shift=5,5"])
    x = sim.measure(many, np.random.default_rng(0))
    hit = (x != sim.exact(many)).any(axis=1)
    assert hit.mean() == pytest.approx(0.05, abs=0.005)
    seen = sim.exact(sim.draw(4096, np.random.default_rng(0)))
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert ((x[hit] >= low) & (x[hit] <= high)).all()
    assert np.ptp(x[hit], axis=0) == pytest.approx(high - low, rel=0.02)


def test_backlash_delays_the_joint_in_a_measurement(arm):
    q = np.array([[0.2, 1.0], [0.2, 1.5], [0.2, 1.45], [0.2, 1.0]])
    sim = Simulation(arm, changes=["elbow.backlash=0.2"])
    stood = np.array([[0.2, 1.0], [0.2, 1.4], [0.2, 1.4], [0.2, 1.1]])
    assert_allclose(sim.measure(q, np.random.default_rng(0)), two_link(stood))


def test_babbling_stays_within_and_covers_the_range(arm):
    log = babble(arm, 4000)
    assert log.q.shape == (4000, 2)
    assert ((log.q >= arm.lower) & (log.q <= arm.upper)).all()
    unit = (log.q - arm.lower) / (arm.upper - arm.lower)
    cells = np.histogram2d(*unit.T, bins=20, range=[[0, 1], [0, 1]])[0]
    assert cells.min() >= 1  # 10 a cell on average
    assert cells.std() == pytest.approx(np.sqrt(10), abs=0.6)  # Poisson
    assert_allclose(log.x, arm.forward(log.q), atol=1e-15)


@pytest.mark.parametrize(("arguments", "message"), IMPOSSIBLE)
def test_impossible_arguments_are_refused_in_one_line(arm, arguments, message):
    refused(OptionError, message, babble, arm, **{"n": 10, **arguments})


@pytest.mark.parametrize(("text", "expected"), UNREADABLE)
def test_refused_with_what_was_expected(arm, text, expected):
    assert repr(text) in str(refused(OptionError, expected, Simulation, arm, changes=[text]))


def test_the_same_thing_changed_twice_is_refused(arm):
    once = ["elbow.lock=1", "shoulder.lock=1"]
    twice = [*once, "elbow.lock=2"]
    words = r"elbow\.lock=2 comes after elbow\.lock=1"
    refused(OptionError, words, Simulation, arm, changes=twice)
    assert [c.part for c in Simulation(arm, changes=once).changes] == ["elbow", "shoulder"]
    assert len(Simulation(arm, changes="elbow.lock=1").changes) == 1
