"""Sockets: which one each row of a log touched, and what is known of where they are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths
from ..common.scale import METRES
from ..common.wording import listing
from ..errors import OptionError
from .motion import RowArrays

STRAY = 8.0
"""Times the touches' median distance from their socket.  Seven rows of a real Gen3 at 6.6 times it,
10 mm off, weigh little in a fit by their noise: without them its other places came out no better.
"""

MACHINED = 1e-4
"""Sd [m] of a distance or a plane that is stated without one."""

_LENGTH = r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|m|in)\s*"
_DISTANCE = re.compile(rf"(.+),(.+)={_LENGTH}(?:(?:\+-|±){_LENGTH})?")


@dataclass(frozen=True)
class SocketFact:
    """A fact about some sockets: the distance of two, or that several lie in a plane."""

    points: tuple[int, ...]  # their numbers
    value: float | None  # their distance [m]; None: a plane
    tolerance: float = MACHINED  # sd [m]

    def misfit(self, places: Array) -> Array:
        """How far places (p, 3) are off (k,) [m]."""
        points = places[list(self.points)]
        if self.value is not None:
            apart = row_lengths(points[:1] - points[1:])
            return np.asarray(apart - self.value)
        centred = points - points.mean(axis=0)
        normal = np.linalg.svd(centred)[2][2]
        # of both senses of the normal always the same one
        return np.asarray(
            centred @ normal * np.sign(normal[np.abs(normal).argmax()])
        )


@dataclass(frozen=True)
class Touches(RowArrays):
    """Which socket each row touched, and what is known of the sockets."""

    # (n,), of the socket; -1 where a sensor measured the tip instead
    number: Index
    sockets: tuple[tuple[str, str], ...]  # setup and point of each number
    facts: tuple[SocketFact, ...] = ()

    @staticmethod
    def of(points: NDArray[np.object_], x: Array) -> Touches:
        """Touches of sockets that rows name by setup and point (n, 2).

        x : (n, 3), known coordinates of the points in their fixtures [m], NaN where not known;
            points of one setup are apart by as much
        """
        touched = points[:, 1] != ""
        sockets = sorted({*map(tuple, points[touched])})
        place = {socket: number for number, socket in enumerate(sockets)}
        number = [place.get(tuple(names), -1) for names in points]
        touches = Touches(np.array(number, np.intp), tuple(sockets))
        stated = touches.means(x, median=True)
        facts = []
        for i, j in combinations(range(len(sockets)), 2):
            apart = float(np.linalg.norm(stated[i] - stated[j]))
            if sockets[i][0] == sockets[j][0] and np.isfinite(apart):
                facts.append(SocketFact((i, j), apart))
        return touches.with_facts(facts)

    @property
    def is_touch(self) -> Mask:
        """Whether each row is a touch (n,)."""
        return np.asarray(self.number >= 0)

    @property
    def distances(self) -> list[SocketFact]:
        """The facts that are distances."""
        return [fact for fact in self.facts if fact.value is not None]

    def name(self, socket: int) -> str:
        """Setup and point of a socket in a message."""
        return " ".join(self.sockets[socket]).strip()

    def with_facts(self, facts: Iterable[SocketFact]) -> Touches:
        """The touches with further facts."""
        return replace(self, facts=(*self.facts, *facts))

    def means(self, x: Array, *, median: bool = False) -> Array:
        """Mean, or median, of positions `x` (n, m) in each socket (p, m); NaN of none."""
        means = np.full((len(self.sockets), x.shape[1]), np.nan)
        mean = np.median if median else np.mean
        for socket in np.unique(self.number[self.is_touch]):
            means[socket] = mean(x[self.number == socket], axis=0)
        return means

    def positions(self, x: Array, places: Array) -> Array:
        """Positions (n, m): places (p, m) of the touched sockets, `x` of rows of a sensor."""
        return np.where(self.is_touch[:, None], places[self.number], x)

    def strays(
        self, tip: Array, places: Array | None = None, least: float = 0.0
    ) -> Mask:
        """Rows (n,) whose tips (n, 3) are far from their socket: the tip was not in it.

        places : (p, 3), of the sockets; their tips' medians by default
        least : distance that is usual at least [m]
        """
        if places is None:
            places = self.means(tip, median=True)
        distance = row_lengths(tip - self.positions(tip, places))
        usual = least
        if self.is_touch.any():
            usual = max(usual, float(np.median(distance[self.is_touch])))
        return np.asarray(distance > STRAY * usual)

    def numbers_and_facts(self) -> tuple[Index, tuple[SocketFact, ...], Index]:
        """Numbers (n,) and facts of the touched sockets alone, and which (k,) these are."""
        sockets = np.unique(self.number[self.is_touch])
        place = np.full(len(self.sockets) + 1, -1)  # of -1 it is -1
        place[sockets] = np.arange(len(sockets))
        facts = [
            replace(fact, points=tuple(place[[*fact.points]].tolist()))
            for fact in self.facts
            if np.isin(fact.points, sockets).all()
        ]
        return place[self.number], tuple(facts), sockets

    def with_stated_facts(
        self, distances: Sequence[str] = (), planes: Sequence[str] = ()
    ) -> Touches:
        """The touches with facts that the user states: `A,B=50mm+-0.1mm`, and `A,B,C,D` of a plane.

        They hold in each setup that has these points.  Raises OptionError if none has.
        """
        facts: list[SocketFact] = []
        for text in distances:
            points, value, tolerance = _distance(text)
            sockets = self._in_each_setup(text, points, "two points")
            facts += [SocketFact(some, value, tolerance) for some in sockets]
        for text in planes:
            points = text.split(",")
            if len(points) < 4:
                raise OptionError(
                    f"plane {text!r}: expected four points or more"
                )
            sockets = self._in_each_setup(text, points, "the points of a plane")
            facts += [SocketFact(some, None) for some in sockets]
        return self.with_facts(facts)

    def _in_each_setup(
        self, text: str, points: Sequence[str], what: str
    ) -> list[tuple[int, ...]]:
        """Numbers of some different points in the setups that have all of them."""
        numbers = []
        for setup in sorted({setup for setup, _ in self.sockets}):
            sockets = [(setup, point.strip()) for point in points]
            each_once = len({*sockets}) == len(sockets)
            if each_once and {*sockets} <= {*self.sockets}:
                numbers.append(tuple(map(self.sockets.index, sockets)))
        if not numbers:
            choices = listing(sorted({point for _, point in self.sockets}))
            raise OptionError(
                f"{text!r}: expected {what} of one setup, each once, of {choices}"
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
    return [one, other], distance, sd
