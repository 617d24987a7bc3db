"""The reference of a recording: marks at known places, found anew, and whether they moved.

A camera that was bumped between recordings changes where the board appears and leaves positions on
it as they were, up to the uncertainty of finding it again, which is told too.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.rotations import similarity
from ..common.arrays import Array
from ..errors import LogError, OptionError
from ..samples.tables import open_source, read_columns
from .board import LEAST_CORNERS, Board
from .lens import Lens
from .reference import (
    PICTURE,
    PlaneReference,
    PositionReference,
    find_pose,
    fit_flat,
)

Marks = Mapping[int, Array]
_Seen = Sequence[tuple[int, Marks]]

_MOVED = 0.7  # [px]; marks further off than this are elsewhere
_STRETCH = 1.5e-3  # growth of the marks that a new focus is told by


@dataclass(frozen=True, eq=False)
class MarkLayout:
    """Marks at known places of a flat frame: a board's corners, or tags on a desk."""

    what: str  # what messages call it
    points: Marks  # places by number (2,) [m]
    least: int  # marks that must be seen

    def reference(self, seen: Marks, lens: Lens | None, height: float) -> PositionReference:
        """Fit the reference to the marks of a recording."""
        numbers = [n for n in self.points if n in seen]
        flat = np.array([self.points[n] for n in numbers])
        pixels = np.array([seen[n] for n in numbers])
        if lens is None:
            return fit_flat(pixels, flat)
        return PlaneReference(lens, find_pose(lens, np.c_[flat, 0.0 * flat[:, 0]], pixels), height)


def board_layout(board: Board) -> MarkLayout:
    """Return the corners of a board as a layout."""
    return MarkLayout("the board", dict(enumerate(board.corners()[:, :2])), LEAST_CORNERS)


def read_layout(path: str | os.PathLike[str]) -> MarkLayout:
    """Read tags at known places: a table with the columns `tag`, `x`, `y` [m].

    Raises LogError if there are fewer than four, or a tag has two places.
    """
    source = open_source(path)
    rows = read_columns(source, ["tag", "x", "y"])
    numbers = rows[:, 0]
    whole = np.isfinite(rows).all() and (numbers % 1 == 0).all() and (numbers >= 0).all()
    if not whole or len(rows) < 4 or len(set(numbers)) < len(rows):
        raise LogError(
            f"{source.label} has {len(rows)} rows: expected four tags or more around the "
            "workspace, each once, with a whole id under 'tag' and metres under 'x' and 'y'"
        )
    points = {int(row[0]): row[1:] for row in rows}
    if np.abs(rows[:, 1:]).max() > 20.0:
        raise LogError(f"{source.label}: a tag is {np.abs(rows[:, 1:]).max():g} m off; in mm?")
    return MarkLayout("the frame of tags", points, 4)


def watch(
    layout: MarkLayout | None, seen: _Seen, lens: Lens | None, height: float = 0.0
) -> tuple[PositionReference, frozenset[int]]:
    """Find the reference in a recording, and the pictures in which it is elsewhere.

    Without a layout positions are pixels; without a lens a homography is fitted. `seen` has numbers
    of pictures, in order, and what they show; `height` [m] is of the tag's plane over the layout's.

    Raises LogError if the reference is not there, or elsewhere in many pictures.
    """
    if layout is None:
        return PICTURE, frozenset()
    if lens is None and height:
        raise OptionError(
            f"`tag_height={height:g}` needs `lens`: rays are cut with the tag's plane"
        )
    # a hand in the picture hides some marks
    looked = {number: marks for number, marks in seen if len(marks) >= layout.least}
    if not looked:
        most = max((len(marks) for _, marks in seen), default=0)
        raise LogError(
            f"{layout.what} is too small, hidden or not there: at most {most} found in a "
            f"picture, {layout.least} expected"
        )
    middle = _middle([*looked.values()])
    off = frozenset(number for number, marks in looked.items() if _elsewhere(middle, marks))
    if len(off) > 0.3 * len(looked):
        raise LogError(
            f"{layout.what} is elsewhere, or of another size, in {len(off)} of {len(looked)} "
            "pictures: was the camera bumped, is it loose, or does it refocus? fix it and switch "
            "its autofocus off, or make a log of each part"
        )
    kept = _middle([marks for number, marks in looked.items() if number not in off])
    return layout.reference(kept, lens, height), off


def _middle(group: Sequence[Marks]) -> dict[int, Array]:
    numbers = sorted({n for marks in group for n in marks})
    return {n: np.median([m[n] for m in group if n in m], axis=0) for n in numbers}


def _elsewhere(one: Marks, other: Marks) -> bool:
    """Whether the marks that both show moved, by the median of them, or grew.

    A new focus moves marks near the picture's middle by little, and makes all of them grow. Its
    pose would take most of that, and be off by a millimetre away from the board.
    """
    both = [n for n in one if n in other]
    if len(both) < 3:
        return False
    a, b = (np.array([marks[n] for n in both]) for marks in (one, other))
    moved, growth = np.linalg.norm(b - a, axis=1), similarity(a, b)[2] - 1.0
    return bool(np.median(moved) > _MOVED or (abs(growth) > _STRETCH and moved.max() > _MOVED))
