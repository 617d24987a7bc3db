"""Printed tags in a picture: which, and where to a few hundredths of a pixel."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.choices import DICTIONARY
from ..common.wording import suggestion
from ..errors import OptionError
from .opencv import Picture, opencv
from .patterns import crossing, lay_square

LEAST_NOISE = 0.03
"""Least standard deviation that a tag's centre is credited with, along each axis [px]."""

_SHARP = 0.8  # correlation with the print, below which a tag is not sharp
_MARGINS = (0.13, 0.3)  # of a cell that is not read; OpenCV 4 reads small tags with the second


@dataclass(frozen=True, eq=False)
class Tag:
    """A tag in a picture; pixel centres have whole coordinates, y runs down."""

    number: int  # its id
    corners: Array  # of the black square, clockwise in print from the top left (4, 2) [px]
    centre: Array  # where its diagonals cross (2,) [px]
    noise: float = LEAST_NOISE  # standard deviation of the centre along each axis [px]
    sharp: bool = True  # whether the print can be laid over it

    @property
    def side(self) -> float:
        """Mean length of its sides [px]."""
        return float(_sides(self.corners).mean())

    def same(self, other: Tag) -> bool:
        """Whether both are one tag, found twice: their centres are within a third of a side."""
        near = float(np.linalg.norm(self.centre - other.centre)) < 0.3 * other.side
        return self.number == other.number and near

    @property
    def upright(self) -> float:
        """How far it faces the camera: about the cosine of its tilt, by its area."""
        (x, y), (u, v) = self.corners.T, np.roll(self.corners, -1, 0).T
        return float(0.5 * abs((x * v - u * y).sum()) / max(_sides(self.corners).max() ** 2, 1e-9))


def _sides(corners: Array) -> Array:
    return np.asarray(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1))


def dictionary_names() -> tuple[str, ...]:
    """Return the names of the dictionaries of tags, such as `apriltag_36h11` and `5x5_100`."""
    found = [name[5:].lower() for name in dir(opencv().aruco) if name.startswith("DICT_")]
    return tuple(sorted(name for name in found if not name.startswith("arucomip")))


@cache
def find_dictionary(name: str) -> Any:
    """Return OpenCV's dictionary of a name; case, `DICT_` and `apriltag_` may be left out.

    Raises OptionError if there is none.
    """
    aruco = opencv().aruco
    plain = name.strip().lower().removeprefix("dict_").replace("-", "_")
    names = dictionary_names()
    for candidate in (plain, f"apriltag_{plain}", plain.replace("apriltag", "apriltag_")):
        if candidate in names:
            key = next(k for k in dir(aruco) if k.lower() == f"dict_{candidate}")
            return aruco.getPredefinedDictionary(getattr(aruco, key))
    raise OptionError(f"dictionary {name!r}: {suggestion(plain, names)}")


class TagFinder:
    """Finds tags of one dictionary: wanted ids, or all, which takes ten times as long."""

    def __init__(self, dictionary: str = DICTIONARY, wanted: Collection[int] | None = None) -> None:
        cv2 = opencv()
        known = find_dictionary(dictionary)
        count = len(known.bytesList)
        self.numbers = tuple(range(count) if wanted is None else sorted(set(wanted)))
        if bad := [number for number in self.numbers if not 0 <= number < count]:
            raise OptionError(f"tag {bad[0]}: expected 0 to {count - 1}, the ids of {dictionary}")
        if wanted is not None:
            some = np.ascontiguousarray(known.bytesList[list(self.numbers)])
            known = cv2.aruco.Dictionary(some, known.markerSize, known.maxCorrectionBits)
        self.dictionary = dictionary
        self._detectors = []
        for margin in _MARGINS:
            settings = cv2.aruco.DetectorParameters()
            settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
            settings.perspectiveRemoveIgnoredMarginPerCell = margin
            self._detectors.append(cv2.aruco.ArucoDetector(known, settings))

    def find(self, grey: Picture) -> list[Tag]:
        """Find the tags of a picture."""
        tags: list[Tag] = []
        for detector in self._detectors:
            squares, places, _ = detector.detectMarkers(grey)
            for square, k in zip(squares, () if places is None else np.ravel(places), strict=True):
                corners = np.asarray(square, float).reshape(4, 2)
                tag = self._measured(grey, self.numbers[k], corners)
                if not any(tag.same(other) for other in tags):
                    tags.append(tag)
            if tags and (len(self.numbers) > 20 or {t.number for t in tags} >= {*self.numbers}):
                break
        return tags

    def _measured(self, grey: Picture, number: int, corners: Array) -> Tag:
        refined, likeness = lay_square(grey, tag_cells(number, self.dictionary), corners)
        side = _sides(corners).max()
        moved = np.linalg.norm(refined - corners, axis=1).max()
        if likeness < _SHARP or moved > 0.1 * side + 2.0:
            return Tag(number, corners, crossing(corners), 0.5, sharp=False)
        tag = Tag(number, refined, crossing(refined))
        # short sides cross at a sharp angle: rendered at 60 to 80 deg the miss is 4 to 13 times as
        # large (benchmarks/camera_real.py)
        return replace(tag, noise=tag.noise * max(1.0, 0.9 / tag.upright) ** 1.5)


def tag_cells(number: int, dictionary: str = DICTIONARY) -> NDArray[np.bool_]:
    """Return which cells of a tag are white, its black border included: (cells, cells).

    Raises OptionError if the dictionary has no such id.
    """
    known = find_dictionary(dictionary)
    count = len(known.bytesList)
    if not 0 <= number < count:
        raise OptionError(f"tag {number}: expected 0 to {count - 1}, the ids of {dictionary}")
    size = int(known.markerSize) + 2
    picture = opencv().aruco.generateImageMarker(known, int(number), size)
    return np.asarray(picture) > 127
