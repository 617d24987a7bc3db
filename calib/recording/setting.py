"""What a recording is made with: the tag, the reference, the lens."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..common.choices import DICTIONARY
from ..errors import LogError, OptionError
from .board import Board, BoardFinder
from .lens import Lens, calibrate_lens, read_lens
from .opencv import Picture
from .pictures import list_pictures, read_series
from .reference import PositionReference
from .tags import Tag, TagFinder
from .watch import MarkLayout, Marks, board_layout


@dataclass(frozen=True)
class Setup:
    """What is in the pictures, and what is known of the camera."""

    tag: int  # id of the tag on the tip
    dictionary: str = DICTIONARY  # of the tags on the tip and around the arm
    # what lies on the desk, a board or tags at known places: positions are in its frame [m]
    board: Board | None = None
    tags_at: MarkLayout | None = None
    lens: Lens | None = None  # the camera's
    tag_size: float | None = None  # side of the tip's tag: its pose needs it [m]
    tag_height: float = 0.0  # of the tip's tag above the board, or the tags on the desk [m]
    pose: bool = False  # whether z and the orientation of the tag are wanted too
    finder: TagFinder = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        at = self.tags_at.points if self.tags_at is not None else {}
        board, height = self.board, self.tag_height
        printed = 0  # tags of this dictionary on the board
        if board is not None and board.dictionary.lower() == self.dictionary.lower():
            printed = board.columns * board.rows // 2
        refusals = {
            "`board` and `tags_at` are both given: expected one of them": board and self.tags_at,
            "`board` is given without `lens`: positions in metres may be off by centimetres away "
            "from the board; take 10 pictures of the board and give their folder as `lens`": (
                board and self.lens is None
            ),
            f"`tag_height={height:g}`: expected less than 10 m": not abs(height) <= 10.0,
            "`tag_height` is given without `board` or `tags_at`, above which it is measured": (
                height and self.layout is None
            ),
            "the tag's pose needs `lens`": self.pose and self.lens is None,
            "the tag's pose needs `tag_size`": self.pose and self.tag_size is None,
            f"tag {self.tag} is on the tip and in `tags_at`: expected another id": self.tag in at,
            f"tag {self.tag} is printed on the board too, which has 0 to {printed - 1} of "
            f"{self.dictionary}: take another id": self.tag < printed,
        }
        for message, wrong in refusals.items():
            if wrong:
                raise OptionError(message)
        object.__setattr__(self, "finder", TagFinder(self.dictionary, {self.tag, *at}))

    @property
    def layout(self) -> MarkLayout | None:
        """What positions are told in, if not pixels."""
        return board_layout(self.board) if self.board is not None else self.tags_at

    def check_size(self, name: str, size: tuple[int, int]) -> None:
        """Refuse pictures of another size than the lens."""
        if self.lens is not None and self.lens.size != size:
            raise LogError(
                f"{name} is {size[0]}x{size[1]}, the lens was calibrated with "
                f"{self.lens.size[0]}x{self.lens.size[1]}: record with the same settings, or "
                "calibrate again"
            )

    @cached_property
    def _boards(self) -> BoardFinder | None:
        return BoardFinder(self.board) if self.board is not None else None

    def marks(self, grey: Picture, tags: Sequence[Tag]) -> Marks:
        """Return what a picture shows of the reference."""
        if self._boards is not None:
            return self._boards.find(grey)
        at = self.tags_at.points if self.tags_at is not None else {}
        counts = [t.number for t in tags]
        return {t.number: t.centre for t in tags if t.number in at and counts.count(t.number) == 1}

    def about(self, reference: PositionReference) -> dict[str, Any]:
        """Return what a log tells of its source, as plain values."""
        told: dict[str, Any] = {"tag": self.tag, "dictionary": self.dictionary}
        told["reference"] = reference.told()
        if self.lens is not None:
            told["lens"] = self.lens.to_json()
        return told


def load_lens(
    path: str | os.PathLike[str], board: Board | None, output: str | os.PathLike[str] | None = None
) -> tuple[Lens, tuple[str, ...]]:
    """Read the `lens.json` of an earlier run, or calibrate by a folder or pattern of pictures.

    Returns notes too; a calibrated lens is written to `output`.
    """
    if not Path(path).is_dir() and not any(mark in str(path) for mark in "*?["):
        return read_lens(path), ()
    if board is None:
        raise OptionError("`lens` is a folder of pictures: expected `board` too, which they show")
    finder, pictures, damaged = BoardFinder(board), list_pictures(path), list[str]()
    corners, size = [], (0, 0)
    for _, grey in read_series(pictures, damaged):
        size = (grey.shape[1], grey.shape[0])
        corners.append(finder.find(grey))
    lens, doubts = calibrate_lens(corners, board, size)
    notes = [f"lens: {text}; it was left out" for text in damaged]
    notes.append(
        f"lens of {lens.pictures} of {len(pictures)} pictures: focal length "
        f"{lens.focal[0]:.1f} px, corners miss their places by {lens.rms:.2f} px rms"
    )
    if output is not None:
        lens.save(output)
        notes.append(f"lens written to {os.fspath(output)}")
    return lens, (*notes, *doubts)
