"""Plans: within the limits, spread, in a short order; what is impossible is told; the command."""

import math

import numpy as np
import pytest
from models import in_pixels, trained

import calib

DEGREE = math.radians(1.0)


@pytest.mark.parametrize("robot", ["three_link", "polar"])
def test_poses_keep_their_margin_and_touch_it(robot):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 40)
    margin = np.minimum(DEGREE, 0.02 * (arm.upper - arm.lower))
    np.testing.assert_allclose(plan.q.min(axis=0), arm.lower + margin, atol=1e-12)
    np.testing.assert_allclose(plan.q.max(axis=0), arm.upper - margin, atol=1e-12)
    assert (plan.q >= arm.lower + margin - 1e-12).all()
    np.testing.assert_allclose(plan.x, arm.forward(plan.q), atol=1e-12)


def test_travel_is_that_of_the_rows_and_short(arm):
    plan = calib.plan(arm, 60, start=[1.0, 1.0])
    np.testing.assert_array_equal(plan.start, [1.0, 1.0])
    moves = np.abs(np.diff(np.vstack([plan.start, plan.q]), axis=0))
    np.testing.assert_allclose(plan.travel, moves.sum(axis=0))
    share = (moves / (arm.upper - arm.lower)).max(axis=1).sum()
    assert plan.length == pytest.approx(share)
    assert plan.length < 0.3 * plan.random_length
    # a random move is 0.47 of a range long in the mean of the larger of two uniform moves
    assert plan.random_length == pytest.approx(0.52 * 60, rel=0.15)


def test_a_written_plan_is_no_log_by_mistake(arm, tmp_path):
    path = tmp_path / "poses.csv"
    plan = calib.plan(arm, 12)
    plan.write(path)
    with pytest.raises(calib.LogError, match="x"):
        calib.read_log(path, arm)
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, plan.q)
    np.testing.assert_array_equal(log.x, plan.x)


def test_plan_of_a_model_tells_what_it_expects():
    model = trained("two_link", n=3000, size=20)
    plan = calib.plan(model, 25)
    np.testing.assert_array_equal(plan.x, model.forward(plan.q))
    np.testing.assert_array_equal(plan.expected_error, model.expected_error(plan.q))
    names = ["shoulder", "elbow", "expected_x", "expected_y", "expected_error"]
    assert list(plan.columns()) == names
    # its URDF tells the limits
    np.testing.assert_allclose(plan.q.min(axis=0), model.about.lower + DEGREE)


def test_a_plan_for_a_camera_keeps_the_tip_in_its_picture():
    model = in_pixels()
    plan = calib.plan(model, 20)
    width, height = model.about.picture or (1280, 960)
    assert ((plan.x > 0) & (plan.x < [width, height])).all()
    assert any("links that hide the tip" in note for note in plan.notes)
    assert not any(note.startswith("0.0%") for note in plan.notes)
