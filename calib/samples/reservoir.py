"""A reservoir: some rows of a log of any length, each as likely as any other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]

HELD_ROWS = 200_000
"""Rows of a log that are held in memory; of a longer one so many are drawn."""


class Reservoir:
    """Keeps the rows with the smallest of random keys, and those where a column is extreme.

    The key of a row depends on its place in the log alone, so the same rows stay whatever
    the batches that they come in. Of a log that is not longer than `most` all rows stay.

    Parameters
    ----------
    most : int
        Rows that are kept, besides the extreme ones.
    extremes : int
        Of so many of the first columns the rows with the least and the largest value stay
        too: a range is that of all rows.
    seed : int
        Of the keys.

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
        self._low: list[tuple[Array, int]] = []
        self._high: list[tuple[Array, int]] = []
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
        if not self._parts:
            return np.empty((0, 0)), np.empty(0, dtype=np.intp)
        self._shrink()
        _, values, numbers = self._parts[0]
        ends = self._low + self._high
        missing = {n: row for row, n in ends if not _holds(numbers, n)}
        if missing:
            numbers = np.concatenate([numbers, np.array(list(missing), dtype=np.intp)])
            values = np.concatenate([values, np.stack(list(missing.values()))])
            order = np.argsort(numbers, kind="stable")
            values, numbers = values[order], numbers[order]
        return values, numbers

    def _shrink(self) -> None:
        """Let go of all but the rows with the smallest keys."""
        keys, values, numbers = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        if len(keys) > self.most:
            self._limit = float(np.partition(keys, self.most)[self.most])
            chosen = keys < self._limit
            keys, values, numbers = keys[chosen], values[chosen], numbers[chosen]
        self._parts = [(keys, values, numbers)]
        self.held = len(keys)

    def _widen(self, values: Array, numbers: Numbers) -> None:
        """Remember the rows that go beyond all earlier ones."""
        for ends, pick, beyond in (
            (self._low, np.argmin, np.less),
            (self._high, np.argmax, np.greater),
        ):
            for k, row in enumerate(pick(values[:, : self.extremes], axis=0).tolist()):
                found = values[row].copy(), int(numbers[row])
                if k == len(ends):
                    ends.append(found)
                elif beyond(values[row, k], ends[k][0][k]):
                    ends[k] = found


def _holds(numbers: Numbers, number: int) -> bool:
    """Whether ascending numbers hold one of them."""
    place = int(np.searchsorted(numbers, number))
    return place < len(numbers) and int(numbers[place]) == number
