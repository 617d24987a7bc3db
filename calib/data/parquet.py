"""Parquet files: names of columns and numbers, or one line that says what is wrong."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .cells import parse_cell

Array = NDArray[np.float64]


def parquet_header(label: str, data: Path | io.BytesIO) -> tuple[str, ...]:
    """Return the names of the columns."""
    import polars as pl

    with _one_line_errors(label):
        return tuple(pl.read_parquet_schema(data))


def read_parquet(
    label: str, data: Path | io.BytesIO, names: Sequence[str], *, lenient: bool = False
) -> Array:
    """Read some columns as numbers.

    Parameters
    ----------
    label : str
        What errors call the file.
    data : Path or BytesIO
        The file.
    names : sequence of str
        The columns wanted; all of them exist.
    lenient : bool
        Whether text in a number's place is NaN rather than an error.

    Returns
    -------
    (n, len(names)) array
        NaN where a value is missing.
    """
    import polars as pl

    with _one_line_errors(label):
        frame = pl.read_parquet(data, columns=list(dict.fromkeys(names)))
    values = np.empty((frame.height, len(names)))
    for i, name in enumerate(names):
        column = frame[name]
        if column.dtype.is_numeric() or column.dtype == pl.Null:
            values[:, i] = column.cast(pl.Float64).fill_null(np.nan).to_numpy()
        elif column.dtype == pl.String:
            for row, text in enumerate(column):
                where = f"{label}, row {row + 1}, column {name!r}"
                values[row, i] = parse_cell((text or "").strip(), where, lenient=lenient)
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
