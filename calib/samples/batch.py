"""Batch: a table of queries, with its further columns."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index
from ..common.rows import finite_rows
from ..common.wording import by_name
from .tables import open_source

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True, eq=False)
class Batch:
    """A table of queries, with the columns that go along unread."""

    # (n, k), the columns that are read as `names`; NaN in a row that has no number for each
    values: Array
    names: tuple[str, ...]
    # numbers of the NaN rows; 1 is the first below the header
    invalid: tuple[int, ...]
    # all columns in their order, those that are read by their `names`
    table: pl.DataFrame

    def with_answers(self, added: Mapping[str, ArrayLike]) -> dict[str, Any]:
        """Return the table's columns in their places, answers in place or behind them."""
        columns = {
            name: column
            for name, column in self.table.to_dict().items()
            if name in self.names or name not in added
        }
        return {
            **columns,
            **by_name(self.names, self.values.T),
            **added,
        }

    def take(self, rows: Index) -> Batch:
        """The table with some of its rows, which may be there more than once."""
        return replace(self, values=self.values[rows], table=self.table[rows])


def read_batch(
    path: str | os.PathLike[str],
    names: Sequence[str],
    more: Sequence[Sequence[str]],
    column_of: Mapping[str, str],
) -> Batch:
    """Read a batch of queries and its further columns; bad rows do not stop it.

    more : groups of names of which those count that the table has as a whole
    column_of : columns that have other names, by what they hold; the batch has the latter
    """
    import polars as pl

    source = open_source(path)
    wanted = list(names)
    for group in more:
        if {column_of.get(name, name) for name in group} <= {*source.header}:
            wanted += group
    name_of = {column_of.get(name, name): name for name in wanted}
    values = source.numbers(list(name_of))
    invalid = ~finite_rows(values)
    values[invalid] = np.nan
    shown = [
        name for name in source.header if name in name_of or name not in wanted
    ]
    table = source.read(shown).rename(name_of)
    table = table.with_columns(pl.col(pl.String).fill_null(""))
    return Batch(
        values,
        tuple(wanted),
        tuple(source.row_numbers[invalid].tolist()),
        table,
    )
