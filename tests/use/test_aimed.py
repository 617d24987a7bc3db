"""Plans that are aimed: postures at a point to touch, and with a board in a camera's picture."""

from __future__ import annotations

import json

import numpy as np
import pytest

import calib
from calib.body.spatial import structure_of
from calib.errors import OptionError

SPEC = "7x5:24mm:18mm:5x5_100"
START = (0.0, 0.7, 1.0, 0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("six_axis")


def test_the_tip_is_at_the_point_in_postures_that_tell_more_than_random_ones(arm):
    point = (0.45, 0.0, 0.35)
    found = calib.plan(arm, 12, touch=point)
    assert np.allclose(found.x, point, atol=2e-6)
    assert (found.q > arm.lower).all()
    assert (found.q < arm.upper).all()
    structure = structure_of(arm, "base")
    prior = structure.prior(("tool", "placement", "offset"))

    def told(q):
        x = structure.linearise(q, structure.neutral(), prior.active)[1] * prior.sd[prior.active]
        x = (x - x.mean(axis=0)).reshape(-1, x.shape[2]) / 1e-4
        return np.linalg.slogdet(np.eye(x.shape[1]) + x.T @ x)[1]

    from calib.use.aimed import at_point
    from calib.use.pose_space import space_of

    q = at_point(arm, space_of(arm), point, np.random.default_rng(0))[0]
    assert told(found.q) > max(told(q[k : k + 12]) for k in range(0, 360, 12))


@pytest.mark.parametrize("eye", ["hand", "base"])
def test_the_board_is_in_the_picture_from_many_sides(arm, eye):
    """With a camera that looks along the tip's z axis, or a board that faces along it."""
    found = calib.plan(arm, 12, handeye=SPEC, eye=eye, start=START)
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
