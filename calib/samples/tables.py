"""Tables: many queries in, many answers out."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.atomic import atomic_write
from .columns import PARQUET, open_source, read_columns
from .csv_rows import COMMENT

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]

_MARK = COMMENT.decode()
_KEY = "calib"  # of the metadata


def read_table(path: str | os.PathLike[str], names: Sequence[str]) -> tuple[Array, tuple[int, ...]]:
    """Read a batch of queries; rows that are no numbers do not stop it.

    Parameters
    ----------
    path : path-like
        CSV or Parquet; `-` reads CSV from standard input.
    names : sequence of str
        The columns wanted.

    Returns
    -------
    values : (n, len(names)) array
        Rows in the file's order; rows with a value that is missing, not finite or no
        number are NaN throughout.
    invalid : tuple of int
        Numbers of those rows; 1 is the first below the header.
    """
    values = read_columns(open_source(path), names, lenient=True)
    invalid = np.logical_not(np.isfinite(values).all(axis=1))
    if invalid.any():
        values[invalid] = np.nan
    return values, tuple((np.flatnonzero(invalid) + 1).tolist())


def write_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, ArrayLike],
    *,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write columns of numbers, in full, whole or not at all.

    Parameters
    ----------
    path : path-like
        Parquet if it ends in .parquet or .pq, else CSV; `-` writes CSV to standard output.
    columns : mapping of str to (n,) array
        The columns in their order. NaN is written as `nan`.
    about : mapping of str to plain values, optional
        What holds for all rows, such as `unit`: a line of comment above the header of a CSV
        file, metadata of a Parquet file. `read_about` reads it back.
    """
    import polars as pl

    frame = pl.DataFrame({name: np.asarray(values) for name, values in columns.items()})
    if os.fspath(path) == "-":
        sys.stdout.write(_comment(about) + _csv(frame))
    elif Path(path).suffix.lower() in PARQUET:
        # by way of memory: what Polars says of a full disk is no OSError
        content = io.BytesIO()
        metadata = {_KEY: json.dumps(about, sort_keys=True)} if about else None
        frame.write_parquet(content, metadata=metadata)
        atomic_write(path, content.getvalue())
    else:
        atomic_write(path, (_comment(about) + _csv(frame)).encode())


def read_about(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what `write_table` wrote about all rows of a table; empty if nothing.

    Parameters
    ----------
    path : path-like
        CSV or Parquet, a file; standard input has none.
    """
    source = open_source(path) if os.fspath(path) != "-" else None
    if source is None:
        return {}
    if source.separator:
        line = next((c for c in source.comments if c.startswith(_MARK)), _MARK + "{}")
        text = line[len(_MARK) :]
    else:
        import polars as pl

        text = pl.read_parquet_metadata(source.path).get(_KEY, "{}")
    try:
        about = json.loads(text)
    except ValueError:
        return {}
    return about if isinstance(about, dict) else {}


def _comment(about: Mapping[str, Any] | None) -> str:
    return f"{_MARK}{json.dumps(about, sort_keys=True)}\n" if about else ""


def _csv(frame: pl.DataFrame) -> str:
    return frame.fill_nan(None).write_csv(null_value="nan")  # Polars spells it "NaN" otherwise
