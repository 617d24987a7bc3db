"""Hard logs: errors that repeat, tied joints, sagging arms, bad gears, and play of joints."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import refused
from models import (
    L1,
    L2,
    accuracy,
    arm,
    bare,
    lengths,
    log_of,
    sensed,
    trained,
    two_link,
    without_masses,
)
from reference import random_joints

import calib
from calib.arm.gravity import Loads
from calib.arm.rotations import exponential, matrix_of, quaternion_of

NOISE = 2e-5
ARM = calib.load_arm("six_axis")
BARE = without_masses(ARM)
COMPLIANCE = np.array([0.8, 1.0, 1.2, 4.0, 5.0, 3.0])


def learned(readings, rng, noise=NOISE, waves=0.0):
    """A model of 240 readings of two_link, 1,000 fresh joints, and how far it is off there."""
    arm = calib.load_arm("two_link")

    def true(q):
        return arm.forward(q) + waves * np.sin(200.0 * q)

    q = np.repeat(rng.uniform(arm.lower, arm.upper, (240 // readings, 2)), readings, axis=0)
    model = calib.train(log_of(arm, q, true(q) + noise * rng.normal(size=q.shape)), size=5)
    assert any("model_error" in line for line in model.body.describe())
    fresh = rng.uniform(arm.lower, arm.upper, (1000, 2))
    return model, fresh, model.forward(fresh) - true(fresh)


@pytest.mark.parametrize("waves", [0.0, 1e-4])
@pytest.mark.parametrize(("readings", "least", "most"), [(1, 0.9, 1.0), (3, 0.0, 0.7)])
def test_an_error_that_repeats_is_the_models_not_the_sensors(readings, least, most, waves):
    """Poses that were read again show what is the sensor's."""
    model, fresh, off = learned(readings, np.random.default_rng(0), waves=waves)
    assert np.mean(lengths(off) <= model.model_error(fresh)) > 0.9
    share = np.median(model.model_error(fresh)) / np.median(model.expected_error(fresh))
    assert waves or least < share <= most


@pytest.mark.parametrize(("readings", "noise"), [(6, 2e-4), (1, 1e-5)])
def test_the_bound_of_a_reading_is_of_one_of_its_own_noise(readings, noise):
    rng = np.random.default_rng(0)
    model, fresh, off = learned(readings, rng, noise)
    off = lengths(off - noise * rng.normal(size=off.shape))
    bound = model.expected_error(fresh)
    assert 0.92 < np.mean(off <= bound) < 0.98
    assert np.median(bound) < 3 * np.median(off)


def test_few_rows_are_not_followed_into_their_noise():
    def waved(q):
        return ARM.forward(q + 3e-4 * np.sin(9 * q + np.arange(6)))

    body = calib.train(sensed(ARM, 60, 0, waved, NOISE), size=3).body
    assert 0.8 * NOISE < body.noise[0] < 1.3 * NOISE


def one_orientation(n: int, rng: np.random.Generator) -> np.ndarray:
    """Joints (n, dof) of poses that differ in position alone, as in picking and placing."""
    start = np.tile([0.3, -1.2, 1.4, -1.0, -1.4, 0.2], (2 * n, 1))
    position, turn = ARM.pose(start)
    position += rng.uniform(-0.15, 0.15, position.shape)
    joints = trained("six_axis", 60, 3).inverse_pose(position, turn, start)
    return joints[np.isfinite(joints).all(axis=1)][:n]


@pytest.mark.parametrize("oriented", [True, False])
def test_a_tool_of_one_orientation_is_explained_at_its_own_rows(oriented):
    rng = np.random.default_rng(1)
    q = one_orientation(45, rng)
    position, quaternion = ARM.pose(q)
    frame, tool = matrix_of(np.array([[0.1, 0.4, -0.2, 0.6], [0.2, 0.1, 0.7, 0.5]]))
    rotation = matrix_of(quaternion)
    x = (position + rotation @ [0.03, -0.05, 0.12]) @ frame.T + (0.4, -2.0, 1.0)
    x += 1e-4 * rng.normal(size=(45, 3))
    seen = quaternion_of(frame @ rotation @ tool) if oriented else None
    body = calib.train(log_of(ARM, q, x, orientation=seen), size=3).body
    off = lengths(body.predict(q)[:, :3] - x)
    assert off.mean() < 3e-4
    assert (off <= body.bound(q)).mean() > 0.9


def test_a_turned_tool_leaves_the_last_joints_offset_untold():
    """It was said to be 0 within .2 deg where .757 deg was true."""
    rng = np.random.default_rng(1)
    q = rng.uniform(ARM.lower, ARM.upper, (120, 6))
    off = np.radians([0.3, -0.2, 0.4, -0.3, 0.2, 0.757])
    position, quaternion = ARM.pose(q + off)
    turned = matrix_of(quaternion) @ exponential([0.0, np.radians(12.0), 0.0])
    seen = quaternion_of(turned @ exponential(rng.normal(0, 2e-4, (120, 3))))
    log = log_of(ARM, q, position + 1e-4 * rng.normal(size=(120, 3)), orientation=seen)
    body = calib.train(log, size=3, view="base").body
    parameters = {p.name: p for p in body.parameters()}
    *others, last = (parameters[f"{name}.offset"] for name in ARM.joint_names)
    assert last.low < off[-1] < last.high
    assert max(each.high - each.low for each in others[1:]) < np.radians(1.5)
    assert any("not told apart from the tool's turn" in line for line in body.describe())


def notes(q):
    """Notes of a model of rows (n, 6) on joints that tell too little."""
    model = calib.train(log_of(ARM, q, ARM.forward(q)), size=3)
    words = ("move together", "never moves")
    return [note for note in model.about.notes if any(word in note for word in words)]


def test_only_joints_that_move_together_but_for_a_fraction_of_a_degree_are_named():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (60, 6))
    assert notes(q) == []
    q[:, 3] = 0.5 * q[:, 1]
    (note,) = notes(q)
    assert note.startswith("shoulder_lift, wrist_1 move together along 1 of 2 directions")
    still, together = notes(np.column_stack([np.full(60, 0.3), q[:, 1:]]))
    assert still.startswith("shoulder_pan never moves")
    assert together == note
    q[:, 3] = q[:, 1] + np.radians(0.3) * rng.uniform(-1, 1, 60)
    (note,) = notes(q)
    assert note.startswith("shoulder_lift, wrist_1 move together")
    q[:, 3] = q[:, 1] + np.radians(3.0) * rng.uniform(-1, 1, 60)
    assert notes(q) == []


def test_a_short_path_without_a_drawing_is_bounded_elsewhere():
    rng = np.random.default_rng(2)
    lower, upper = np.maximum(ARM.lower, -np.pi), np.minimum(ARM.upper, np.pi)
    fresh = rng.uniform(lower, upper, (300, 6))
    phase = np.linspace(0, 6, 150)[:, None] * rng.uniform(0.2, 1, 6) + rng.uniform(0, 6, 6)
    q = (lower + upper) / 2 + (upper - lower) / 4 * np.sin(phase)
    log = log_of(ARM, q, ARM.forward(q) + 1e-4 * rng.normal(size=(150, 3)))
    body = calib.train(replace(log, arm=None), size=4).body
    off = lengths(body.predict(fresh) - ARM.forward(fresh))
    assert np.mean(off <= body.bound(fresh)) > 0.9


def sagging(q, most, gravity=(0.0, 0.0, -9.81)):
    """Positions (n, 3) [m] of an arm whose joints give way so that its tip moves by `most`."""
    torques = np.einsum("exn,x->ne", Loads.of_masses(ARM.chain).levers(q), gravity)
    bends = 1e-6 * COMPLIANCE * torques
    moved = lengths(ARM.forward(q + bends) - ARM.forward(q)).max()
    return ARM.forward(q + most / moved * bends)


def tracked(arm, q, x):
    """A model of rows (n, dof) and what a tracker saw."""
    return calib.train(log_of(arm, q, x, unit="m"), size=3)


@cache
def world(half=False):
    """Rows that are learned, with noise, and others, exact."""
    q = random_joints(ARM, 800)
    x = sagging(q, 3e-3)
    low = q[:, 1] < (ARM.lower[1] + ARM.upper[1]) / 2 if half else np.arange(len(q)) < 200
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (200, 3))
    return q[low][:200], x[low][:200] + noise, q[~low], x[~low]


def test_an_arm_without_masses_is_as_accurate_as_with_them():
    q, x, others, truth = world()
    masses, _ = accuracy(tracked(ARM, q, x), others, truth)
    model = tracked(BARE, q, x)
    assert accuracy(model, others, truth)[0] < 1.2 * masses < 5e-5
    said = " ".join(model.body.describe(ARM.lower, ARM.upper))
    told = float(re.search(r"shoulder_lift: bends by up to ([\d.]+) mrad", said)[1])
    # the tip, 1 m away, moves by 3 mm, most of it by that joint
    assert 1.5 < told < 4.0


def test_the_other_half_of_a_sagging_arms_range_is_within_the_bound():
    q, x, others, truth = world(half=True)
    miss, covered = accuracy(tracked(BARE, q, x), others, truth)
    assert miss < 1e-4
    assert covered > 0.85


def test_an_arm_on_a_wall_is_believed_and_gravity_is_a_direction():
    q = random_joints(ARM, 250)
    x = sagging(q, 3e-3, (9.81, 0.0, 0.0)) + np.random.default_rng(0).normal(0.0, 1e-4, (250, 3))
    arm = replace(BARE, gravity=(9.81, 0.0, 0.0))
    assert accuracy(tracked(arm, q[:100], x[:100]), q[100:], x[100:])[0] < 3e-4
    assert calib.load_arm("six_axis", gravity=(0, 0, 2)).gravity == (0.0, 0.0, 9.80665)
    words = r"gravity.*three numbers"
    refused(calib.OptionError, words, calib.load_arm, "six_axis", gravity=(0, 0, 0))


@pytest.mark.parametrize("drawn", [True, False])
def test_a_gear_that_is_two_percent_wrong_is_found(drawn):
    """A chain alone missed by 7 mm of it."""
    q = random_joints(ARM, 300)
    gains = np.array([1.0, 1.0, 1.02, 1.0, 0.997, 1.0])
    x = ARM.forward(gains * q) + np.random.default_rng(0).normal(0.0, 2.5e-5, (len(q), 3))
    log = log_of(ARM, q[:150], x[:150], unit="m")
    model = calib.train(log if drawn else replace(log, arm=None), size=3)
    assert "geared" in model.body.member
    found = model.body.beta[model.body.structure.groups["gain"]]
    np.testing.assert_allclose(found[1:5], gains[1:5], atol=1e-3)
    miss, covered = accuracy(model, q[150:], ARM.forward(gains * q[150:]))
    assert miss < 1e-4
    assert covered > 0.93


PLAY = 0.01


@cache
def babbled_with(change):
    return calib.train(calib.babble(arm(), 2000, noise=1e-4, changes=[change]), size=15)


def true_rows(change):
    simulation, rng = calib.Simulation(arm(), changes=[change]), np.random.default_rng(4)
    q = simulation.draw(2000, rng)
    return q, simulation.true(q, rng)


@pytest.mark.parametrize("change", ["elbow.backlash=0.01", "elbow.noise=0.005"])
def test_the_bound_covers_the_true_tip(change):
    _, covered = accuracy(babbled_with(change), *true_rows(change), "expected_error")
    assert 0.92 < covered < 0.98


def test_the_direction_pays_where_there_is_backlash():
    model = babbled_with("elbow.backlash=0.01")
    assert model.approach is not None
    assert model.approach.play[0] == 0.0
    assert model.approach.play[1] == pytest.approx(PLAY / 2, rel=0.03)
    q, x = true_rows("elbow.backlash=0.01")
    side = calib.Samples(q, x, arm().joint_names).side
    blind = lengths(model.forward(q) - x)
    told = lengths(model.forward(q, approach=side) - x)
    assert np.nanmean(told) < 0.1 * np.nanmean(blind)
    bound = model.expected_error(q, approach=side)
    assert np.nanmean(told <= bound) > 0.92
    assert np.nanmean(bound) < 0.2 * np.nanmean(model.expected_error(q))
    # nothing is known of a joint that has not moved yet
    unknown = model.expected_error(q, approach=np.zeros_like(side))
    assert np.array_equal(unknown, model.expected_error(q), equal_nan=True)


def test_a_log_along_a_path_shows_it_and_a_shuffled_one_does_not():
    samples = calib.babble(arm(), 500)
    u = 0.5 + 0.5 * np.sin(np.arange(500)[:, None] * [0.106, 0.08] + [0.3, 1.1])
    q = samples.lower + (samples.upper - samples.lower) * u
    x = calib.Simulation(arm(), 1e-4, ["elbow.backlash=0.01"]).measure(q, np.random.default_rng(0))
    whole = calib.train(replace(samples, simulation=None, q=q, x=x, side=None), size=10)
    assert whole.approach.play[1] == pytest.approx(PLAY / 2, rel=0.05)
    assert any("backlash of elbow 0.5" in note for note in whole.about.notes)
    rows = bare(arm(), 500, 0, "elbow.backlash=0.01", noise=1e-4)
    order = np.random.default_rng(0).permutation(500)
    shuffled = replace(rows, q=rows.q[order], x=rows.x[order], side=None)
    assert calib.train(shuffled, size=10).approach is None


def test_a_log_of_few_rows_learns_the_play_of_all_joints_and_fresh_rows_are_no_alarm():
    changes = [f"{joint}.backlash=0.003" for joint in ("shoulder", "elbow", "wrist")]
    rows = bare("three_link", 90, 0, *changes, noise=1e-4)
    model = calib.train(rows.take(slice(0, 30)), size=4)
    assert model.approach.play[:2] == pytest.approx(0.0015, rel=0.1)
    assert calib.check(model, rows.take(slice(30, 90))).drifted is False


@pytest.mark.parametrize("elbow", [0.03, -0.03])
def test_a_play_below_zero_is_none(elbow):
    """Alone, the shoulder would explain the elbow's negative play as well."""
    rows, rng = bare(arm(), 400, 0), np.random.default_rng(0)
    side = rng.choice([-1.0, 1.0], (400, 1)).repeat(2, axis=1)
    play = np.array([0.01, elbow])
    x = arm().forward(rows.q - play * side) + rng.normal(0, 1e-4, (400, 2))
    approach = calib.train(replace(rows, x=x, side=side), size=5).approach
    if elbow < 0:
        assert approach is None
    else:
        assert approach.play == pytest.approx(play, rel=0.05)


@pytest.mark.parametrize("seed", [5, 9])
def test_what_a_parameter_explains_as_well_is_no_play(seed):
    """Along a path between three poses, each joint of which turned once, play was learned."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(arm().lower, arm().upper, (3, 2))
    time = np.linspace(0.0, 2.0, 600)
    q = np.stack([np.interp(time, np.arange(3), joint) for joint in poses.T], axis=1)
    offset, longer = rng.normal(0.0, 1e-3, 2), 5e-4 * rng.standard_normal()
    x = two_link(q + offset, L1 + longer, L2 - 5e-4) + rng.normal(0.0, 2e-4, q.shape)
    assert calib.train(log_of(arm(), q, x), size=4).approach is None
