"""Tables: CSV and Parquet files, read and written; the rows of several sensors apart."""

from __future__ import annotations

import io
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Document, Index
from ..common.atomic import atomic_write
from ..common.wording import clipped, printable, quoted, suggestion
from ..errors import LogError
from .column_units import SECONDS, common_unit, find_column, name_and_unit
from .text import COMMENT, EXPECTED, NUMBER, read_text

if TYPE_CHECKING:
    import polars as pl

PARQUET = (".parquet", ".pq")
RECORDINGS = (".bag", ".db3", ".mcap")

KEY = "calib"
"""Name of the entry with that description in a Parquet file's metadata."""

SENSOR = "sensor"
"""Column that names the sensor of a row."""

UNNAMED = "column_"
"""Start of Polars' names of the columns of an array."""

_ROW = "\0row"  # column with the number of each row, counted below the header from 1
_LATEST = 1e11  # [s] after 1970: a clock of the year 5138 counts in ms or less
# LeRobot's suffix of joints' columns, which is removed
_POSITION_SUFFIX = ".pos"
# start of records, columns or lists: a header may begin with a bracket, too
_JSON = rb"\s*(\[\s*[\[{\]]|\{\s*[\"}])"
_PACKED = {b"PK\3\4": "a workbook or an archive", b"\x1f\x8b": "compressed"}
"""Kinds of files that hold a table, by their first bytes."""

# a model file begins with the length of its header, in 8 bytes, and with this entry of it
_MODEL = b'{"__metadata__":{"calib":'


@dataclass(frozen=True, eq=False)
class Source:
    """A table that is ready to be read, as often as wanted."""

    label: str  # what errors call it
    table: pl.DataFrame  # text from CSV; with numbers of the rows
    # what holds for all rows, see `write_table`
    about: Document

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(name for name in self.table.columns if name != _ROW)

    @property
    def unit(self) -> str | None:
        """The unit that the table states for its positions."""
        unit = self.about.get("unit")
        if isinstance(unit, str) and unit:
            return unit
        columns = (find_column(self.header, name) for name in "xyz")
        return common_unit([column for column in columns if column])

    def read(self, names: Sequence[str]) -> pl.DataFrame:
        """Read some columns as they are, text from CSV.

        Raises LogError if a column is missing or there twice.
        """
        for name in names:
            if name not in self.header:
                meant = suggestion(name, self.header)
                raise LogError(
                    f"{self.label} has no column {quoted(name)}: {meant}",
                    hint=f"map another name with `columns={{{clipped(name)!r}: 'OTHER'}}`",
                    parameter="columns",
                    value=name,
                )
            if f"{name}_duplicated_0" in self.header:  # as Polars names it
                raise LogError(
                    f"{self.label} has several columns {quoted(name)}: rename all but one"
                )
        return self.table.select(list(names))

    def texts(self, name: str) -> list[str]:
        """Read a column as text, "" where it is empty."""
        cells = self.read([name])[name].cast(str).fill_null("")
        return cells.str.strip_chars().to_list()

    def of_sensor(self, name: str) -> Source:
        """Return the rows whose column `sensor` has this name."""
        measured = np.array(self.texts(SENSOR)) == name
        return replace(self, table=self.table.filter(measured))

    def seconds(self, name: str) -> Array:
        """Read a column of times (n,) [s]: numbers, or dates as text; NaN where it has neither.

        Numbers are in the unit that the column's name states; without it, those of a clock that
        counts from 1970 show theirs by their size.
        """
        import polars as pl

        cells = self.read([name])[name]
        if cells.dtype == pl.String and not cells.str.contains(NUMBER).any():
            with suppress(pl.exceptions.PolarsError):
                cells = cells.str.strip_chars().str.to_datetime(strict=False)
        if cells.dtype.is_temporal():
            return cells.dt.epoch("us").cast(pl.Float64).to_numpy() * 1e-6
        times = self.numbers([name])[:, 0]
        times *= SECONDS.get(name_and_unit(name)[1], 1.0)
        latest = np.abs(times).max(initial=0.0, where=np.isfinite(times))
        while latest > _LATEST:
            times /= 1e3
            latest /= 1e3
        return times

    @property
    def row_numbers(self) -> Index:
        """Numbers (n,) of the rows, counted below the header from 1."""
        return self.table[_ROW].to_numpy().astype(np.intp)

    def numbers(self, names: Sequence[str]) -> Array:
        """Read some columns as numbers (n, names), NaN where a cell is missing or no number.

        Decimals have a point.
        Raises LogError for a column of another type.
        """
        import polars as pl

        table = self.read(names)
        for name, kind in table.schema.items():
            if not (kind.is_numeric() or kind in (pl.String, pl.Null)):
                raise LogError(
                    f"{self.label}, column {name!r} holds {kind}, expected numbers"
                )
        table = table.with_columns(pl.col(pl.String).str.strip_chars())
        return table.cast(pl.Float64, strict=False).to_numpy().copy()


def open_source(path: str | os.PathLike[str] | Source) -> Source:
    """Read a CSV or Parquet file, JSON, or an array of `numpy.save`.

    `-` reads CSV from standard input.  An open table is returned itself, so that a pipe, which
    can be read only once, serves several readers.
    Raises LogError if there is no such file, or no header in it.
    """
    if isinstance(path, Source):
        return path
    name = os.fspath(path)
    label = "standard input" if name == "-" else printable(name)
    content = _content(Path(name), label)
    if content[8:].startswith(_MODEL):
        raise LogError(
            f"{label} is a model, not a log",
            hint="`log` takes a log (CSV or Parquet), a model is named without an option",
        )
    for first, kind in _PACKED.items():
        if content.startswith(first):
            raise LogError(
                f"{label} is {kind}: expected a table itself, CSV, Parquet or JSON",
                hint="save it as CSV, or unpack it",
            )
    source = parse_source(content, label)
    cells = (name.partition("_duplicated_")[0] for name in source.header)
    if re.fullmatch(r"[-+\d.eE\s\[\]]+", " ".join(cells)):
        raise LogError(
            f"{label} has no header: expected the columns' names in the first line, not numbers"
        )
    return source


def parse_source(content: bytes, label: str) -> Source:
    """The table that the bytes of a file are."""
    table, about = _parse(content, label)
    document = None
    with suppress(ValueError):
        document = json.loads(about)
    if not isinstance(document, dict):
        document = {}
    return Source(label, table.with_row_index(_ROW, 1), document)


def _content(file: Path, label: str) -> bytes:
    """The bytes of a file, or of standard input.  Raises LogError if it is no table."""
    if str(file) == "-":
        return sys.stdin.buffer.read()
    is_recording = file.suffix.lower() in RECORDINGS
    try:
        if file.is_dir() or (file.exists() and is_recording):
            raise LogError(
                f"{label} is no table: expected a CSV or Parquet file",
                hint=f"of a bag, pictures or a video make a log: calib log {label} -o log.csv",
            )
        if file.is_block_device() or file.is_char_device():
            raise OSError("it is a device, expected a CSV or Parquet file")
        return file.read_bytes()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise LogError(f"cannot read {label!r}: {why}") from None


def _parse(content: bytes, label: str) -> tuple[pl.DataFrame, str]:
    """The rows of a file, and its description of itself."""
    import polars as pl

    try:
        if content.startswith(b"PAR1"):
            table = pl.read_parquet(content)
            metadata = pl.read_parquet_metadata(io.BytesIO(content))
            about = metadata.get(KEY, "")
        elif content.startswith(b"\x93NUMPY"):
            table = pl.DataFrame(np.load(io.BytesIO(content)))
            about = ""
        elif re.match(_JSON, content):
            table = _of_records(_documents(content))
            about = ""
        else:
            table, about = read_text(content, label)
        return table.rename(
            lambda name: name.removesuffix(_POSITION_SUFFIX)
        ), about
    except (
        pl.exceptions.PolarsError,
        pl.exceptions.PanicException,
        OSError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        reason = (str(error).strip().splitlines() or ["unreadable"])[0][:100]
        raise LogError(
            f"{label} cannot be read: {reason}: {EXPECTED}"
        ) from None


def _documents(content: bytes) -> Any:
    """What JSON holds, or the list of what its lines hold."""
    try:
        return json.loads(content)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        return [
            json.loads(line) for line in content.split(b"\n") if line.strip()
        ]


def _of_records(document: Any) -> pl.DataFrame:
    """The rows of JSON: records, columns or lists; lists of numbers become columns."""
    import polars as pl

    if (
        document
        and isinstance(document, list)
        and isinstance(document[0], list)
    ):
        return pl.DataFrame(np.array(document, float))
    table = pl.DataFrame(document)
    lists = [name for name, kind in table.schema.items() if kind == pl.List]
    for name in lists:
        numbers = np.array(table[name].to_list(), float)
        table = table.drop(name).hstack(pl.DataFrame(numbers))
    return table


def sources_by_sensor(
    paths: Sequence[str | os.PathLike[str] | Source],
) -> dict[str, Source]:
    """Return a table for each sensor, by its name; rows keep their numbers.

    A sensor is named by the column `sensor`; where there is none, by its file's name, or not at all
    if it is the only one.
    """
    by_name: dict[str, Source] = {}
    for path in paths:
        source = open_source(path)
        label = Path(source.label).stem if len(paths) > 1 else ""
        tables = {label: source}
        names = names_of_sensors(source)
        if names:
            tables = {name: source.of_sensor(name) for name in names}
        for name, table in tables.items():
            numbered = (f"{name}-{number}" for number in count(2))
            while name in by_name:
                name = next(numbered)
            by_name[name] = table
    return by_name


def refuse_unnamed(source: Source) -> None:
    """Raise LogError for a table without names of columns, as an array of NumPy is."""
    if all(name.startswith(UNNAMED) for name in source.header):
        raise LogError(
            f"{source.label} has no names of columns: expected the joints' and x, y",
            hint="write it as CSV with a header",
        )


def names_of_sensors(source: Source) -> tuple[str, ...]:
    """Names in a table's column `sensor`, in their order; none where it has no such column."""
    if SENSOR not in source.header:
        return ()
    return tuple(filter(None, dict.fromkeys(source.texts(SENSOR))))


def write_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, ArrayLike],
    *,
    about: Document | None = None,
) -> None:
    """Write columns of numbers, in full, whole or not at all.

    path : Parquet if it ends in .parquet or .pq, else CSV; `-` writes CSV to standard output
    columns : mapping of str to (n,) array, the columns in their order. NaN is written as `nan`.
    about : what holds for all rows, such as `unit`: a line of comment above the header of a CSV
        file, metadata of a Parquet file. `Source.about` has it when read back.
    """
    import polars as pl

    frame = pl.DataFrame(dict(columns))
    document = json.dumps(about, sort_keys=True) if about else ""
    if Path(path).suffix.lower() in PARQUET:
        # by way of memory: Polars' error of a full disk is no OSError
        content = io.BytesIO()
        frame.write_parquet(
            content, metadata={KEY: document} if document else None
        )
        atomic_write(path, content.getvalue())
        return
    # Polars spells it "NaN" otherwise
    frame = frame.with_columns(pl.col(pl.Float64).fill_nan(None))
    text = frame.write_csv(null_value="nan")
    if document:
        text = f"{COMMENT}{document}\n{text}"
    if os.fspath(path) != "-":
        atomic_write(path, text.encode())
        return
    # a column may have a name that a terminal would obey
    if sys.stdout.isatty():
        text = "\n".join(map(printable, text.split("\n")))
    sys.stdout.write(text)


def rows_in_words(numbers: Index) -> str:
    """Name the first of some numbers of rows."""
    shown = [str(number) for number in numbers[:5]]
    if len(numbers) > 5:
        shown.append("...")
    noun = "row" if len(numbers) == 1 else "rows"
    return f"{noun} {', '.join(shown)}"
