"""Hard logs: errors that repeat, tools of one orientation, joints that stand still or are tied."""

from dataclasses import replace

import numpy as np
import pytest
from models import log_of

import calib
from calib.arm.rotations import exponential, logarithm, matrix_of, quaternion_of
from calib.body.body_fit import fit
from calib.body.rows import Rows
from calib.body.spatial import structure_of

NOISE = 2e-5


def covered(readings: int, waves: float, rng: np.random.Generator) -> tuple[float, float, float]:
    """Share of true positions within `model_error`, and both bounds, of repeated readings."""
    arm = calib.load_arm("two_link")

    def true(q):
        return arm.forward(q) + waves * np.sin(200.0 * q)

    poses = rng.uniform(arm.lower, arm.upper, (240 // readings, 2))
    q = np.repeat(poses, readings, axis=0)
    model = calib.train(log_of(arm, q, true(q) + NOISE * rng.normal(size=q.shape)), size=5)
    fresh = rng.uniform(arm.lower, arm.upper, (1000, 2))
    off = np.linalg.norm(model.forward(fresh) - true(fresh), axis=1)
    bounds = model.model_error(fresh), model.expected_error(fresh)
    assert any("model_error" in line for line in model.body.describe())
    return float((off <= bounds[0]).mean()), *(float(np.median(bound)) for bound in bounds)


@pytest.mark.parametrize("readings", [1, 3])
def test_an_error_that_repeats_is_the_models_not_the_sensors(readings):
    share, _, _ = covered(readings, 1e-4, np.random.default_rng(0))
    assert share > 0.9


def test_repeated_poses_show_what_is_the_sensors():
    rng = np.random.default_rng(0)
    _, *alone = covered(1, 0.0, rng)
    share, model, reading = covered(3, 0.0, rng)
    assert share > 0.9
    assert alone[0] > 0.9 * alone[1]
    assert model < 0.7 * reading


def test_the_bound_of_a_reading_is_of_one_of_several_at_a_pose():
    arm, rng, noise = calib.load_arm("two_link"), np.random.default_rng(0), 2e-4

    def read(q):
        return arm.forward(q) + noise * rng.normal(size=q.shape)

    q = np.repeat(rng.uniform(arm.lower, arm.upper, (40, 2)), 6, axis=0)
    model = calib.train(log_of(arm, q, read(q)), size=5)
    fresh = rng.uniform(arm.lower, arm.upper, (2000, 2))
    off = np.linalg.norm(model.forward(fresh) - read(fresh), axis=1)
    assert 0.92 < np.mean(off <= model.expected_error(fresh)) < 0.98


def test_a_tracker_that_reads_to_10_um_gets_bounds_of_its_own_noise():
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (1200, 2))
    x = arm.forward(q) + 1e-5 * rng.normal(size=q.shape)
    model = calib.train(log_of(arm, q[:200], x[:200]), size=5)
    miss = np.linalg.norm(model.forward(q[200:]) - x[200:], axis=1)
    bound = model.expected_error(q[200:])
    assert (miss <= bound).mean() > 0.9
    assert np.median(bound) < 3 * np.median(miss)


def test_few_rows_are_not_followed_into_their_noise():
    arm = calib.load_arm("six_axis")
    rng = np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (60, 6))
    waves = 3e-4 * np.sin(9 * q + np.arange(6))
    x = arm.forward(q + waves) + NOISE * rng.normal(size=(60, 3))
    body = fit(structure_of(arm), [Rows(q, x)]).body
    assert 0.8 * NOISE < body.noise[0] < 1.3 * NOISE


def one_orientation(arm, n: int, rng: np.random.Generator) -> np.ndarray:
    """Joints (n, dof) of poses that differ in position alone, as in picking and placing."""
    start = np.array([0.3, -1.2, 1.4, -1.0, -1.4, 0.2])
    p, r = arm.chain.poses(start[None])
    found = []
    while len(found) < n:
        target, q = p[0] + rng.uniform(-0.15, 0.15, 3), start.copy()
        for _ in range(40):
            at, turned = arm.chain.poses(q[None])
            error = np.r_[target - at[0], logarithm(r @ np.swapaxes(turned, 1, 2))[0]]
            jacobian = arm.chain.jacobian(q[None])[0]
            q = q + np.linalg.lstsq(jacobian, error, rcond=1e-6)[0]
        if np.abs(error).max() < 1e-9 and (q > arm.lower).all() and (q < arm.upper).all():
            found.append(q)
    return np.array(found)


@pytest.mark.parametrize("oriented", [True, False])
def test_a_tool_of_one_orientation_is_explained_at_its_own_rows(oriented):
    arm, rng = calib.load_arm("six_axis"), np.random.default_rng(1)
    q = one_orientation(arm, 45, rng)
    position, quaternion = arm.pose(q)
    turn = matrix_of(np.array([[0.1, 0.4, -0.2, 0.6]]))[0]
    turned = matrix_of(quaternion)
    tool = np.array([0.03, -0.05, 0.12])
    x = (position + turned @ tool) @ turn.T + (0.4, -2.0, 1.0) + 1e-4 * rng.normal(size=(45, 3))
    seen = quaternion_of(turn @ turned @ matrix_of(np.array([[0.2, 0.1, 0.7, 0.5]]))[0])
    log = log_of(arm, q, x, orientation=seen if oriented else None)
    body = calib.train(log, size=3).body
    off = np.linalg.norm(body.predict(q)[:, :3] - x, axis=1)
    assert off.mean() < 3e-4
    assert (off <= body.bound(q)).mean() > 0.9


def test_a_turned_tool_leaves_the_last_joints_offset_untold():
    """It was said to be 0 within .2 deg where .757 deg was true."""
    arm, rng = calib.load_arm("six_axis"), np.random.default_rng(1)
    q = rng.uniform(arm.lower, arm.upper, (120, 6))
    off = np.radians([0.3, -0.2, 0.4, -0.3, 0.2, 0.757])
    position, quaternion = arm.pose(q + off)
    turned = matrix_of(quaternion) @ exponential([0.0, np.radians(12.0), 0.0])
    seen = quaternion_of(turned @ exponential(rng.normal(0, 2e-4, (120, 3))))
    log = log_of(arm, q, position + 1e-4 * rng.normal(size=(120, 3)), orientation=seen)
    body = calib.train(log, size=3, view="base").body
    found = {p.name: p for p in body.parameters()}
    *others, last = (found[f"{name}.offset"] for name in arm.joint_names)
    assert last.low < off[-1] < last.high
    assert max(each.high - each.low for each in others[1:]) < np.radians(1.5)
    assert any("not told apart from the tool's turn" in line for line in body.describe())


ARM = calib.load_arm("six_axis")


def notes(q):
    """Notes of a model of rows (n, 6) on joints that tell too little."""
    model = calib.train(log_of(ARM, q, ARM.forward(q)), size=3)
    words = ("move together", "never moves")
    return [note for note in model.about.notes if any(word in note for word in words)]


def test_only_joints_that_move_together_are_named():
    q = np.random.default_rng(0).uniform(-1, 1, (60, 6))
    assert notes(q) == []
    q[:, 3] = 0.5 * q[:, 1]
    (note,) = notes(q)
    assert note.startswith("shoulder_lift, wrist_1 move together along 1 of 2 directions")
    q[:, 0] = 0.3
    still, together = notes(q)
    assert still.startswith("shoulder_pan never moves")
    assert together == note


def test_joints_that_are_tied_but_for_a_fraction_of_a_degree_are_named():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (60, 6))
    q[:, 3] = q[:, 1] + np.radians(0.3) * rng.uniform(-1, 1, 60)
    (note,) = notes(q)
    assert note.startswith("shoulder_lift, wrist_1 move together")
    q[:, 3] = q[:, 1] + np.radians(3.0) * rng.uniform(-1, 1, 60)
    assert notes(q) == []


def test_a_short_path_without_a_drawing_is_bounded_elsewhere():
    arm = ARM
    rng = np.random.default_rng(2)
    lower, upper = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    fresh = rng.uniform(lower, upper, (300, 6))
    phase = np.linspace(0, 6, 150)[:, None] * rng.uniform(0.2, 1, 6) + rng.uniform(0, 6, 6)
    q = (lower + upper) / 2 + (upper - lower) / 4 * np.sin(phase)
    log = log_of(arm, q, arm.forward(q) + 1e-4 * rng.normal(size=(150, 3)))
    body = calib.train(replace(log, arm=None), size=4).body
    off = np.linalg.norm(body.predict(fresh) - arm.forward(fresh), axis=1)
    assert np.mean(off <= body.bound(fresh)) > 0.9
