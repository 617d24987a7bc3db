"""Measured rows: those of a log that miss nothing, batch by batch, and some of them in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.checks import LARGEST
from ..errors import LogError
from .columns import Source, read_batches
from .log_ranges import ChosenRange

Numbers = NDArray[np.intp]


@dataclass
class MeasuredRows:
    """The usable rows of a log, and a count of the others."""

    source: Source
    # the columns that are read, and which of them are in degrees, and are to be in rad
    columns: Sequence[str]
    degrees: Sequence[int] = ()
    # ranges that the user asked for; rows outside of them are left out
    chosen: Mapping[int, ChosenRange] = field(default_factory=dict)
    # rows that were read, and those that miss no value; counted by `batches`
    total: int = 0
    usable: int = 0

    def batches(self) -> Iterator[tuple[Array, Numbers]]:
        """Yield values (n, columns) of the next usable rows and their numbers from 1 (n,)."""
        self.total = self.usable = 0
        self._first: tuple[int, str] | None = None
        self._found = np.zeros(len(self.columns), dtype=bool)
        for values in read_batches(self.source, self.columns):
            numbers = np.arange(self.total + 1, self.total + len(values) + 1)
            self.total += len(values)
            finite = np.abs(values) < LARGEST
            self._found |= finite.any(axis=0)
            whole = finite.all(axis=1)
            if not whole.all():
                if self._first is None:
                    row = int(np.argmin(whole))
                    self._first = int(numbers[row]), self.columns[int(np.argmin(finite[row]))]
                values, numbers = values[whole], numbers[whole]
            self.usable += len(values)
            if self.degrees:
                values = values.copy()
                values[:, self.degrees] = np.deg2rad(values[:, self.degrees])
            inside = np.ones(len(values), dtype=bool)
            for k, range_ in self.chosen.items():
                inside &= range_.holds(values[:, k])
            yield values[inside], numbers[inside]

    def notes(self) -> list[str]:
        """Say what was left out; a log without any usable row is an error."""
        if not self.total:
            raise LogError(f"{self.source.label} has a header and no rows")
        notes = []
        if self._first is not None:
            for name, found in zip(self.columns, self._found.tolist(), strict=True):
                if not found:
                    raise LogError(
                        f"{self.source.label}: column {name!r} has no finite value in any row"
                    )
            dropped = self.total - self.usable
            if not self.usable:
                raise LogError(f"{self.source.label}: each of the {dropped} rows misses a value")
            number, name = self._first
            notes.append(
                f"{dropped} of {self.total} rows dropped: a value is missing, not finite or "
                f"beyond {LARGEST:g} (the first is row {number}, column {name!r})"
            )
        for range_ in self.chosen.values():
            notes += range_.notes()
        return notes


HELD_ROWS = 200_000
"""Rows of a log that are held in memory; of a longer one so many are drawn."""


class Reservoir:
    """Keeps the rows with the smallest of random keys, and those where a column is extreme.

    The key of a row depends on its place in the log alone, so the same rows stay whatever
    the batches that they come in. Of a log that is not longer than `most` all rows stay.

    most : rows that are kept, besides the extreme ones
    extremes : of so many of the first columns the rows with the least and the largest value stay
        too: a range is that of all rows

    Attributes
    ----------
    held : int
        Rows that are held now, never more than 2 `most` and a batch.

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
        self._limit = np.inf
        self._parts: list[tuple[Array, Array, Numbers]] = []
        self._ends: tuple[Array, Numbers] | None = None  # the extreme rows and their numbers
        self.held = 0

    def add(self, values: Array, numbers: Numbers) -> None:
        """Offer the next rows `values` (n, columns) and their numbers in the log (n,)."""
        keys = self._rng.random(len(values))
        if not len(values):
            return
        self._widen(values, numbers)
        chosen = keys < self._limit
        if chosen.any():
            self._parts.append((keys[chosen], values[chosen], numbers[chosen]))
            self.held += int(np.count_nonzero(chosen))
        if self.held > 2 * self.most:
            self._shrink()

    def rows(self) -> tuple[Array, Numbers]:
        """Return the rows that were kept, in the order of the log, and their numbers."""
        if not self._parts or self._ends is None:
            return np.empty((0, 0)), np.empty(0, dtype=np.intp)
        self._shrink()
        _, values, numbers = self._parts[0]
        numbers, rows = np.unique(np.concatenate([numbers, self._ends[1]]), return_index=True)
        return np.concatenate([values, self._ends[0]])[rows], numbers

    def _shrink(self) -> None:
        """Let go of all but the rows with the smallest keys."""
        keys, values, numbers = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        if len(keys) > self.most:
            # rows of the smallest keys are a draw without replacement, and no later key above
            # the limit can be among them: memory stays bounded whatever the length
            self._limit = float(np.partition(keys, self.most)[self.most])
            chosen = keys < self._limit
            keys, values, numbers = keys[chosen], values[chosen], numbers[chosen]
        self._parts = [(keys, values, numbers)]
        self.held = len(keys)

    def _widen(self, values: Array, numbers: Numbers) -> None:
        """Remember the rows that go beyond all earlier ones."""
        if self._ends is not None:  # first, so that of equals the earliest stays
            values = np.concatenate([self._ends[0], values])
            numbers = np.concatenate([self._ends[1], numbers])
        watched = values[:, : self.extremes]
        rows = np.unique(np.concatenate([watched.argmin(axis=0), watched.argmax(axis=0)]))
        self._ends = values[rows], numbers[rows]
