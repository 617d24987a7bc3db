"""What a recording is made with: the tag, the reference, the lens; and what pictures show of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array
from ..common.choices import DICTIONARY
from ..common.wording import listed
from ..errors import LogError, OptionError
from .board import Board
from .lens import UNSTATED, Lens
from .pictures import Frame, Picture
from .reference import MarkLayout, Marks, PlaneReference, watch
from .tags import Tag, TagFinder

LOOKS = 12
"""Looks at the reference over a video, and pictures that are kept, about."""

# share of the pictures that may show two tags of the tip's id
_MOST_TWICE = 0.1


@dataclass(frozen=True)
class Setup:
    """What is in the pictures, and what is known of the camera."""

    tag: int  # id of the tag on the tip
    dictionary: str = DICTIONARY  # of the tags on the tip and around the arm
    # what lies on the desk, a board or tags at known places: positions are in its frame [m]
    board: Board | None = None
    tags_at: MarkLayout | None = None
    lens: Lens | None = None  # the camera's
    # side of the tip's tag: its pose needs it [m]
    tag_size: float | None = None
    # of the tip's tag above the board, or the tags on the desk [m]
    tag_height: float = 0.0
    # whether z and the orientation of the tag are wanted too
    pose: bool = False

    def __post_init__(self) -> None:
        layout = self.layout
        board = self.board
        same = (
            board is not None
            and board.dictionary.lower() == self.dictionary.lower()
        )
        printed = board.tags if board is not None and same else 0
        refusals = {
            "`board` and `tags_at` are both given: expected one of them": board
            and self.tags_at,
            "`board` or `tags_at` is given without `lens`: positions in metres may be off by "
            "centimetres; take 10 pictures of a board and give their folder as `lens`": (
                layout and self.lens is None
            ),
            "`tag_height` is given without `board` or `tags_at`, above which it is measured": (
                self.tag_height and not layout
            ),
            "the tag's pose needs `lens` and `tag_size`": (
                self.pose and (self.lens is None or self.tag_size is None)
            ),
            f"tag {self.tag} is on the tip and in `tags_at`, or printed on the board too: take "
            "another id": self.tag < printed
            or (self.tags_at and self.tag in self.tags_at.points),
        }
        for message, wrong in refusals.items():
            if wrong:
                raise OptionError(message)

    @cached_property
    def layout(self) -> MarkLayout | None:
        """What positions are told in, if not pixels."""
        return (
            MarkLayout.of_board(self.board)
            if self.board is not None
            else self.tags_at
        )

    @cached_property
    def finder(self) -> TagFinder:
        """Finds the tip's tag and those on the desk."""
        at = self.tags_at.points if self.tags_at is not None else {}
        return TagFinder(self.dictionary, {self.tag, *at})

    def marks(self, grey: Picture, tags: Sequence[Tag]) -> Marks:
        """Return what a picture shows of the reference."""
        if self.board is not None:
            return self.board.find(grey)
        counts = Counter(t.number for t in tags)
        at = self.tags_at and self.tags_at.points
        return {
            t.number: t.centre
            for t in tags
            if counts[t.number] == 1 and t.number in (at or ())
        }


@dataclass(frozen=True, eq=False)
class Sightings:
    """What pictures show."""

    setting: Setup
    what: str  # what messages call the pictures
    numbers: Array  # pictures in which the tag is sharp (n,)
    names: tuple[str, ...]  # and theirs
    tags: tuple[Tag, ...]  # the tag in each of them
    marks: dict[
        int, Marks
    ]  # what some pictures show of the reference, by number
    reasons: Counter[str]  # why pictures have no tag, and how many
    count: int  # pictures in all
    size: tuple[int, int]  # width and height of the pictures [px]

    @cached_property
    def pixels(self) -> Array:
        """Places of the tag's centre (n, 2) [px]."""
        return np.array([tag.centre for tag in self.tags])

    @cached_property
    def reference(self) -> tuple[PlaneReference | None, frozenset[int]]:
        """What positions are told in, None for pixels; and the pictures in which it is elsewhere.

        Raises LogError if it is not there, or elsewhere in many.
        """
        layout = self.setting.layout
        lens = self.setting.lens
        if layout is None or lens is None:
            return None, frozenset()
        return watch(layout, self.marks, lens, self.setting.tag_height)


def sight(
    frames: Iterable[Frame], setting: Setup, what: str, every: int = 1
) -> Sightings:
    """Find the tag of a setting, and the reference, in pictures.

    what : what messages call the pictures
    every : the reference is looked for in one of so many; some of these are kept, to tell which
        tags are there should this one not be
    Raises LogError if the tag is there twice in more than a tenth, or nowhere.
    """
    sharp_tags = dict[int, tuple[str, Tag]]()
    marks = dict[int, Marks]()
    sample = list[Picture]()
    reasons = Counter[str]()
    size = (0, 0)
    count = 0
    twice = list[str]()
    for number, name, grey in frames:
        count = count + 1
        size = (grey.shape[1], grey.shape[0])
        if setting.lens is not None and setting.lens.size not in (
            size,
            UNSTATED,
        ):
            expected = "{}x{}".format(*setting.lens.size)
            raise LogError(
                f"{name} is {size[0]}x{size[1]}, the lens was calibrated with {expected}"
            )
        tags = setting.finder.find(grey)
        if number % every == 0:
            sample += [grey] * (len(sample) < LOOKS)
            if setting.layout is not None:
                marks[number] = setting.marks(grey, tags)
        tips = [tag for tag in tags if tag.number == setting.tag]
        if len(tips) == 1 and tips[0].sharp:
            sharp_tags[number] = name, tips[0]
        elif len(tips) > 1:
            twice.append(name)
            reasons[f"tag {setting.tag} is there twice"] += 1
        else:
            reasons["blurred" if tips else f"tag {setting.tag} not seen"] += 1
    if len(twice) > _MOST_TWICE * count:
        raise LogError(
            f"tag {setting.tag} is there twice in {len(twice)} of {count} {what} "
            f"({listed(twice, 3)}): cover one, or print another id for the tip"
        )
    if not sharp_tags:
        finder = TagFinder(setting.dictionary)
        counts = Counter(
            n for grey in sample for n in {t.number for t in finder.find(grey)}
        )
        shown = listed(
            [
                f"{number} ({times} times)"
                for number, times in counts.most_common()
            ],
            6,
        )
        raise LogError(
            f"tag {setting.tag} is in none of {count} {what}: {len(sample)} of them show {shown} "
            f"of {setting.dictionary}; check the id, the dictionary, that it is sharp and has a "
            "white border"
        )
    names, sharp = zip(*sharp_tags.values(), strict=True)
    numbers = np.array(list(sharp_tags))
    return Sightings(
        setting, what, numbers, names, sharp, marks, reasons, count, size
    )
