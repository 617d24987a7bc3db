"""Sockets: which one each row of a log touched, and what is known of where they are."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import METRES
from ..common.wording import listed
from ..errors import OptionError

STRAY = 8.0
"""Times the touches' median distance from their socket.  Seven rows of a real Gen3 at 6.6 times it,
10 mm off, weigh little in a fit by their noise: without them its other places came out no better.
"""

MACHINED = 1e-4
"""Sd [m] of a distance or a plane that is stated without one."""

_LENGTH = r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|m|in)\s*"
_DISTANCE = re.compile(rf"(.+),(.+)={_LENGTH}(?:(?:\+-|±){_LENGTH})?")


@dataclass(frozen=True)
class Known:
    """What is known of some sockets: the distance of two, or that several lie in a plane."""

    points: tuple[int, ...]  # their numbers
    value: float | None  # their distance [m]; None: a plane
    tolerance: float = MACHINED  # sd [m]

    def misfit(self, places: Array) -> Array:
        """How far places (p, 3) are off (k,) [m]."""
        points = places[list(self.points)]
        if self.value is not None:
            apart = np.linalg.norm(points[:1] - points[1:], axis=1)
            return np.asarray(apart - self.value)
        centred = points - points.mean(axis=0)
        normal = np.linalg.svd(centred)[2][2]
        # of both senses of the normal always the same one
        return np.asarray(
            centred @ normal * np.sign(normal[np.abs(normal).argmax()])
        )


@dataclass(frozen=True)
class Touches:
    """Which socket each row touched, and what is known of the sockets."""

    # (n,), of the socket; -1 where a sensor measured the tip instead
    number: Index
    sockets: tuple[tuple[str, str], ...]  # setup and point of each number
    facts: tuple[Known, ...] = ()

    @property
    def touched(self) -> Mask:
        """Whether each row is a touch (n,)."""
        return np.asarray(self.number >= 0)

    @property
    def distances(self) -> list[Known]:
        """The facts that are distances."""
        return [fact for fact in self.facts if fact.value is not None]

    def name(self, socket: int) -> str:
        """Setup and point of a socket in a message."""
        return " ".join(self.sockets[socket]).strip()

    def take(self, rows: slice | Index | Mask) -> Touches:
        """The touches of some rows; all sockets keep their numbers."""
        return replace(self, number=self.number[rows])

    def means(self, x: Array, middle: Callable[..., Array] = np.mean) -> Array:
        """Mean of positions `x` (n, m) in each socket (p, m); NaN where no row touched it."""
        means = np.full((len(self.sockets), x.shape[1]), np.nan)
        for socket in np.unique(self.number[self.touched]):
            means[socket] = middle(x[self.number == socket], axis=0)
        return means

    def placed(self, x: Array, places: Array) -> Array:
        """Positions (n, m): places (p, m) of the touched sockets, `x` of rows of a sensor."""
        return np.where(self.touched[:, None], places[self.number], x)

    def about_medians(self, x: Array) -> Array:
        """Distances (n,) of positions `x` (n, m) from the median of their socket's."""
        off = np.linalg.norm(x - self.means(x, np.median)[self.number], axis=1)
        return np.where(self.touched, off, 0.0)

    def renumbered(self) -> tuple[Index, tuple[Known, ...], Index]:
        """Numbers of the sockets that some row touched, what is known of these, and which."""
        sockets = np.unique(self.number[self.touched])
        place = {int(old): new for new, old in enumerate(sockets)}
        facts = [
            replace(fact, points=tuple(place[point] for point in fact.points))
            for fact in self.facts
            if place.keys() >= {*fact.points}
        ]
        number = np.where(
            self.touched, np.searchsorted(sockets, self.number), -1
        )
        return number, tuple(facts), sockets

    def strays(self, off: Array) -> Mask:
        """Rows (n,) far from their socket by distances `off` (n,): the tip was not in it."""
        usual = np.median(off[self.touched]) if self.touched.any() else 0.0
        return np.asarray(self.touched & (off > STRAY * usual))

    def stated(
        self, distances: Sequence[str] = (), planes: Sequence[str] = ()
    ) -> Touches:
        """With what was typed of them, such as `A,B=50mm+-0.1mm` and `A,B,C,D`.

        It holds in each setup that has these points.  Raises OptionError if none has.
        """
        facts = list(self.facts)
        for text in distances:
            points, value, tolerance = _distance(text)
            facts += [
                Known(sockets, value, tolerance)
                for sockets in self._in_each_setup(text, points, 2)
            ]
        for text in planes:
            points = [point.strip() for point in text.split(",")]
            facts += [
                Known(sockets, None)
                for sockets in self._in_each_setup(text, points, 4)
            ]
        return replace(self, facts=tuple(facts))

    def _in_each_setup(
        self, text: str, points: Sequence[str], least: int
    ) -> list[tuple[int, ...]]:
        """Numbers of some points in the setups that have all of them."""
        numbers = []
        for setup in sorted({setup for setup, _ in self.sockets}):
            sockets = [(setup, point) for point in points]
            if {*sockets} <= {*self.sockets}:
                numbers.append(tuple(map(self.sockets.index, sockets)))
        if not numbers or len(points) < least:
            choices = listed(sorted({point for _, point in self.sockets}))
            raise OptionError(
                f"{text!r}: expected points of one setup, four points of a plane: {choices}"
            )
        return numbers


def _distance(text: str) -> tuple[list[str], float, float]:
    """Read `A,B=50mm` or `A,B=50mm+-0.1mm`: the points, their distance and its sd [m]."""
    match = _DISTANCE.fullmatch(text.strip())
    try:
        one, other, value, unit, interval, its_unit = (
            match.groups() if match else ()
        )
        distance = float(value) / METRES[unit]
        sd = float(interval) / METRES[its_unit] / 1.96 if interval else MACHINED
        if not (0 < distance < 1e3 and 0 < sd < 1e3):
            raise ValueError(distance)
    except ValueError:  # no match, or of 1.2.3
        raise OptionError(
            f"distance {text!r}: expected two points, their distance and its unit, such as "
            "A,B=50mm or A,B=50mm+-0.1mm"
        ) from None
    return [one.strip(), other.strip()], distance, sd
