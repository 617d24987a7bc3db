"""Sockets: which one each row of a log touched, and what is known of where they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Mask
from ..common.scale import METRES
from ..common.wording import listed
from ..errors import OptionError

STRAY = 8.0
"""Times the touches' median distance from their socket.  Seven rows of a real Gen3 at 6.6 times it,
10 mm off, weigh little in a fit by their noise: without them its other places came out no better.
"""

MACHINED = 1e-4
"""Sd [m] of a distance or a plane that is stated without one."""


@dataclass(frozen=True)
class Known:
    """What is known of some sockets: the distance of two, or that several lie in a plane."""

    points: tuple[int, ...]  # their numbers
    value: float | None  # their distance [m]; None: a plane
    tolerance: float = MACHINED  # sd [m]

    def misfit(self, places: Array) -> tuple[Array, Array]:
        """How far places (p, 3) are off (k,) [m], and the derivative (k, p, 3)."""
        own = places[list(self.points)]
        if self.value is not None:
            apart = own[0] - own[1]
            length = max(float(np.linalg.norm(apart)), 1e-12)
            slope = np.zeros((1, len(places), 3))
            slope[0, self.points[0]], slope[0, self.points[1]] = (
                apart / length,
                -apart / length,
            )
            return np.array([length - self.value]), slope
        centred = own - own.mean(axis=0)
        *_, axes = np.linalg.svd(centred)
        # to first order a point leaves the fitted plane by what the plane does not follow
        basis = np.column_stack([np.ones(len(own)), centred @ axes[:2].T])
        left = np.eye(len(own)) - basis @ np.linalg.pinv(basis)
        slope = np.zeros((len(own), len(places), 3))
        slope[:, list(self.points)] = left[:, :, None] * axes[2]
        return centred @ axes[2], slope


@dataclass(frozen=True)
class Touches:
    """Which socket each row touched, and what is known of the sockets."""

    number: NDArray[
        np.intp
    ]  # (n,), of the socket; -1 where a sensor measured the tip instead
    sockets: tuple[tuple[str, str], ...]  # setup and point of each number
    known: tuple[Known, ...] = ()

    def take(self, rows: slice | NDArray[np.intp] | Mask) -> Touches:
        """The touches of some rows; all sockets keep their numbers."""
        return replace(self, number=self.number[rows])

    def means(self, x: Array, middle: Callable[..., Array] = np.mean) -> Array:
        """Mean of positions `x` (n, m) in each socket (p, m); NaN where no row touched it."""
        found = np.full((len(self.sockets), x.shape[1]), np.nan)
        for k in np.unique(self.number[self.number >= 0]):
            found[k] = middle(x[self.number == k], axis=0)
        return found

    def about_medians(self, x: Array) -> Array:
        """Distances (n,) of positions `x` (n, m) from the median of their socket's."""
        off = np.linalg.norm(x - self.means(x, np.median)[self.number], axis=1)
        return np.where(self.number >= 0, off, 0.0)

    def renumbered(
        self,
    ) -> tuple[NDArray[np.intp], tuple[Known, ...], NDArray[np.intp]]:
        """Numbers of the sockets that some row touched, what is known of these, and which."""
        own = np.unique(self.number[self.number >= 0])
        place = {int(old): new for new, old in enumerate(own)}
        known = (
            replace(each, points=tuple(place[k] for k in each.points))
            for each in self.known
            if all(k in place for k in each.points)
        )
        number = np.where(self.number < 0, -1, np.searchsorted(own, self.number))
        return number, tuple(known), own

    def strays(self, off: Array) -> Mask:
        """Rows (n,) far from their socket by distances `off` (n,): the tip was not in it."""
        touched = self.number >= 0
        usual = np.median(off[touched]) if touched.any() else 0.0
        return np.asarray(touched & (off > STRAY * usual))

    def stated(
        self, distances: Sequence[str] = (), planes: Sequence[str] = ()
    ) -> Touches:
        """With what was typed of them, such as `A,B=50mm+-0.1mm` and `A,B,C,D`.

        It holds in each setup that has these points.  Raises OptionError if none has.
        """
        facts = [(text, *_distance(text)) for text in distances]
        facts += [
            (text, [name.strip() for name in text.split(",")], None, 0.0)
            for text in planes
        ]
        known = list(self.known)
        for text, names, value, tolerance in facts:
            setups = [
                [(s, name) for name in names]
                for s in sorted({s for s, _ in self.sockets})
            ]
            found = [some for some in setups if {*some} <= {*self.sockets}]
            if not found or (value is None and len(names) < 4):
                points = listed(sorted({point for _, point in self.sockets}))
                raise OptionError(
                    f"{text!r}: expected points of one setup, four points of a plane: {points}"
                )
            numbers = [tuple(map(self.sockets.index, some)) for some in found]
            known += [Known(points, value, tolerance or MACHINED) for points in numbers]
        return replace(self, known=tuple(known))


def _distance(text: str) -> tuple[list[str], float | None, float]:
    """Read `A,B=50mm` or `A,B=50mm+-0.1mm`: the points, their distance and its sd [m]."""
    number = r"([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|m|in)"
    match = re.fullmatch(
        rf"(.+),(.+)=\s*{number}\s*(?:(?:\+-|±)\s*{number}\s*)?", text.strip()
    )
    with suppress(ValueError):  # of 1.2.3
        if match is not None:
            value = float(match[3]) / METRES[match[4]]
            sd = float(match[5]) / METRES[match[6]] / 1.96 if match[5] else MACHINED
            if 0 < value < 1e3 and 0 < sd < 1e3:
                return [match[1].strip(), match[2].strip()], value, sd
    raise OptionError(
        f"distance {text!r}: expected two points, their distance and its unit, such as "
        "A,B=50mm or A,B=50mm+-0.1mm"
    )
