"""Plans that are aimed: postures at a point to touch, and with a board in a camera's picture."""

import json

import numpy as np
import pytest
from boards import SPEC, Rig

import calib
from calib import OptionError
from calib.body.spatial import structure_of

START = (0.0, 0.7, 1.0, 0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("six_axis")


def test_the_tip_is_at_the_point_in_many_postures(arm):
    point = (0.45, 0.0, 0.35)
    found = calib.plan(arm, 12, touch=point)
    assert np.allclose(found.x, point, atol=2e-6)
    assert (found.q > arm.lower).all()
    assert (found.q < arm.upper).all()
    assert (np.ptp(found.q, axis=0)[:5] > 0.5).all()


@pytest.mark.parametrize(("eye", "spec"), [("hand", "7x5:24mm"), ("base", SPEC)])
def test_the_board_is_in_the_picture_from_many_sides(arm, eye, spec):
    """With a camera that looks along the tip's z axis, or a board that faces along it."""
    found = calib.plan(arm, 12, handeye=spec, eye=eye, start=START)
    structure = structure_of(arm, "base")
    p, turn = structure.pose(np.vstack([START, found.q]), structure.neutral())
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


@pytest.mark.parametrize("in_hand", [True, False])
def test_a_model_of_pictures_knows_camera_and_board(run, tmp_path, in_hand):
    """However they are mounted: no board, no `--from`, and none of the new pictures is lost."""
    rig = Rig(in_hand, pictures=12, half_turn=not in_hand)
    calib.train(rig.solve().poses).save(tmp_path / "rig.calib")
    path = tmp_path / "poses.csv"
    done = run("plan", tmp_path / "rig.calib", "--handeye", "-n", 12, "-o", path, "--json")
    assert done.code == 0, done.err
    q = np.column_stack([json.loads(done.out)["poses"][name] for name in rig.arm.joint_names])
    rig.look(q, np.random.default_rng(0))
    assert ((rig.seen > 0) & (rig.seen < (1280, 720))).all()
    refused = run("plan", tmp_path / "rig.calib", "--handeye", "--board", SPEC, "-o", path)
    assert refused.code == 2


def test_what_cannot_be_aimed_at_is_told(arm, run, tmp_path):
    with pytest.raises(OptionError, match="no posture"):
        calib.plan(arm, touch=(4, 0, 0))
    with pytest.raises(OptionError, match="start"):
        calib.plan(arm, handeye=SPEC)
    with pytest.raises(OptionError, match="in space"):
        calib.plan(calib.load_arm("two_link"), touch=(0.3, 0.1, 0))
    path = tmp_path / "poses.csv"
    assert run("plan", "six_axis", "--board", SPEC, "-o", path).code == 2
    assert run("plan", "six_axis", "--handeye", "-o", path).code == 2
    done = run("plan", "six_axis", "--touch", "0.45,0,0.35", "-n", 8, "-o", path, "--json")
    assert len(json.loads(done.out)["poses"]["elbow"]) == 8
