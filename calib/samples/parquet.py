"""Parquet files: names of columns and numbers, or one line that says what is wrong."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .places import Place, numbers_of

if TYPE_CHECKING:
    import polars as pl

KEY = "calib"
"""Names the entry of the metadata that says what holds for all rows."""

BATCH = 1 << 18
"""Rows of a Parquet file that are held at once."""

ELEMENTS = 1 << 24
"""Elements of a column of lists that are held at once."""


@dataclass(frozen=True)
class ParquetFile:
    """A Parquet file, of which the header is read; errors call it `label`."""

    label: str
    path: Path
    header: tuple[str, ...]

    def batches(self, places: Sequence[Place], *, lenient: bool) -> Iterator[Array]:
        """Yield (n, len(places)) arrays, NaN where a value, or a whole list, is missing."""
        import polars as pl

        with parquet_errors(self.label):
            wanted = list(dict.fromkeys(place.column for place in places))
            table = pl.scan_parquet(self.path, glob=False).select(wanted)
        lists = dict.fromkeys(place.column for place in places if place.element is not None)
        lengths: dict[str, int] = {}
        # the first row alone tells how long the lists are, and so how many rows fit
        first, size = 0, 1 if lists else BATCH
        while True:
            with parquet_errors(self.label):
                frame = table.slice(first, size).collect()
            for name in lists:
                _check_lists(frame[name], lengths, self.label, first)
            if frame.height:
                yield _numbers(frame, places, lengths, self.label, first, lenient)
            if frame.height < size:
                return
            first += size
            size = min(BATCH, max(1, ELEMENTS // max(lengths.values(), default=1)))

    def texts(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Read columns as they are, of whatever type."""
        import polars as pl

        with parquet_errors(self.label):
            frame = pl.read_parquet(self.path, columns=list(names), glob=False)
        return {name: frame[name] for name in names}

    def about(self) -> str:
        """Return what the file says of all its rows, as JSON."""
        import polars as pl

        read = getattr(pl, "read_parquet_metadata", None)  # of newer versions
        return str(read(self.path).get(KEY, "{}")) if read else "{}"


def open_parquet(label: str, path: Path) -> ParquetFile:
    """Read the names of a Parquet file's columns."""
    import polars as pl

    with parquet_errors(label):
        return ParquetFile(label, path, tuple(pl.read_parquet_schema(path)))


def _check_lists(column: pl.Series, lengths: dict[str, int], label: str, first: int) -> None:
    """Refuse lists whose elements have no fixed places; enter their length."""
    import polars as pl

    name = column.name
    if isinstance(column.dtype, pl.Array):
        lengths[name] = column.dtype.shape[0]
    elif isinstance(column.dtype, pl.List):
        # a list that is missing has no length, or in early versions of Polars 0
        found = np.where(column.is_null(), -1, column.list.len().fill_null(0).cast(pl.Int64))
        there = found[found >= 0]
        if not len(there):
            return
        length = lengths.setdefault(name, int(there[0]))
        wrong = (found >= 0) & (found != length)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise LogError(
                f"{label}, row {first + row + 1}, column {name!r}: a list of {found[row]} after "
                f"lists of {length}; which element is which cannot be told"
            )
    elif column.dtype != pl.Null:
        raise LogError(f"{label}, column {name!r} holds {column.dtype}, expected lists")


def _numbers(
    frame: pl.DataFrame,
    places: Sequence[Place],
    lengths: Mapping[str, int],
    label: str,
    first: int,
    lenient: bool,
) -> Array:
    import polars as pl

    values = np.empty((frame.height, len(places)))
    for i, place in enumerate(places):
        column = frame[place.column]
        if place.element is not None and column.dtype != pl.Null:
            length = lengths.get(place.column)
            if length is not None and place.element >= length:
                raise LogError(
                    f"{label}, column {place.column!r} holds lists of {length}, counted from 0: "
                    f"there is no {place.name!r}"
                )
            get = column.arr.get if isinstance(column.dtype, pl.Array) else column.list.get
            column = get(place.element, null_on_oob=True)
        if column.dtype.is_numeric() or column.dtype == pl.Null:
            values[:, i] = column.cast(pl.Float64).fill_null(np.nan).to_numpy()
        elif column.dtype == pl.String:
            values[:, i] = numbers_of(column, label, place.name, first + 1, lenient=lenient)
        else:
            lists = place.element is None and isinstance(column.dtype, (pl.List, pl.Array))
            remedy = f"; name one element, such as {place.name}[0]" if lists else ""
            raise LogError(
                f"{label}, column {place.name!r} holds {column.dtype}, expected numbers{remedy}"
            )
    return values


@contextmanager
def parquet_errors(label: str) -> Iterator[None]:
    """Tell a failure of Polars in one line, without what its threads print on a panic."""
    import polars as pl

    try:
        with _quiet_stderr():
            yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        reason = (str(error).strip().splitlines() or ["unreadable"])[0][:100]
        raise LogError(f"{label} is a damaged Parquet file: {reason}") from None


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Send the process's standard error nowhere for a moment."""
    # the whole process's, other threads' words too: a panic of Polars' Rust threads writes to
    # descriptor 2 by itself, before Python sees an exception, and nothing else stops it
    with suppress(AttributeError, ValueError):
        sys.stderr.flush()
    try:
        stderr = os.dup(2)
    except OSError:  # there is none
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)
