"""Columns of numbers, read from CSV and Parquet files."""

from __future__ import annotations

import csv
import io
import os
import sys
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .cells import parse_cell
from .parquet import parquet_header, read_parquet

Array = NDArray[np.float64]

PARQUET = (".parquet", ".pq")

_LONGEST_HEADER = 1 << 20  # [bytes]; a file without line ends must not fill the memory


@dataclass(frozen=True)
class Source:
    """A table that is ready to be read.

    Attributes
    ----------
    label : str
        What messages call it.
    data : Path or bytes
        The file, or all that came from standard input.
    header : tuple of str
        Names of the columns.
    separator : str
        Between the fields of a CSV row; empty for Parquet.
    skip : int
        Lines of a CSV file up to the end of its header.
    """

    label: str
    data: Path | bytes
    header: tuple[str, ...]
    separator: str = ""
    skip: int = 1

    @property
    def binary(self) -> Path | io.BytesIO:
        """The data as Polars takes them."""
        return io.BytesIO(self.data) if isinstance(self.data, bytes) else self.data


def open_source(path: str | os.PathLike[str]) -> Source:
    """Find the header of a CSV or Parquet file.

    Parameters
    ----------
    path : path-like
        The file; `-` reads CSV from standard input.

    Returns
    -------
    Source
        The table, of which no row was read yet.

    Raises
    ------
    LogError
        If there is no such file, or no header in it.
    """
    label = "standard input" if os.fspath(path) == "-" else _printable(os.fspath(path))
    data = _standard_input() if os.fspath(path) == "-" else Path(path)
    try:
        with _open_binary(data) as file:
            start = file.readline(_LONGEST_HEADER)
    except IsADirectoryError:
        raise LogError(f"{label} is a folder, expected a CSV or Parquet file") from None
    except FileNotFoundError:
        raise LogError(f"there is no file {label!r}") from None
    except (OSError, ValueError) as error:
        raise LogError(f"cannot read {label!r}: {error}") from None
    if start.startswith(b"PAR1"):
        parquet = Source(label, data, ())
        return replace(parquet, header=parquet_header(label, parquet.binary))
    if Path(path).suffix.lower() in PARQUET:
        raise LogError(f"{label} is no Parquet file; name it .csv if it is CSV")
    if len(start) == _LONGEST_HEADER:
        raise LogError(f"{label} has no line end in its first megabyte: expected CSV or Parquet")
    separator = max(",;\t", key=lambda mark: start.count(mark.encode()))
    source = Source(label, data, (), separator)
    for line, row in _rows(source):
        header = tuple(name.strip() for name in row)
        return Source(label, data, header, separator, skip=line)
    raise LogError(f"{label} is empty: expected a header with the names of the columns")


def read_columns(source: Source, names: Sequence[str], *, lenient: bool = False) -> Array:
    """Read some columns as numbers.

    Parameters
    ----------
    source : Source
        The table.
    names : sequence of str
        The columns wanted.
    lenient : bool
        Whether text in a number's place is NaN rather than an error.

    Returns
    -------
    (n, len(names)) array
        NaN where a value is missing. Blank lines are no rows.

    Raises
    ------
    LogError
        If a column is missing or there twice, or a value is no number.
    """
    _check_columns(source, names)
    if not source.separator:
        return read_parquet(source.label, source.binary, names, lenient=lenient)
    index = [source.header.index(name) for name in names]
    values = _read_csv_fast(source, index)
    return _read_csv(source, index, lenient) if values is None else values


def _check_columns(source: Source, names: Sequence[str]) -> None:
    for name in names:
        count = source.header.count(name)
        if count > 1:
            raise LogError(f"{source.label} has {count} columns {name!r}: rename all but one")
        if count == 0:
            near = get_close_matches(name, source.header, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise LogError(
                f"{source.label} has no column {name!r}: {hint}columns: "
                f"{_listed(source.header)}; map another name with --columns {name}=OTHER"
            )


def _read_csv_fast(source: Source, index: Sequence[int]) -> Array | None:
    """Read clean CSV in Polars; None sends every doubtful file to `_read_csv`."""
    import polars as pl

    if source.skip != 1 or not _is_plain(source):
        return None
    wanted = sorted(set(index))
    schema = {
        f"c{i}": pl.Float64() if i in wanted else pl.String() for i in range(len(source.header))
    }
    try:
        frame = pl.read_csv(
            source.binary,
            has_header=False,
            skip_rows=1,
            separator=source.separator,
            schema=schema,
            columns=wanted,
        )
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError):
        return None
    frame = frame.select([f"c{i}" for i in index])
    blank = frame.select(pl.all_horizontal(pl.all().is_null())).to_series().any()
    if frame.height == 0 or blank:
        return None
    return frame.to_numpy()


def _is_plain(source: Source) -> bool:
    """Whether every line has as many fields as the header, and none is quoted.

    Versions of Polars differ in what they make of the others.
    """
    mark, count = source.separator.encode(), len(source.header) - 1
    with _open_binary(source.data) as file:
        file.readline()
        return all(line.count(mark) == count and b'"' not in line for line in file)


def _read_csv(source: Source, index: Sequence[int], lenient: bool) -> Array:
    """Read CSV row by row: slower, with an opinion on every cell."""
    width = len(source.header)
    values = array("d")
    number = 0
    for line, row in _rows(source):
        if line <= source.skip:
            continue
        number += 1
        where = f"{source.label}, row {number}"
        surplus = any(field.strip() for field in row[width:])
        if surplus and not lenient:
            raise LogError(
                f"{where} has {len(row)} fields under a header of {width}: write decimals "
                "with a point and quote text that holds a comma"
            )
        for i in index:
            text = row[i].strip() if i < len(row) and not surplus else ""
            values.append(
                parse_cell(text, f"{where}, column {source.header[i]!r}", lenient=lenient)
            )
    return np.array(values, dtype=np.float64).reshape(number, len(index))


def _rows(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line that ends a row, and its fields; blank lines are skipped."""
    with _open_binary(source.data) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
        reader = csv.reader(text, delimiter=source.separator)
        try:
            for row in reader:
                if row and (len(row) > 1 or row[0].strip()):
                    yield reader.line_num, row
        except UnicodeDecodeError:
            raise LogError(f"{source.label} is not UTF-8 text: save it as UTF-8 CSV") from None
        except csv.Error as error:
            line = reader.line_num
            raise LogError(f"{source.label}, line {line} is no CSV: {error}") from None


@contextmanager
def _open_binary(data: Path | bytes) -> Iterator[IO[bytes]]:
    with io.BytesIO(data) if isinstance(data, bytes) else data.open("rb") as file:
        yield file


def _standard_input() -> bytes:
    stream = getattr(sys.stdin, "buffer", None)
    return bytes(stream.read()) if stream is not None else sys.stdin.read().encode()


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)


def _listed(names: Sequence[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(repr, names[:most])) + more
