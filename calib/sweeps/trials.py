"""Trials: what came out of each training of a sweep."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..common.choices import READOUTS

_STATISTICS = ("mean", "p99", "max")


@dataclass(frozen=True, eq=False)
class Trial:
    """One training of a sweep.

    Attributes
    ----------
    source : str
        The robot or the log.
    options : dict
        What the grid says about it.
    seed : int
        Seed of its babbling and its training.
    unit : str
        Unit of its positions ("" if it failed).
    errors : dict
        Errors per readout as ``calib evaluate --json`` prints them; empty if it failed.
    seconds : float [s]
        How long it took; NaN if it failed.
    notes : tuple of str
        What the user should be told.
    error : str
        Why it failed, in one line ("" if it did not).
    """

    source: str
    options: Mapping[str, Any]
    seed: int
    unit: str = ""
    errors: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = math.nan
    notes: tuple[str, ...] = ()
    error: str = ""

    def distance(self, readout: str, direction: str, statistic: str) -> float:
        """Return an error of the tip [unit], NaN if there is none.

        `direction` is "forward" or "inverse", `statistic` "mean", "p99" or "max".
        """
        if readout not in self.errors:
            return math.nan
        value = self.errors[readout][direction]["distance"][statistic]
        return math.nan if value is None else float(value)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
    """What came out of a grid of options.

    Attributes
    ----------
    rows : tuple of Trial
        Every training: sources, then options, then seeds, in the order given.
    backend : str
        Where they ran, "" for one after the other in this process.
    jobs : int
        How many ran at the same time; -1 for all that a cluster offered.
    notes : tuple of str
        What the user should be told.
    """

    rows: tuple[Trial, ...]
    backend: str = ""
    jobs: int = 1
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Say in a line how many trainings there are."""
        bad = f", {len(self.failed)} failed" if self.failed else ""
        return f"Sweep of {len(self.combinations())} combinations, {len(self)} trainings{bad}"

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def failed(self) -> tuple[Trial, ...]:
        """The trainings that failed."""
        return tuple(row for row in self.rows if row.error)

    def combinations(self) -> list[tuple[Trial, ...]]:
        """Return the trainings that differ in nothing but the seed, together."""
        parts: dict[tuple[str, str], list[Trial]] = {}
        for row in self.rows:
            parts.setdefault((row.source, repr(row.options)), []).append(row)
        return [tuple(part) for part in parts.values()]

    def columns(self) -> dict[str, list[Any]]:
        """Return a row for each training, by columns, as they are written to a table."""
        names = dict.fromkeys(name for row in self.rows for name in row.options)
        table: dict[str, list[Any]] = {"source": [row.source for row in self.rows]}
        for name in names:
            values = [row.options.get(name) for row in self.rows]
            # of True and False, which are ints too, a column of words
            numeric = all(type(value) in (int, float) for value in values)
            table[name] = values if numeric else [written(value) for value in values]
        table["seed"] = [row.seed for row in self.rows]
        table["unit"] = [row.unit for row in self.rows]
        for readout, direction, key in itertools.product(
            READOUTS, ("forward", "inverse"), _STATISTICS
        ):
            table[f"{readout}_{direction}_{key}"] = [
                row.distance(readout, direction, key) for row in self.rows
            ]
        table["seconds"] = [row.seconds for row in self.rows]
        table["error"] = [row.error for row in self.rows]
        return table


def written(value: Any) -> str:
    """Return an option's value as it is typed: `30x40`, `2:0.5`, `vdsom`, or nothing for None."""
    if value is None:
        return ""
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str):
        mark = "x" if all(isinstance(v, int | np.integer) for v in value) else ":"
        return mark.join(f"{v:g}" if mark == ":" else str(v) for v in value)
    return str(getattr(value, "__name__", value))
