"""A log of a board that was made with a lens of its own, beside the model of the same rig."""

from dataclasses import replace

import numpy as np
import pytest
from boards import BOARD, Rig

import calib
from calib.arm.rotations import exponential, logarithm
from calib.body.sensor_pose import held_of
from calib.recording.board import Board
from calib.recording.board_pictures import BoardPictures
from calib.recording.lens import Lens

pytest.importorskip("cv2")


def pictures(rig):
    found = tuple(dict(enumerate(rig.seen[rig.rows == k])) for k in range(len(rig.q)))
    names = tuple(f"{k}.png" for k in range(len(rig.q)))
    board = Board.parse("7x5:24mm:18mm:5x5_100")
    size = (1280, 720)
    return BoardPictures(board, rig.arm.joint_names, names, rig.q, found, size, len(rig.q), ())


@pytest.mark.parametrize(("tilt", "drifted"), [(0.0, False), (0.5, True)])
def test_a_lens_that_was_fitted_anew_is_no_change(run, tmp_path, tilt, drifted):
    """The model's own pictures were called drifted: their poses stood 4 mm elsewhere."""
    rig = Rig(True, known=False, pictures=40)
    shots = pictures(rig)
    model = calib.train(calib.handeye(rig.arm, shots, None, None, "hand").poses)
    model.save(tmp_path / "rig.calib")
    if tilt:  # of the camera in its mount [deg]
        turn = rig.structure.groups["tool.rotation"]
        more = exponential(np.radians([[0.0, tilt, 0.0]]))[0]
        rig.beta[turn] = logarithm(exponential(rig.beta[turn]) @ more)
        rig.look(rig.q, np.random.default_rng(1))
        shots = pictures(rig)
    assert len(rig.seen) == len(rig.q) * len(BOARD)
    lens, _ = shots.lens(None)
    log = shots.log(lens, in_hand=True)
    assert calib.check(model, log).drifted is drifted
    calib.write_log(log, tmp_path / "log.csv")
    done = run("check", tmp_path / "rig.calib", "--data", tmp_path / "log.csv", "--json")
    assert done.document["drifted"] is drifted
    assert "told with the model's lens" in done.err


def board_of(rig):
    """The rig's corners as if they were found in pictures, and its lens where that is known."""
    found = tuple(dict(enumerate(rig.seen[rig.rows == k])) for k in range(len(rig.q)))
    names = tuple(f"{k:02d}.png" for k in range(len(rig.q)))
    board = Board.parse("7x5:24mm:18mm:5x5_100")
    f, u, v, k1 = rig.lens
    lens = Lens((1280, 720), np.array([f, f]), np.array([u, v]), np.array([k1, 0, 0, 0, 0]))
    shots = BoardPictures(
        board, rig.arm.joint_names, names, rig.q, found, lens.size, len(names), ()
    )
    return shots, lens if rig.known else None


def solved(rig):
    shots, lens = board_of(rig)
    eye = "hand" if rig.in_hand else "base"
    return calib.handeye(rig.arm, shots, eye=eye, lens=lens)


@pytest.mark.parametrize("in_hand", [True, False])
def test_the_hand_is_told_as_the_last_encoder_says(in_hand):
    rig = Rig(in_hand, seed=4, pictures=16, last=True, off=2.0)
    body = solved(rig).body
    found, true = held_of(body), held_of(replace(body, beta=rig.beta))
    turned = logarithm((found.rotation @ true.rotation.T)[None])[0]
    assert (abs(found.position - true.position) < 4 * found.told_sd).all()
    assert (abs(turned) < 4 * found.told_turn_sd).all()
    assert np.linalg.norm(turned) < np.radians(0.05)
    # of the true last link it is as far turned as its encoder is off, which the interval says
    away = logarithm((rig.hand(rig.beta)[1] @ true.rotation.T)[None])[0]
    assert np.linalg.norm(away) > np.radians(0.2)
    assert (abs(away) < 1.96 * found.turn_sd + 1e-4).all()
