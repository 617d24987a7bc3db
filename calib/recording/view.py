"""View: the pictures of one camera, its lens and the board before it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index
from ..common.choices import Eye
from ..errors import LogError
from ..samples.lens import Lens
from .board import Pattern
from .board_pictures import BoardPictures
from .lens import UNSTATED
from .reference import frames_of


@dataclass(frozen=True, eq=False)
class View:
    """The pictures of one camera."""

    name: str
    pictures: BoardPictures
    in_hand: bool  # whether the camera is in the hand
    given: Lens | None  # by the user
    lens: Lens  # where the fit begins
    boards: Array  # (p, 4, 4), the board before the camera, by each picture alone [m]

    @property
    def board(self) -> Pattern:
        """What the pictures show."""
        return self.pictures.board

    @property
    def rows(self) -> Index:
        """The row of joints or poses (p,) that each picture is of."""
        if self.pictures.rows is None:
            return np.arange(len(self.boards))
        return self.pictures.rows

    @property
    def eye(self) -> Eye:
        """Where the camera is."""
        return "hand" if self.in_hand else "base"


def view_of(
    name: str, pictures: BoardPictures, in_hand: bool, given: Lens | None
) -> View:
    """The view, its lens calibrated by its own pictures where none is given."""
    if given is not None and given.size == UNSTATED:
        given = replace(given, size=pictures.size)
    if given is not None and tuple(given.size) != tuple(pictures.size):
        raise LogError(
            "the lens is of pictures of {}x{}, these are {}x{}: expected the lens of this camera "
            "at this size; leave `lens` out to have it fitted".format(
                *given.size, *pictures.size
            )
        )
    lens = given or pictures.lens()
    boards = frames_of(pictures.poses(lens))
    return View(name, pictures, in_hand, given, lens, boards)
