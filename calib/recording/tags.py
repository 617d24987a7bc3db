"""Printed tags in a picture: which, and where to a few hundredths of a pixel."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from ..wording import suggestion
from .edges import crossing, refine_square
from .opencv import opencv

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

DICTIONARY = "apriltag_36h11"
"""The dictionary of tags that is used if none is named."""

ROUGH = 0.5
"""Sides whose points lie further from their line are no sides of a sharp tag, rms [px]."""

FLOOR = 0.03
"""Least standard deviation that a tag's centre is credited with, along each axis [px]."""


@dataclass(frozen=True, eq=False)
class Tag:
    """A tag in a picture; pixel centres have whole coordinates, y runs down.

    Attributes
    ----------
    number : int
        Its id.
    corners : (4, 2) array [px]
        Corners of the black square, clockwise in print from the top left.
    centre : (2,) array [px]
        Where the diagonals cross.
    noise : float [px]
        Standard deviation of the centre along each axis, from how well lines fit the sides.
    sharp : bool
        Whether they fit at all.
    """

    number: int
    corners: Array
    centre: Array
    noise: float = FLOOR
    sharp: bool = True

    @property
    def side(self) -> float:
        """Mean length of its sides [px]."""
        return float(np.linalg.norm(np.roll(self.corners, -1, 0) - self.corners, axis=1).mean())


def dictionary_names() -> tuple[str, ...]:
    """Return the names of the dictionaries of tags, such as `apriltag_36h11` and `5x5_100`."""
    found = [name[5:].lower() for name in dir(opencv().aruco) if name.startswith("DICT_")]
    return tuple(sorted(name for name in found if not name.startswith("arucomip")))


@cache
def find_dictionary(name: str) -> Any:
    """Return OpenCV's dictionary of a name; case, `DICT_` and `apriltag_` may be left out.

    Raises
    ------
    OptionError
        If there is none.
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
    """Finds tags of one dictionary.

    Parameters
    ----------
    dictionary : str
        Its name.
    refined : collection of int, optional
        Ids that are measured to hundredths of a pixel; all if not given.
    """

    def __init__(
        self, dictionary: str = DICTIONARY, refined: Collection[int] | None = None
    ) -> None:
        cv2 = opencv()
        self.dictionary = find_dictionary(dictionary)
        self._refined = refined
        self._cells = int(self.dictionary.markerSize) + 2
        settings = cv2.aruco.DetectorParameters()
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        self._detector = cv2.aruco.ArucoDetector(self.dictionary, settings)

    def find(self, grey: Picture, window: tuple[int, int, int, int] | None = None) -> list[Tag]:
        """Find the tags of a picture, or of its part x0, y0, x1, y1 [px]."""
        shift = np.zeros(2)
        if window is not None:
            x0, y0, x1, y1 = window
            grey, shift = np.ascontiguousarray(grey[y0:y1, x0:x1]), np.array([x0, y0], float)
        found, numbers, _ = self._detector.detectMarkers(grey)
        if numbers is None:
            return []
        tags: list[Tag] = []
        for number, raw in zip(np.ravel(numbers).tolist(), found, strict=True):
            tag = self._measured(grey, number, np.asarray(raw, float).reshape(4, 2), shift)
            same = [t for t in tags if t.number == number]
            if not any(np.linalg.norm(t.centre - tag.centre) < 0.3 * t.side for t in same):
                tags.append(tag)
        return tags

    def _measured(self, grey: Picture, number: int, corners: Array, shift: Array) -> Tag:
        if self._refined is not None and number not in self._refined:
            return Tag(number, corners + shift, crossing(corners) + shift, 0.3)
        refined, rough, _ = refine_square(grey, corners, self._cells)
        side = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).max()
        moved = np.linalg.norm(refined - corners, axis=1).max()
        if rough > ROUGH or moved > 0.1 * side + 2.0:
            return Tag(number, corners + shift, crossing(corners) + shift, 0.5, sharp=False)
        noise = max(FLOOR, rough / 3.0)  # about eight independent points on a side
        return Tag(number, refined + shift, crossing(refined) + shift, noise)
