"""A log of a board that was made with a lens of its own, beside the model of the same rig."""

import numpy as np
import pytest

pytest.importorskip("cv2")
from boards import BOARD, Rig

import calib
from calib.arm.rotations import exponential, logarithm
from calib.recording.board import Board
from calib.recording.board_pictures import BoardPictures


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
