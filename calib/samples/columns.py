"""Columns of numbers, read from CSV and Parquet files."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..common.wording import clipped, listed, printable, quoted
from ..errors import LogError
from .csv_rows import CsvFile, open_csv
from .parquet import ParquetFile, open_parquet
from .places import NumberColumns, Place, find_place

if TYPE_CHECKING:
    import polars as pl

PARQUET = (".parquet", ".pq")
RECORDINGS = (".bag", ".db3", ".mcap")

_ENDLESS = tuple(map(Path, ("/dev/zero", "/dev/random", "/dev/urandom", "/dev/full")))


Source = CsvFile | ParquetFile
"""A table that is ready to be read, as often as wanted: a file of one format, with its header."""

_FORMATS: dict[bytes, Callable[[str, Path], Source]] = {b"PAR1": open_parquet}
"""Formats by the first four bytes of their files; all others are taken for CSV."""


def open_source(path: str | os.PathLike[str] | Source) -> Source:
    """Find the header of a CSV or Parquet file; no row is read yet.

    `-` reads CSV from standard input.  A table that is open stays as it is, so that a pipe, which
    can be read only once, serves several readers.

    Raises LogError if there is no such file, or no header in it.
    """
    if isinstance(path, Source):
        return path
    name, keep = os.fspath(path), None
    label = "standard input" if name == "-" else printable(name)
    try:
        file = Path(name)
        # what is no regular file (a pipe, a socket, /dev/stdin) can be read only once
        if name == "-" or stat.S_IFMT(file.stat().st_mode) not in (stat.S_IFREG, stat.S_IFDIR):
            file, keep = _spooled(file)
        with file.open("rb") as opened:
            opener = _FORMATS.get(opened.read(4))
    except IsADirectoryError:
        inside = (each.suffix.lower() in RECORDINGS for each in file.iterdir())
        raise LogError(
            f"{label} is a folder, expected a CSV or Parquet file",
            hint=f"if it is a bag, make a log of it: calib log {label} -o log.csv"
            if any(inside)
            else None,
        ) from None
    except FileNotFoundError:
        raise LogError(f"there is no file {label!r}") from None
    except (OSError, ValueError) as error:
        raise LogError(f"cannot read {label!r}: {error}") from None
    if opener is None and file.suffix.lower() in RECORDINGS:
        raise LogError(
            f"{label} is a recording of messages, expected a CSV or Parquet file",
            hint=f"make a log of it: calib log {label} -o log.csv",
        )
    if opener is None and file.suffix.lower() in PARQUET:
        raise LogError(f"{label} is not a Parquet file; rename it to .csv if it is CSV")
    return replace((opener or open_csv)(label, file), keep=keep)


def read_batches(source: Source, names: Sequence[str], *, lenient: bool = False) -> Iterator[Array]:
    """Yield some columns as numbers (n, names), some rows at a time: a file of any length fits.

    Of a Parquet file's lists a name is one element, as in `state[0]`. NaN is a missing value, where
    `lenient` also text in a number's place. Blank lines are no rows.

    Raises LogError if a column is missing or there twice, or a value is no number.
    """
    places = [_place(source, name) for name in names]
    columns = NumberColumns(source.label, places, lenient)
    lengths: dict[str, int] = {}
    first = 1
    for frame in source.frames(list(dict.fromkeys(p.column for p in places)), lenient):
        yield columns.read(frame, first, lengths)
        first += frame.height


def read_columns(source: Source, names: Sequence[str], *, lenient: bool = False) -> Array:
    """Read some columns as numbers, all rows at once; see `read_batches`."""
    batches = list(read_batches(source, names, lenient=lenient))
    return np.concatenate(batches) if batches else np.empty((0, len(names)))


def read_texts(source: Source, names: Sequence[str]) -> pl.DataFrame:
    """Read some columns as they are: text from CSV, whatever type from Parquet."""
    import polars as pl

    frames = list(source.frames(names)) if names else []
    return pl.concat(frames) if frames else pl.DataFrame(schema=dict.fromkeys(names, pl.String))


def _place(source: Source, name: str) -> Place:
    place = find_place(source.header, name)
    if place is None:
        near = get_close_matches(name, source.header, n=1)
        meant = f"did you mean {quoted(near[0])}? " if near else ""
        raise LogError(
            f"{source.label} has no column {quoted(name)}: {meant}columns: "
            f"{listed(map(repr, source.header))}",
            hint=f"map another name with `columns={{{clipped(name)!r}: 'OTHER'}}`",
            parameter="columns",
            value=name,
        )
    count = source.header.count(place.column)
    if count > 1:
        raise LogError(
            f"{source.label} has {count} columns {quoted(place.column)}: rename all but one"
        )
    return place


def _spooled(path: Path) -> tuple[Path, object]:
    """Copy a stream, or standard input for `-`, to a file that can be read again and may be long.

    The file is gone with the last reference to the second value.
    """
    typed = str(path) == "-"
    if not typed and (stat.S_ISBLK(path.stat().st_mode) or path.resolve() in _ENDLESS):
        raise LogError(f"{path} is a device that never ends, expected a CSV or Parquet file")
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    copy = Path(folder.name) / f"stream{path.suffix}"
    with copy.open("wb") as file:
        if not typed:
            with path.open("rb") as stream:
                shutil.copyfileobj(stream, file)
        elif (binary := getattr(sys.stdin, "buffer", None)) is not None:
            shutil.copyfileobj(binary, file)
        else:  # a test's or a notebook's, of text alone
            file.write(sys.stdin.read().encode())
    return copy, folder
