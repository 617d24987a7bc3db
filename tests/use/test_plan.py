"""Plans: poses within limits in a short order; postures at a point, or with a board in view."""

import numpy as np
import pytest
from boards import SPEC, Rig
from conftest import refused
from models import in_pixels
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import calib
from calib import OptionError

START = (0.0, 0.7, 1.0, 0.0, 1.0, 0.0)
SIX = calib.load_arm("six_axis")


@pytest.mark.parametrize(("robot", "start"), [("two_link", [1.0, 1.0]), ("polar", [0.1, 0.1])])
def test_poses_keep_their_margin_and_touch_it_and_their_travel_is_short(robot, start):
    arm = calib.load_arm(robot)
    plan = calib.plan(arm, 60, start=start)
    margin = np.minimum(np.radians(1.0), 0.02 * (arm.upper - arm.lower))
    assert_allclose(plan.q.min(axis=0), arm.lower + margin, atol=1e-12)
    assert_allclose(plan.q.max(axis=0), arm.upper - margin, atol=1e-12)
    assert_allclose(plan.x, arm.forward(plan.q), atol=1e-12)
    assert_array_equal(plan.start, start)
    moves = np.abs(np.diff(np.vstack([plan.start, plan.q]), axis=0))
    assert_allclose(plan.travel, moves.sum(axis=0))
    assert plan.length == pytest.approx((moves / (arm.upper - arm.lower)).max(axis=1).sum())
    # a move in a random order is about half a range long
    assert plan.length < 0.3 * 0.5 * 60


def test_a_written_plan_is_no_log_by_mistake(arm, tmp_path):
    path = tmp_path / "poses.csv"
    plan = calib.plan(arm, 12)
    plan.write(path)
    refused(calib.LogError, "has no positions", calib.read_log, path, arm)
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    assert_array_equal(log.q, plan.q)
    assert_array_equal(log.x, plan.x)


def test_a_plan_for_a_camera_keeps_the_tip_in_its_picture():
    model = in_pixels()
    plan = calib.plan(model, 20)
    assert ((plan.x > 0) & (plan.x < (model.about.picture or (1280, 960)))).all()
    assert any("links that hide the tip" in note for note in plan.notes)
    assert not any(note.startswith("0") for note in plan.notes)


def test_the_tip_is_at_the_point_in_many_postures(run, tmp_path):
    point = (0.45, 0.0, 0.35)
    found = calib.plan(SIX, 12, touch=point)
    assert np.allclose(found.x, point, atol=2e-6)
    assert ((found.q > SIX.lower) & (found.q < SIX.upper)).all()
    assert (np.ptp(found.q, axis=0)[:5] > 0.5).all()
    # what cannot be aimed at is told
    refused(OptionError, "no posture", calib.plan, SIX, touch=(4, 0, 0))
    refused(OptionError, "start", calib.plan, SIX, handeye=SPEC)
    refused(OptionError, "one of", calib.plan, SIX, handeye=SPEC, touch=(0.4, 0, 0.3))
    refused(OptionError, "in space", calib.plan, calib.load_arm("two_link"), touch=(0.3, 0.1, 0))
    done = run(f"plan six_axis --touch 0.45,0,0.35 -n 8 -o {tmp_path}/poses.csv --json")
    assert len(done.document["poses"]["elbow"]) == 8


@pytest.mark.parametrize(("eye", "spec"), [("hand", "7x5:24mm"), ("base", SPEC)])
def test_the_board_is_in_the_picture_from_many_sides(eye, spec):
    """With a camera that looks along the tip's z axis, or a board that faces along it."""
    found = calib.plan(SIX, 12, handeye=spec, eye=eye, start=START)
    p, quaternion = SIX.pose(np.vstack([START, found.q]))
    turn = Rotation.from_quat(quaternion).as_matrix()
    if eye == "hand":
        board = p[0] + 0.4725 * turn[0, :, 2]
        sight = np.einsum("nji,nj->ni", turn[1:], board - p[1:])
    else:
        facing = turn[0] * (1, -1, -1)
        sight = (p[1:] - (p[0] - 0.4725 * facing[:, 2])) @ facing
    # 900 px of focal length, 1280x720 px: within the picture, and not all from one side
    assert (abs(sight[:, :2]) < sight[:, 2:] * (640 / 900, 360 / 900)).all()
    spread = np.einsum("ij,nkj->nik", turn[1].T, turn[1:])
    assert np.degrees(np.arccos(np.clip((spread[:, 2, 2]), -1, 1))).max() > 30


@pytest.mark.parametrize(("seed", "in_view"), [(1, 1.0), (2, 0.9)])
def test_poses_from_a_drawing_tell_where_the_camera_is(seed, in_view):
    """Those for an arm without errors left it open to .27 and .31 mm."""
    rig = Rig(True, seed=seed)
    rig.look(calib.plan(rig.arm, 12, handeye=SPEC, start=rig.start[0]).q, np.random.default_rng(0))
    assert ((rig.seen > 0) & (rig.seen < (1280, 720))).mean() >= in_view
    assert max(rig.solve().hand["position_95_up_to_gauge"]) < 2.68e-4


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_model_of_pictures_knows_camera_and_board(run, tmp_path, in_hand):
    """However they are mounted: no board, no `--from`, and none of the new pictures is lost."""
    rig = Rig(in_hand, pictures=12, half_turn=not in_hand)
    calib.train(rig.solve().poses, size=4).save(tmp_path / "rig.calib")
    path = tmp_path / "poses.csv"
    plan = f"plan {tmp_path}/rig.calib --handeye -o {path}"
    poses = run.done(f"{plan} -n 12 --json").document["poses"]
    q = np.column_stack([poses[name] for name in rig.arm.joint_names])
    rig.look(q, np.random.default_rng(0))
    assert ((rig.seen > 0) & (rig.seen < (1280, 720))).all()
    assert run(f"{plan} --board {SPEC}").code == 2
