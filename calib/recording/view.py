"""View: the pictures of one camera, its lens and the board before it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index
from ..errors import LogError
from .board_pictures import BoardPictures
from .bundle import Corners
from .lens import Lens
from .lens_files import UNSTATED
from .reference import turns_and_shifts
from .rigid import rigid
from .start import BoardPoses


@dataclass(frozen=True, eq=False)
class View:
    """The pictures of one camera."""

    name: str
    shots: BoardPictures
    given: Lens | None  # by the user
    lens: Lens  # where the fit begins
    boards: BoardPoses  # by each picture alone
    rows: Index  # (p,), of the joints or poses
    doubts: tuple[str, ...] = ()

    @property
    def in_hand(self) -> bool:
        """Whether the camera is in the hand."""
        return self.boards.in_hand

    @property
    def eye(self) -> str:
        """Where the camera is."""
        return "hand" if self.in_hand else "base"

    def corners(self, rows: Index) -> Corners:
        """The corners, in the order of the motions at some rows."""
        places = np.searchsorted(rows, self.rows)
        order = np.argsort(places, kind="stable")
        points = self.shots.points
        pixels = [np.array([*self.shots.corners[k].values()]) for k in order]
        return Corners(
            points=np.concatenate([points[k] for k in order]),
            pixels=np.concatenate(pixels),
            motion=np.repeat(places[order], [len(part) for part in pixels]),
            in_hand=self.in_hand,
            outline=self.shots.board.points(),
        )


def view_of(
    name: str, shots: BoardPictures, in_hand: bool, given: Lens | None
) -> View:
    """The view, its lens calibrated by its own pictures where none is given."""
    if given is not None and tuple(given.size) == UNSTATED:
        given = replace(given, size=shots.size)
    if given is not None and tuple(given.size) != tuple(shots.size):
        raise LogError(
            "the lens is of pictures of {}x{}, these are {}x{}: expected the lens of this camera "
            "at this size; leave `lens` out to have it fitted".format(
                *given.size, *shots.size
            )
        )
    lens, doubts = shots.lens(given)
    poses = rigid(*turns_and_shifts(shots.poses(lens)))
    rows = np.arange(len(poses)) if shots.rows is None else shots.rows
    points = shots.board.points()
    x, y, _ = np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
    ends: Array = np.array([[left, top, 0.0] for left in x for top in y])
    boards = BoardPoses(poses, ends, shots.board.half_turn, in_hand)
    return View(name, shots, given, lens, boards, rows, doubts)
