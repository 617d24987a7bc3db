"""Measured rows: those of a log that miss nothing, batch by batch, whatever its length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..common.checks import LARGEST
from ..errors import LogError
from .columns import Source, read_batches
from .log_ranges import ChosenRange

Array = NDArray[np.float64]
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
