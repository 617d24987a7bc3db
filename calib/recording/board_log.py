"""Logs of a board's poses, told with another lens.

A pose is as good as the lens that it was found with: pictures whose lens was calibrated anew stand
elsewhere by millimetres, although nothing has moved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arm.rotations import matrix_of, quaternion_of
from ..model.model import Model
from ..samples.samples import Samples
from .board import parse_board
from .board_pictures import held_poses
from .lens import Lens, lens_of_model
from .reference import find_pose
from .rigid import inverse, rigid

# share by which the focal length of a camera that was not touched may differ
_REFOCUSED = 0.02


def with_lens_of(model: Model, log: Samples) -> Samples:
    """Return a log of the model's board as its camera's lens would have told it.

    Other logs stay as they are, and so do those of a camera that was refocused.
    """
    made = model.about.options.get("board")
    source = log.source
    if not made or "lens" not in source or source.get("board") != made["board"]:
        return log
    lens = lens_of_model(model)
    log_lens = Lens.from_json(source["lens"])
    if (
        log_lens.parameters == lens.parameters
    ).all() or log.orientation is None:
        return log
    growth = float(log_lens.focal.mean() / lens.focal.mean()) - 1.0
    if log_lens.size != lens.size or abs(growth) > _REFOCUSED:
        note = (
            f"the log's camera is another than the model's, or refocused: its focal length "
            f"differs by {growth:+.1%}"
        )
        return replace(log, notes=(*log.notes, note))
    in_hand = source["eye"] == "hand"
    point = np.array(source["point"])
    turns = matrix_of(log.orientation)
    boards = rigid(turns, log.x - turns @ point)
    if in_hand:  # the pose is the camera's, in the board's frame
        boards = inverse(boards)
    board = parse_board(source["board"]).points()
    poses = []
    for pose in boards:
        points_ahead = board @ pose[:3, :3].T + pose[:3, 3]
        pixels = log_lens.distort(points_ahead[:, :2] / points_ahead[:, 2:])
        poses.append(find_pose(lens, board, pixels))
    hand = held_poses(poses, in_hand)
    turns = hand[:, :3, :3]
    note = (
        f"poses are told with the model's lens: of these pictures alone the focal length was "
        f"{growth:+.2%} off it"
    )
    return replace(
        log,
        x=turns @ point + hand[:, :3, 3],
        orientation=quaternion_of(turns),
        source={**source, "lens": lens.to_json()},
        notes=(*log.notes, note),
    )
