"""Parquet files: names of columns and numbers, or one line that says what is wrong."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .cells import parse_cell

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]


BATCH = 1 << 18
"""Rows of a Parquet file that are held at once."""


def parquet_header(label: str, path: Path) -> tuple[str, ...]:
    """Return the names of the columns."""
    import polars as pl

    with _one_line_errors(label):
        return tuple(pl.read_parquet_schema(path))


def parquet_batches(
    label: str, path: Path, names: Sequence[str], *, lenient: bool = False
) -> Iterator[Array]:
    """Read some columns as numbers, some rows at a time.

    Parameters
    ----------
    label : str
        What errors call the file.
    path : Path
        The file.
    names : sequence of str
        The columns wanted; all of them exist.
    lenient : bool
        Whether text in a number's place is NaN rather than an error.

    Yields
    ------
    (n, len(names)) array
        The next rows, NaN where a value is missing.
    """
    import polars as pl

    with _one_line_errors(label):
        table = pl.scan_parquet(path, glob=False).select(list(dict.fromkeys(names)))
    first, height = 0, BATCH
    while height == BATCH:
        with _one_line_errors(label):
            frame = table.slice(first, BATCH).collect()
        height = frame.height
        if height:
            yield _numbers(frame, names, label, first, lenient)
        first += height


def _numbers(
    frame: pl.DataFrame, names: Sequence[str], label: str, first: int, lenient: bool
) -> Array:
    import polars as pl

    values = np.empty((frame.height, len(names)))
    for i, name in enumerate(names):
        column = frame[name]
        if column.dtype.is_numeric() or column.dtype == pl.Null:
            values[:, i] = column.cast(pl.Float64).fill_null(np.nan).to_numpy()
        elif column.dtype == pl.String:
            for row, text in enumerate(column, start=first + 1):
                where = f"{label}, row {row}, column {name!r}"
                values[row - first - 1, i] = parse_cell(
                    (text or "").strip(), where, lenient=lenient
                )
        else:
            raise LogError(f"{label}, column {name!r} holds {column.dtype}, expected numbers")
    return values


@contextmanager
def _one_line_errors(label: str) -> Iterator[None]:
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
