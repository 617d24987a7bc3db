"""Measured rows: those of a log that miss nothing, batch by batch, and some of them in memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.checks import LARGEST
from ..errors import LogError
from .columns import Source, read_batches
from .log_ranges import LoggedJoint

_Numbers = NDArray[np.intp]

HELD_ROWS = 200_000
"""Rows of a log that are held in memory; of a longer one so many are drawn."""


class Reservoir:
    """Keeps the rows with the smallest of random keys, and those where a column is extreme.

    The key of a row depends on its place in the log alone, so the same rows stay whatever
    the batches that they come in. Of a log that is not longer than `most` all rows stay.

    most : rows that are kept, besides the extreme ones
    extremes : of so many of the first columns the rows with the least and the largest value stay
        too: a range is that of all rows

    Examples
    --------
    >>> reservoir = Reservoir(3, extremes=1)
    >>> for first in (0, 50):
    ...     reservoir.add(np.arange(first, first + 50.0)[:, None], np.arange(first, first + 50))
    >>> values, numbers = reservoir.rows()
    >>> len(values), values.min().item(), values.max().item()
    (5, 0.0, 99.0)
    """

    def __init__(self, most: int, extremes: int = 0, seed: int = 0) -> None:
        self.most, self.extremes = most, extremes
        self._rng = np.random.default_rng(seed)
        self._parts: list[tuple[Array, Array, _Numbers]] = []

    @property
    def held(self) -> int:
        """Rows that are held now: twice `most`, the extreme ones and a batch at most."""
        return sum(len(keys) for keys, *_ in self._parts)

    def add(self, values: Array, numbers: _Numbers) -> None:
        """Offer the next rows `values` (n, columns) and their numbers in the log (n,)."""
        if len(values):
            self._parts.append((self._rng.random(len(values)), values, numbers))
        if self.held > 2 * self.most:
            self._shrink()

    def rows(self) -> tuple[Array, _Numbers]:
        """Return the rows that were kept, in the order of the log, and their numbers."""
        if not self._parts:
            return np.empty((0, 0)), np.empty(0, dtype=np.intp)
        self._shrink()
        return self._parts[0][1:]

    def _shrink(self) -> None:
        """Let go of all but the rows with the smallest keys, and the extreme ones.

        Rows of the smallest keys are a draw without replacement.
        """
        keys, values, numbers = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        watched = values[:, : self.extremes]
        drawn = np.argpartition(keys, min(self.most, len(keys) - 1))[: self.most]
        kept = np.unique(np.concatenate([drawn, watched.argmin(axis=0), watched.argmax(axis=0)]))
        self._parts = [(keys[kept], values[kept], numbers[kept])]


def measured_rows(
    source: Source, columns: Sequence[str], joints: Sequence[LoggedJoint], reservoir: Reservoir
) -> tuple[Array, _Numbers, int, list[str]]:
    """Read the rows of a log that miss no value and lie in the ranges that the user chose.

    columns : what is read, those of the joints first
    Returns values, numbers : (n, columns), (n,); the rows that the reservoir holds, angles in rad,
        and their numbers in the file
    Returns dropped : how many rows of the file miss a value
    Returns notes : what was left out, and why
    Raises LogError if no row is left, or a column has no number in any row.
    """
    degrees = [k for k, joint in enumerate(joints) if joint.revolute and joint.degrees]
    chosen = {k: joint for k, joint in enumerate(joints) if joint.chosen}
    total = usable = count = 0
    first = ""
    found = np.zeros(len(columns), dtype=bool)
    outside = dict.fromkeys(chosen, 0)
    for values in read_batches(source, columns):
        finite = np.abs(values) < LARGEST
        found |= finite.any(axis=0)
        whole = finite.all(axis=1)
        if not whole.all() and not first:
            row = int(np.argmin(whole))
            first = f"row {total + row + 1}, column {columns[int(np.argmin(finite[row]))]!r}"
        numbers = total + 1 + np.flatnonzero(whole)
        total, usable = total + len(values), usable + len(numbers)
        values = values[whole]
        values[:, degrees] = np.deg2rad(values[:, degrees])
        inside = np.ones(len(values), dtype=bool)
        for k, joint in chosen.items():
            here = joint.holds(values[:, k])
            outside[k] += int(np.count_nonzero(~here))
            inside &= here
        reservoir.add(values[inside], numbers[inside])
        count += int(np.count_nonzero(inside))
    if not total:
        raise LogError(f"{source.label} has a header and no rows")
    for name, there in zip(columns, found, strict=True):
        if not there:
            raise LogError(f"{source.label}: column {name!r} has no finite value in any row")
    if not usable:
        raise LogError(f"{source.label}: each of the {total} rows misses a value")
    notes = []
    if first:
        notes.append(
            f"{total - usable} of {total} rows dropped: a value is missing, not finite or beyond "
            f"{LARGEST:g} (the first is {first})"
        )
    for k, joint in chosen.items():
        shown = joint.show(joint.limits)
        if outside[k] == usable:
            raise LogError(f"{source.label}: no value of {joint.name!r} lies in the range {shown}")
        if outside[k]:
            notes.append(f"{outside[k]} rows dropped: {joint.name} outside of the range {shown}")
    held, numbers = reservoir.rows()
    if len(numbers) < count:
        drawn = f"{len(numbers):,} of them, drawn evenly, are held"
        notes.append(f"{count:,} rows: {drawn}; other counts of values are of these")
    return held, numbers, total - usable, notes
