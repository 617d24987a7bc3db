"""Columns of numbers in CSV and Parquet files, which Polars reads lazily, streaming."""

from __future__ import annotations

import csv
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import clipped, listed, printable, quoted
from ..errors import LogError

if TYPE_CHECKING:
    import polars as pl

PARQUET = (".parquet", ".pq")
RECORDINGS = (".bag", ".db3", ".mcap")

COMMENT = "# calib "
"""Begins a line above the header of a CSV file that says what holds for all rows, as JSON."""

KEY = "calib"
"""Names the entry of a Parquet file's metadata that says the same."""

_LONGEST_LINE = 1 << 20  # characters; a file without line ends must not fill the memory
_MISSING = ("", "na", "n/a", "nan", "null", "none", "-", "?")


@dataclass(frozen=True, eq=False)
class Source:
    """A table that is ready to be read, as often as wanted; nothing but its header is in memory."""

    label: str  # what errors call it
    header: tuple[str, ...]
    rows: pl.LazyFrame  # its columns are named by their place in the header: "0", "1", ...
    about: str = "{}"  # what the file says of all its rows, as JSON
    keep: object = None  # whatever has to live as long as the rows are needed
    text: bool = False  # whether it is a CSV file

    def __contains__(self, name: str) -> bool:
        """Whether there is a column, or an element of a column's lists, of this name."""
        return _find(self.header, name) is not None


class Rows(NamedTuple):
    """Rows of a table."""

    values: Array  # (n, names), NaN where a value is missing
    numbers: NDArray[np.intp]  # (n,), counted below the header from 1
    total: int  # rows of the table


def open_source(path: str | os.PathLike[str] | Source) -> Source:
    """Find the header of a CSV or Parquet file; no row is read yet.

    `-` reads CSV from standard input.  A table that is open stays as it is, so that a pipe, which
    can be read only once, serves several readers.

    Raises LogError if there is no such file, or no header in it.
    """
    if isinstance(path, Source):
        return path
    name, keep = os.fspath(path), None
    label, file = "standard input" if name == "-" else printable(name), Path(name)
    recorded = f"make a log of it: calib log {label} -o log.csv"
    try:
        if file.is_dir():
            bag = any(each.suffix.lower() in RECORDINGS for each in file.iterdir())
            raise LogError(
                f"{label} is a folder, expected a CSV or Parquet file",
                hint=recorded if bag else None,
            )
        # what is no regular file (a pipe, /dev/stdin) can be read only once
        if name == "-" or (file.exists() and not file.is_file()):
            file, keep = _spooled(file)
        with file.open("rb") as opened:
            parquet = opened.read(4) == b"PAR1"
    except FileNotFoundError:
        raise LogError(f"there is no file {label!r}") from None
    except (OSError, ValueError) as error:
        raise LogError(f"cannot read {label!r}: {error}") from None
    if not parquet and file.suffix.lower() in RECORDINGS:
        raise LogError(
            f"{label} is a recording of messages, expected a CSV or Parquet file", hint=recorded
        )
    if not parquet and file.suffix.lower() in PARQUET:
        raise LogError(f"{label} is not a Parquet file; rename it to .csv if it is CSV")
    return (_open_parquet if parquet else _open_csv)(label, file, keep)


def read_rows(
    source: Source,
    names: Sequence[str],
    *,
    lenient: bool = False,
    most: int | None = None,
    seed: int = 0,
) -> Rows:
    """Read some columns as numbers; of more than `most` rows so many, drawn at random.

    Of a Parquet file's lists a name is one element, as in `state[0]`. NaN is a missing value, where
    `lenient` also text in a number's place. Blank lines at the end are no rows.

    Raises LogError if a column is missing or there twice, or a value is no number.
    """
    import polars as pl

    with _errors(source.label):
        schema = source.rows.collect_schema()
    cells = [_cells(source, name, schema) for name in names]
    with _errors(source.label):
        count = source.rows.select(pl.len())
        total = int(count.collect(engine="streaming").item()) if most else 0
    rows = source.rows.with_row_index("row")
    drawn = most is not None and total > most
    if drawn:
        some = np.sort(np.random.default_rng(seed).choice(total, most, replace=False))
        # a join would hold the whole file: of 5 million rows of nine columns 1.0 GB, this .4
        rows = rows.filter(pl.col("row").is_in(pl.Series(some.astype(np.uint32)).implode()))
    numbers = [values.cast(pl.Float64, strict=False) for values, _ in cells]
    asked = [column.alias(f"value {k}") for k, column in enumerate(numbers)]
    asked += [  # text in a number's place
        (
            numbers[k].is_null() & ~(values.is_null() | values.str.to_lowercase().is_in(_MISSING))
        ).alias(f"bad {k}")
        for k, (values, text) in enumerate(cells)
        if text and not lenient
    ]
    frame = _collected(source, rows, ["row", *asked]).sort("row")
    for name in frame.columns:
        if name.startswith("bad ") and frame[name].any():
            k, row = int(name[4:]), int(frame["row"][int(frame[name].arg_true()[0])])
            text = str(source.rows.select(cells[k][0]).slice(row, 1).collect().item())
            shown = repr(text if len(text) <= 40 else text[:37] + "...")
            remedy = "write decimals with a point"
            remedy = remedy if "," in text else "empty the cell if it is missing"
            raise LogError(
                f"{source.label}, row {row + 1}, column {names[k]!r}: {shown} is not a number; "
                f"{remedy}"
            )
    values = np.empty((frame.height, len(names)))
    for k in range(len(names)):
        values[:, k] = frame[f"value {k}"].fill_null(float("nan")).to_numpy()
    return Rows(
        values, frame["row"].to_numpy().astype(np.intp) + 1, total if drawn else frame.height
    )


def read_columns(source: Source, names: Sequence[str], *, lenient: bool = False) -> Array:
    """Read some columns as numbers (n, names), all rows; see `read_rows`."""
    return read_rows(source, names, lenient=lenient).values


def read_texts(source: Source, names: Sequence[str]) -> pl.DataFrame:
    """Read some columns as they are: text from CSV, whatever type from Parquet."""
    import polars as pl

    columns = [pl.col(str(source.header.index(name))).alias(name) for name in names]
    frame = _collected(source, source.rows, columns)
    return frame.with_columns(pl.col(pl.String).fill_null(""))


def _collected(
    source: Source, rows: pl.LazyFrame, columns: Sequence[str | pl.Expr]
) -> pl.DataFrame:
    """Columns of some rows of a table, without blank lines at the end of a CSV file."""
    import polars as pl

    blank = pl.all_horizontal(pl.exclude("row").is_null()) if source.text else pl.lit(value=False)
    nothing = blank.alias("nothing")
    with _errors(source.label):
        frame = rows.select(*columns, nothing).collect(engine="streaming")
    something = (~frame["nothing"]).arg_true()
    return frame.drop("nothing").head(something[-1] + 1 if len(something) else 0)


def _find(header: Sequence[str], name: str) -> tuple[str, int | None] | None:
    """The column of a name, and which element of its lists; a column goes first."""
    if name in header:
        return name, None
    match = re.fullmatch(r"(.+)\[(0|[1-9][0-9]{0,8})\]", name, re.DOTALL)
    return (match[1], int(match[2])) if match and match[1] in header else None


def _cells(source: Source, name: str, schema: pl.Schema) -> tuple[pl.Expr, bool]:
    """The values of a name, numbers or text that is to become numbers; whether they are text."""
    import polars as pl

    found = _find(source.header, name)
    if found is None:
        near = get_close_matches(name, source.header, n=1)
        meant = f"did you mean {quoted(near[0])}? " if near else ""
        raise LogError(
            f"{source.label} has no column {quoted(name)}: {meant}columns: "
            f"{listed(map(repr, source.header))}",
            hint=f"map another name with `columns={{{clipped(name)!r}: 'OTHER'}}`",
            parameter="columns",
            value=name,
        )
    column, element = found
    if (count := source.header.count(column)) > 1:
        raise LogError(f"{source.label} has {count} columns {quoted(column)}: rename all but one")
    key = str(source.header.index(column))
    values, dtype = pl.col(key), schema[key]
    if element is not None and isinstance(dtype, (pl.List, pl.Array)):
        plain = values.arr.to_list() if isinstance(dtype, pl.Array) else values
        # a list that lacks the element misses a value
        values, dtype = plain.list.get(element, null_on_oob=True), dtype.inner  # type: ignore[assignment]
        element = None
    if dtype == pl.Null:
        element = None
    if element is not None or not (dtype.is_numeric() or isinstance(dtype, (pl.String, pl.Null))):
        kind = "numbers" if element is None else "lists, as in Parquet files"
        remedy = f"; name one element, such as {name}[0]" if isinstance(dtype, pl.List) else ""
        raise LogError(f"{source.label}, column {name!r} holds {dtype}, expected {kind}{remedy}")
    text = isinstance(dtype, pl.String)
    return values.str.strip_chars() if text else values, text


def _open_csv(label: str, path: Path, keep: object) -> Source:
    """Find the header of a CSV file, below its comments, and what stands between the fields."""
    import polars as pl

    skip, about = 0, "{}"
    with path.open(encoding="utf-8-sig", newline="\n") as file, _errors(label):
        while (line := file.readline(_LONGEST_LINE)).startswith(COMMENT) or line.isspace():
            about = line.removeprefix(COMMENT) if line.startswith(COMMENT) else about
            skip += 1
        if len(line) == _LONGEST_LINE:
            raise LogError(
                f"{label} has no line end in its first megabyte: expected CSV or Parquet"
            )
        separator = max(",;\t", key=line.count)
        header = next(csv.reader(chain([line], file), delimiter=separator), [])
    if not header:
        raise LogError(f"{label} is empty: expected a header with the names of the columns")
    rows = pl.scan_csv(
        path,
        separator=separator,
        skip_lines=skip,
        infer_schema=False,
        glob=False,
        with_column_names=lambda names: [str(k) for k in range(len(names))],
    )
    return Source(label, tuple(name.strip() for name in header), rows, about, keep, text=True)


def _open_parquet(label: str, path: Path, keep: object) -> Source:
    """Find the columns of a Parquet file, and what its metadata say of all rows."""
    import polars as pl

    with _errors(label):
        rows = pl.scan_parquet(path, glob=False)
        header = tuple(rows.collect_schema())
        about = str(pl.read_parquet_metadata(path).get(KEY, "{}"))
    named = rows.rename({name: str(k) for k, name in enumerate(header)})
    return Source(label, header, named, about, keep)


@contextmanager
def _errors(label: str) -> Iterator[None]:
    """Tell in one line that a file cannot be read."""
    import polars as pl

    try:
        yield
    except UnicodeDecodeError:
        reason = "it is not UTF-8 text: save it as UTF-8 CSV"
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, csv.Error, OSError) as error:
        reason = (str(error).strip().splitlines() or ["unreadable"])[0][:100]
        if "utf-8" in reason:
            reason = "it is not UTF-8 text: save it as UTF-8 CSV"
        if "more fields" in reason:
            reason = (
                "a row has more fields than the header: write decimals with a point, and quote "
                "text that holds a comma"
            )
    else:
        return
    raise LogError(f"{label} cannot be read: {reason}")


def _spooled(path: Path) -> tuple[Path, object]:
    """Copy a stream, or standard input for `-`, to a file that can be read again and may be long.

    The file is gone with the last reference to the second value.
    """
    mode = None if str(path) == "-" else path.stat().st_mode
    if mode is not None and (stat.S_ISBLK(mode) or stat.S_ISCHR(mode)):
        raise LogError(f"{path} is a device, expected a CSV or Parquet file")
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    copy = Path(folder.name) / f"stream{path.suffix}"
    with copy.open("wb") as file:
        if mode is not None:
            with path.open("rb") as stream:
                shutil.copyfileobj(stream, file)
        elif (binary := getattr(sys.stdin, "buffer", None)) is not None:
            shutil.copyfileobj(binary, file)
        else:  # a test's or a notebook's, of text alone
            file.write(sys.stdin.read().encode())
    return copy, folder
