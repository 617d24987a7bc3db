"""Tables: many queries in, many answers out."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..common.atomic import atomic_write
from ..common.wording import listed, printable
from .columns import COMMENT, KEY, PARQUET, Source, open_source, read_columns, read_texts

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True, eq=False)
class Batch:
    """A table of queries, with the columns that go along unread."""

    # (n, k), the columns asked for as `names`; NaN throughout a row that has no number for each
    values: Array
    names: tuple[str, ...]
    invalid: tuple[int, ...]  # numbers of the rows that are NaN; 1 is the first below the header
    header: tuple[str, ...]
    others: Mapping[str, pl.Series]  # the other columns of the `header`, as they are in the file
    # other columns that cannot go along: their name is empty or there twice
    dropped: tuple[str, ...] = ()

    def answered(self, added: Mapping[str, ArrayLike]) -> dict[str, Any]:
        """Return the table's columns in their places, answers in place or behind them."""
        mine = dict(zip(self.names, self.values.T, strict=True))
        columns: dict[str, Any] = {}
        for name in self.header:
            if name in mine:
                columns[name] = added.get(name, mine[name])
            elif name in self.others and name not in added:
                columns[name] = self.others[name]
        columns |= {name: values for name, values in mine.items() if name not in columns}
        return columns | {name: values for name, values in added.items() if name not in columns}

    def take(self, rows: NDArray[np.intp]) -> Batch:
        """The table with some of its rows, which may be there more than once."""
        others = {name: column[rows] for name, column in self.others.items()}
        return replace(self, values=self.values[rows], others=others)

    def notes(self, added: Sequence[str]) -> list[str]:
        """Say how many columns go along, and which do not."""
        kept = [name for name in self.others if name not in added]
        told = {
            "copied to the output unchanged": kept,
            "left out, without a name of its own": [repr(name) for name in self.dropped],
        }
        return [
            f"{len(names)} other column{'s' * (len(names) > 1)} {what}: {listed(names)}"
            for what, names in told.items()
            if names
        ]


def read_batch(
    path: str | os.PathLike[str],
    names: Sequence[str],
    more: Sequence[Sequence[str]] = (),
    columns: Mapping[str, str] | None = None,
) -> Batch:
    """Read a batch of queries and all that stands beside them; bad rows do not stop it.

    more : groups of names of which those count that the table has as a whole
    columns : columns that have other names, by what they hold; the batch has the latter
    """
    source, called = open_source(path), dict(columns or {})
    for group in more:
        if all(called.get(name, name) in source.header for name in group):
            names = (*names, *group)
    held = {called.get(name, name): name for name in names}
    values = read_columns(source, list(held), lenient=True)
    invalid = ~np.isfinite(values).all(axis=1)
    values[invalid] = np.nan
    rest = [name for name in dict.fromkeys(source.header) if name not in held]
    others = [name for name in rest if name and source.header.count(name) == 1]
    return Batch(
        values,
        tuple(names),
        tuple((np.flatnonzero(invalid) + 1).tolist()),
        tuple(held.get(name, name) for name in source.header),
        read_texts(source, others).to_dict(),
        tuple(name for name in rest if name not in others),
    )


def write_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, ArrayLike],
    *,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write columns of numbers, in full, whole or not at all.

    path : Parquet if it ends in .parquet or .pq, else CSV; `-` writes CSV to standard output
    columns : mapping of str to (n,) array, the columns in their order. NaN is written as `nan`.
    about : what holds for all rows, such as `unit`: a line of comment above the header of a CSV
        file, metadata of a Parquet file. `read_about` reads it back.
    """
    import polars as pl

    series = {k: v if isinstance(v, pl.Series) else np.asarray(v) for k, v in columns.items()}
    frame = pl.DataFrame(series)
    told = json.dumps(about, sort_keys=True) if about else ""
    if Path(path).suffix.lower() in PARQUET:
        # by way of memory: what Polars says of a full disk is no OSError
        content = io.BytesIO()
        frame.write_parquet(content, metadata={KEY: told} if told else None)
        atomic_write(path, content.getvalue())
        return
    # Polars spells it "NaN" otherwise
    text = frame.with_columns(pl.col(pl.Float64).fill_nan(None)).write_csv(null_value="nan")
    text = f"{COMMENT}{told}\n{text}" if told else text
    if os.fspath(path) == "-":
        if sys.stdout.isatty():  # a column may have a name that a terminal would obey
            text = "\n".join(map(printable, text.split("\n")))
        sys.stdout.write(text)
    else:
        atomic_write(path, text.encode())


def read_about(table: str | os.PathLike[str] | Source) -> dict[str, Any]:
    """Return what `write_table` wrote about all rows of a table; empty if nothing."""
    source = open_source(table)
    try:
        about = json.loads(source.about)
    except ValueError:
        return {}
    return about if isinstance(about, dict) else {}


def stated_unit(about: Mapping[str, Any]) -> str:
    """Return the unit that a table states for its positions, else "m"; see `read_about`."""
    unit = about.get("unit")
    return unit if isinstance(unit, str) and unit else "m"
