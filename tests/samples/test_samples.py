"""Samples and rows are checked, wrong rows left out and told; the simulated arm and its changes."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import refused
from models import L1, L2, bare, log_of, trained, two_link
from numpy.testing import assert_allclose

import calib
from calib import OptionError, Simulation, babble

JOINTS = np.array([[0.3, 1.0], [0.5, 1.4], [0.9, 2.0]])
SWAPPED = {
    "dict": lambda q: {"elbow": q[:, 1], "shoulder": q[:, 0]},
    "polars": lambda q: pl.DataFrame({"elbow": q[:, 1], "t": q[:, 0], "shoulder": q[:, 0]}),
    "pandas": lambda q: Pandas(elbow=q[:, 1], shoulder=q[:, 0]),
    "record": lambda q: np.rec.fromarrays([q[:, 1], q[:, 0]], names="elbow,shoulder"),
}
MISFITS = [
    ({"q": np.zeros((4, 3))}, r"q of shape \(4, 3\): expected"),
    ({"x": np.zeros((3, 2))}, r"x has shape \(3, 2\), expected \(4, 2\)"),
    ({"orientation": np.zeros((4, 3))}, r"orientation has shape \(4, 3\)"),
    ({"time": [0.0, 1.0]}, r"time has shape \(2,\), expected \(4,\)"),
    ({"time": [0.0, 1.0, np.nan, 2.0]}, "time is not finite"),
    ({"covariance": np.zeros((4, 3, 3))}, r"covariance has shape \(4, 3, 3\)"),
    ({"upper": [1.0, np.inf]}, "'b' has the range 0:inf"),
    ({"lower": [0.0, 1.0]}, "'b' has the range 1:1"),
    ({"joint_names": ("a", "a")}, "different names"),
    ({"q": np.zeros((0, 2)), "x": np.zeros((0, 2))}, "no rows"),
    ({"q": [["a", "b"]] * 4}, "expected numbers"),
    ({"x": [[0, 0], [0, np.nan], [0, 0], [0, 0]]}, r"x of row 2"),
]
NO_NUMBERS = [
    ({"elbow": [1.0]}, "no column 'shoulder'"),
    ({"elbow": [1.0], "sholder": [1.0]}, "did you mean sholder"),
    (np.ma.masked_array(JOINTS, mask=JOINTS > 1.9), "masked"),
    (np.array([["2024-01-01", "2024-01-02"]], dtype="datetime64[s]"), "datetime64"),
    (np.array([[1, 2]], dtype="timedelta64[s]"), "timedelta64"),
    (JOINTS + 0j, "complex"),
    (JOINTS > 1, "bool"),
    ([["a", "b"]], "numbers"),
    ({"shoulder": [1.0, 2.0], "elbow": [1.0]}, "one length"),
]


def make(n=4, **changes):
    rng = np.random.default_rng(0)
    fields = {"q": rng.random((n, 2)), "x": rng.random((n, 2)), "joint_names": ("a", "b")}
    limits = {"lower": [0, 0], "upper": [1, 1], "revolute": (True, False)}
    return calib.Samples(**fields | limits | changes)


def test_arrays_are_float_contiguous_and_read_only():
    s = make(q=np.asfortranarray(np.arange(8).reshape(4, 2)))
    assert s.q.dtype == np.float64
    assert s.q.flags.c_contiguous
    assert s.q.tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]
    for array in (s.q, s.x, s.lower, s.upper):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize(("changes", "message"), MISFITS)
def test_what_does_not_fit_is_refused_in_one_line(changes, message):
    refused(calib.LogError, message, make, **changes)


def test_each_joint_came_from_the_side_of_its_last_motion_and_rows_at_one_pose_share_its_number():
    q = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, 0.2], [0.0, 1.0], [0.0, 1.0 + 1e-9]])
    rows = calib.Samples(q, np.arange(10.0).reshape(5, 2), ("one", "two"))
    assert rows.side.T.tolist() == [[0, 1, 1, -1, -1], [0, 0, -1, 1, 1]]
    assert rows.pose_index.tolist() == [0, 1, 2, 0, 0]


class Pandas(dict):
    """As much of a pandas table as is needed: `columns` and columns by name."""

    @property
    def columns(self):
        return list(self)


@pytest.mark.parametrize("kind", SWAPPED)
def test_named_columns_are_taken_by_name_wherever_joint_values_go(kind):
    swapped = SWAPPED[kind](JOINTS)
    model, arm = trained("two_link"), calib.load_arm("two_link")
    np.testing.assert_array_equal(model.forward(swapped), model.forward(JOINTS))
    np.testing.assert_array_equal(model.expected_error(swapped), model.expected_error(JOINTS))
    np.testing.assert_array_equal(arm.forward(swapped), arm.forward(JOINTS))
    np.testing.assert_array_equal(log_of(arm, swapped, arm.forward(JOINTS)).q, JOINTS)


@pytest.mark.parametrize(("values", "words"), NO_NUMBERS)
def test_what_is_no_table_of_numbers_is_refused_in_one_line(values, words):
    for take in (trained("two_link").forward, calib.load_arm("two_link").forward):
        refused(calib.QueryError, words, take, values)


def screen(log):
    """How many rows training leaves out, and what it says of them."""
    about = calib.train(log, size=4).about
    return about.left_out, [note for note in about.notes if "left out" in note]


def spoiled(log, share, size=0.05, seed=7):
    """The log with a share of its rows moved by `size` [m] in random directions."""
    rng = np.random.default_rng(seed)
    wrong = rng.random(len(log)) < share
    angle = rng.uniform(0, 2 * np.pi, len(log))
    step = size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return replace(log, x=log.x + wrong[:, None] * step), wrong


@pytest.mark.parametrize("robot", ["two_link_full", "three_link"])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("n", [20, 400])
def test_clean_logs_lose_no_row(robot, noise, n):
    assert screen(bare(robot, n, 1, noise=noise)) == (0, [])


@pytest.mark.parametrize(("n", "share"), [(300, 0.01), (300, 0.15), (2000, 0.05), (300, 0.3)])
def test_rows_wrong_by_centimetres_are_found_and_no_others(n, share):
    log, wrong = spoiled(bare("two_link", n, 1, noise=1e-3), share)
    count, notes = screen(log)
    if share > 0.25:  # all are believed
        assert (count, notes) == (0, [])
        return
    assert count == wrong.sum()
    assert f"{wrong.sum():,} of {n:,} rows" in notes[0]
    first = np.flatnonzero(wrong)[:3] + 1
    assert all(str(row) in notes[0] for row in first)


def test_a_patch_that_bends_away_or_a_row_far_from_all_others_is_no_outlier():
    """No smooth function of few terms follows a bump, but neighbours share it."""
    log = bare("two_link", 1500, 1, noise=1e-3)
    u = (log.q - log.lower) / (log.upper - log.lower)
    bump = 0.05 * np.exp(-0.5 * np.sum((u - 0.5) ** 2, axis=1) / 0.05**2)
    assert screen(replace(log, x=log.x + bump[:, None]))[0] <= 3
    # what a fit to the other rows says far from them is a guess
    near = (log.q < np.quantile(log.q, 0.5, axis=0)).all(axis=1)
    alone = np.arange(1500) == np.argmax(log.q.sum(axis=1))
    rows = np.flatnonzero(near | alone)
    assert screen(replace(log, x=log.x + 0.03 * alone[:, None]).take(rows))[0] == 0


@pytest.mark.parametrize("lost", [[17], [3, 17, 40, 41, 99]])
def test_rows_of_zeros_in_space_are_left_out_of_learning_and_of_errors(tmp_path, lost):
    """122 of them were neither dropped nor counted, and the table said 54 mm for .01."""
    rows = bare("spatial_three", 120, seed=2, noise=1e-4)
    clean = calib.train(rows, size=6)
    zeros = np.isin(np.arange(120), lost)
    calib.write_log(replace(rows, x=np.where(zeros[:, None], 0.0, rows.x)), tmp_path / "log.csv")
    log = calib.read_log(tmp_path / "log.csv", rows.arm)
    model = calib.train(log, size=6)
    assert model.about.left_out == len(lost)
    assert model.about.samples == 120 - len(lost)
    told = [note for note in (*log.notes, *model.about.notes) if "left out" in note]
    assert f"row {lost[0] + 1}" in told[0] or f"rows {lost[0] + 1}, " in told[0]
    errors = [m.about.errors["local"]["forward"]["distance"]["max"] for m in (model, clean)]
    assert errors[0] < 1.5 * errors[1]
    evaluated = calib.evaluate(clean, log)
    assert evaluated.left_out >= len(lost)
    assert evaluated.errors["local"]["forward"]["distance"]["max"] < 2e-3


def test_pixels_of_an_arm_in_space_are_a_cameras():
    arm = calib.load_arm("spatial_three")
    q = np.linspace(arm.lower, arm.upper, 6)
    pixels = np.linspace([10, 20], [600, 400], 6)
    samples = calib.Samples(q, pixels, arm.joint_names, arm=arm, unit="px")
    assert samples.camera.size == (640, 480)
    assert samples.take([0]).camera is samples.camera


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
