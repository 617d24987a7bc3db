"""Columns of numbers, read from CSV and Parquet files."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.wording import clipped, quoted
from ..errors import LogError
from .csv_rows import COMMENT, csv_batches, csv_rows
from .parquet import parquet_batches, parquet_errors, parquet_header
from .places import Place, find_place

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]

PARQUET = (".parquet", ".pq")

_ENDLESS = tuple(map(Path, ("/dev/zero", "/dev/random", "/dev/urandom", "/dev/full")))
_LONGEST_HEADER = 1 << 20  # [bytes]; a file without line ends must not fill the memory


@dataclass(frozen=True)
class Source:
    """A table that is ready to be read, as often as wanted.

    Attributes
    ----------
    label : str
        What messages call it.
    path : Path
        The file; of standard input a temporary copy.
    header : tuple of str
        Names of the columns.
    separator : str
        Between the fields of a CSV row; empty for Parquet.
    skip : int
        Lines of a CSV file up to the end of its header.
    keep : object
        Whatever has to live as long as the file is needed.
    comments : tuple of str
        Lines of comment above the header of a CSV file.
    """

    label: str
    path: Path
    header: tuple[str, ...]
    separator: str = ""
    skip: int = 1
    keep: object = None
    comments: tuple[str, ...] = ()


def open_source(path: str | os.PathLike[str] | Source) -> Source:
    """Find the header of a CSV or Parquet file.

    Parameters
    ----------
    path : path-like or Source
        The file; `-` reads CSV from standard input.  A table that is open stays as it is, so
        that a pipe, which can be read only once, serves several readers.

    Returns
    -------
    Source
        The table, of which no row was read yet.

    Raises
    ------
    LogError
        If there is no such file, or no header in it.
    """
    if isinstance(path, Source):
        return path
    name, keep = os.fspath(path), None
    label = "standard input" if name == "-" else _printable(name)
    try:
        if name == "-":
            file, keep = _standard_input()
        else:
            file = Path(path)
            if _is_stream(file):
                file, keep = _spooled(file)
        with file.open("rb") as opened:
            start, comments = opened.readline(_LONGEST_HEADER), []
            while start.startswith(COMMENT):
                comments.append(start.decode("utf-8", "replace").strip())
                start = opened.readline(_LONGEST_HEADER)
    except IsADirectoryError:
        raise LogError(f"{label} is a folder, expected a CSV or Parquet file") from None
    except FileNotFoundError:
        raise LogError(f"there is no file {label!r}") from None
    except (OSError, ValueError) as error:
        raise LogError(f"cannot read {label!r}: {error}") from None
    if start.startswith(b"PAR1"):
        return Source(label, file, parquet_header(label, file), keep=keep)
    if file.suffix.lower() in PARQUET:
        raise LogError(f"{label} is not a Parquet file; rename it to .csv if it is CSV")
    if len(start) == _LONGEST_HEADER:
        raise LogError(f"{label} has no line end in its first megabyte: expected CSV or Parquet")
    separator = max(",;\t", key=lambda mark: start.count(mark.encode()))
    with file.open("rb") as opened:
        for _ in comments:
            opened.readline()
        for line, row in csv_rows(label, opened, separator, len(comments)):
            header = tuple(name.strip() for name in row)
            return Source(label, file, header, separator, line, keep, tuple(comments))
    raise LogError(f"{label} is empty: expected a header with the names of the columns")


def read_batches(source: Source, names: Sequence[str], *, lenient: bool = False) -> Iterator[Array]:
    """Read some columns as numbers, some rows at a time: a file of any length fits.

    Parameters
    ----------
    source : Source
        The table.
    names : sequence of str
        The columns wanted; of a Parquet file's lists one element, as in `state[0]`.
    lenient : bool
        Whether text in a number's place is NaN rather than an error.

    Yields
    ------
    (n, len(names)) array
        The next rows, NaN where a value is missing. Blank lines are no rows.

    Raises
    ------
    LogError
        If a column is missing or there twice, or a value is no number.
    """
    places = [_place(source, name) for name in names]
    label, path = source.label, source.path
    if not source.separator:
        return parquet_batches(label, path, places, lenient=lenient)
    index = [source.header.index(place.column) for place in places]
    return csv_batches(
        label, path, source.header, source.separator, source.skip, index, lenient=lenient
    )


def read_columns(source: Source, names: Sequence[str], *, lenient: bool = False) -> Array:
    """Read some columns as numbers, all rows at once; see `read_batches`."""
    batches = list(read_batches(source, names, lenient=lenient))
    return np.concatenate(batches) if batches else np.empty((0, len(names)))


def read_texts(source: Source, names: Sequence[str]) -> dict[str, pl.Series]:
    """Read some columns as they are: text from CSV, whatever type from Parquet."""
    import polars as pl

    if not names:
        return {}
    if not source.separator:
        with parquet_errors(source.label):
            frame = pl.read_parquet(source.path, columns=list(names), glob=False)
        return {name: frame[name] for name in names}
    index = [source.header.index(name) for name in names]
    texts: list[list[str]] = [[] for _ in names]
    with source.path.open("rb") as file:
        for line, row in csv_rows(source.label, file, source.separator):
            if line > source.skip:
                for cells, i in zip(texts, index, strict=True):
                    cells.append(row[i] if i < len(row) else "")
    return {n: pl.Series(n, cells, pl.String) for n, cells in zip(names, texts, strict=True)}


def _place(source: Source, name: str) -> Place:
    place = find_place(source.header, name)
    if place is None:
        near = get_close_matches(name, source.header, n=1)
        meant = f"did you mean {quoted(near[0])}? " if near else ""
        raise LogError(
            f"{source.label} has no column {quoted(name)}: {meant}columns: "
            f"{_listed(source.header)}",
            hint=f"map another name with `columns={{{clipped(name)!r}: 'OTHER'}}`",
            parameter="columns",
            value=name,
        )
    count = source.header.count(place.column)
    if count > 1:
        raise LogError(
            f"{source.label} has {count} columns {quoted(place.column)}: rename all but one"
        )
    if source.separator and place.element is not None:
        raise LogError(
            f"{source.label} is CSV, which has no lists: there is a column "
            f"{quoted(place.column)} but none {quoted(name)}; lists are read from Parquet"
        )
    return place


def _standard_input() -> tuple[Path, object]:
    """Copy standard input to a temporary file, which can be read again and may be long.

    The file is gone with the last reference to the second value.
    """
    stream = getattr(sys.stdin, "buffer", None)
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    path = Path(folder.name) / "stdin"
    with path.open("wb") as file:
        if stream is not None:
            shutil.copyfileobj(stream, file)
        else:
            file.write(sys.stdin.read().encode())
    return path, folder


def _is_stream(path: Path) -> bool:
    """Whether a file can be read only once: a pipe, a socket, a terminal, /dev/stdin."""
    mode = path.stat().st_mode
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _spooled(path: Path) -> tuple[Path, object]:
    """Copy what can be read only once; see `_standard_input`."""
    if stat.S_ISBLK(path.stat().st_mode) or path.resolve() in _ENDLESS:
        raise LogError(f"{path} is a device that never ends, expected a CSV or Parquet file")
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    copy = Path(folder.name) / f"stream{path.suffix}"
    with path.open("rb") as source, copy.open("wb") as file:
        shutil.copyfileobj(source, file)
    return copy, folder


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)


def _listed(names: Sequence[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(quoted, names[:most])) + more
