"""The tag on the tip and the reference, through pictures or the frames of a video.

Use it for what both have in common: each is searched, and why the tag was not taken is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.wording import listed
from ..errors import LogError
from .opencv import Picture
from .setting import Setup
from .tags import Tag, TagFinder
from .watch import Marks

MOST_TWICE = 0.1
"""Share of the pictures that may show two tags of the tip's id: they are left out and told."""

LOOKS = 12
"""Looks at the reference over a video, and pictures that are kept, about."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """What pictures show."""

    numbers: Array  # pictures in which the tag is sharp (n,)
    tags: tuple[Tag, ...]  # the tag in each of them
    marks: tuple[tuple[int, Marks], ...]  # what some pictures show of the reference, by number
    reasons: Counter[str]  # why pictures have no tag, and how many
    size: tuple[int, int]  # width and height of the pictures [px]

    @property
    def pixels(self) -> Array:
        """Places of the tag's centre (n, 2) [px]."""
        return np.array([tag.centre for tag in self.tags])


def sight(
    frames: Iterable[tuple[int, str, Picture]],
    setting: Setup,
    what: str,
    every: int,
    looks: int = 1,
) -> Sightings:
    """Find the tag of a setting, and the reference, in pictures with their numbers and names.

    what : what messages call the pictures
    every : one of so many is kept, to tell which tags are there should this one not be
    looks : the reference is looked for in one of so many
    Raises LogError if the tag is there twice in more than a tenth, or nowhere.
    """
    found: dict[int, Tag] = {}
    marks: list[tuple[int, Marks]] = []
    sample: list[Picture] = []
    twice: list[str] = []
    reasons: Counter[str] = Counter()
    size, count = (0, 0), 0
    for number, name, grey in frames:
        if not count:
            size = (grey.shape[1], grey.shape[0])
            setting.check_size(name, size)
        count += 1
        tags = setting.finder.find(grey)
        if setting.layout is not None and number % looks == 0:
            marks.append((number, setting.marks(grey, tags)))
        if number % every == 0 and len(sample) < LOOKS:
            sample.append(grey)
        tips = [tag for tag in tags if tag.number == setting.tag]
        if len(tips) > 1:
            twice.append(name)
            reasons[f"tag {setting.tag} is there twice"] += 1
        elif not tips:
            reasons[f"tag {setting.tag} not seen"] += 1
        elif not tips[0].sharp:
            reasons["blurred"] += 1
        else:
            found[number] = tips[0]
    if len(twice) > MOST_TWICE * count:
        raise LogError(
            f"tag {setting.tag} is there twice in {len(twice)} of {count} {what} "
            f"({listed(twice, 3)}): cover one, or print another id for the tip"
        )
    if not found:
        raise LogError(
            f"tag {setting.tag} is in none of {count} {what}: {_instead(setting, sample)}"
        )
    numbers = np.array(list(found))
    return Sightings(numbers, tuple(found.values()), tuple(marks), reasons, size)


def _instead(setting: Setup, sample: list[Picture]) -> str:
    """Say which tags some pictures show."""
    finder, seen = TagFinder(setting.dictionary), Counter[int]()
    for grey in sample:
        seen.update({tag.number for tag in finder.find(grey)})
    if not seen:
        return (
            f"no tag of {setting.dictionary} is in {len(sample)} of them; check that it is sharp, "
            "has a white border and is of this dictionary"
        )
    shown = listed([f"{number} ({times} times)" for number, times in seen.most_common()], 6)
    return f"{len(sample)} of them show {shown} of {setting.dictionary}"
