"""View: the pictures of one camera, its lens and the board before it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Mask
from ..common.choices import Eye
from ..samples.lens import Lens
from .board_pictures import BoardPictures
from .lens import refuse_size
from .reference import frames_of


@dataclass(frozen=True, eq=False, kw_only=True)
class View(BoardPictures):
    """The pictures of one camera, with its lens and the boards before it."""

    name: str
    in_hand: bool  # whether the camera is in the hand
    stated_lens: Lens | None  # by the user
    first_lens: Lens  # where the fit begins
    boards: Array  # (p, 4, 4), the board before the camera, by each picture alone [m]

    @property
    def eye(self) -> Eye:
        """Where the camera is."""
        return "hand" if self.in_hand else "base"

    def turned(self, others: Mask) -> View:
        """The view with the board of some pictures (p,) numbered from its other end."""
        last = len(self.board.points()) - 1
        corners = list(self.corners)
        for k in np.flatnonzero(others):
            corners[k] = {
                last - number: place for number, place in corners[k].items()
            }
        boards = self.boards.copy()
        if self.board.half_turn is not None:
            boards[others] @= self.board.half_turn
        return replace(self, corners=tuple(corners), boards=boards)


def view_of(
    name: str, pictures: BoardPictures, in_hand: bool, stated: Lens | None
) -> View:
    """The view, its lens calibrated by its own pictures where none is stated."""
    refuse_size(stated, pictures.size, f"a picture of {name}")
    if stated is not None:
        stated = replace(stated, size=pictures.size)
    lens = stated or pictures.lens()
    return View(
        **vars(pictures),
        name=name,
        in_hand=in_hand,
        stated_lens=stated,
        first_lens=lens,
        boards=frames_of(pictures.poses(lens)),
    )
