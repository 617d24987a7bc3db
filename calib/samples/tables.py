"""Tables: CSV and Parquet files, which Polars reads lazily, streaming; answers in one."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index
from ..common.atomic import atomic_write
from ..common.wording import clipped, listed, printable, quoted
from ..errors import LogError

if TYPE_CHECKING:
    import polars as pl

PARQUET = (".parquet", ".pq")
RECORDINGS = (".bag", ".db3", ".mcap")

COMMENT = "# calib "
"""Begins the line above the header of a CSV file that says what holds for all rows, as JSON."""

KEY = "calib"
"""Names the entry of a Parquet file's metadata that says the same."""

ROW = "\0row"
"""Column with the number of each row, counted below the header from 1."""

_REMEDIES = {
    "utf-8": ": save it as UTF-8 CSV",
    "more fields": ": write decimals with a point, and quote text that holds a comma",
}

_POSITION_SUFFIX = ".pos"
"""LeRobot ends the names of its joints' columns with it; they are read without."""


@dataclass(frozen=True, eq=False)
class Source:
    """A table that is ready to be read, as often as wanted; a file's rows are not in memory."""

    label: str  # what errors call it
    header: tuple[str, ...]
    rows: pl.LazyFrame  # with their numbers as `ROW`
    about: Mapping[str, Any]  # what the file says of all its rows; see `write_table`
    text: bool = (
        False  # whether it is a CSV file, whose blank lines at the end are no rows
    )

    @property
    def unit(self) -> str | None:
        """The unit that the table states for its positions."""
        unit = self.about.get("unit")
        return unit if isinstance(unit, str) and unit else None

    def drawn(self, most: int, seed: int) -> tuple[Source, int]:
        """The table with at most so many rows, drawn at random, and how many it has."""
        import polars as pl

        with _told(self.label):
            total = int(self.rows.select(pl.len()).collect(engine="streaming").item())
        if total <= most:
            return self, total
        some = 1 + np.sort(
            np.random.default_rng(seed).choice(total, most, replace=False)
        )
        # a join would hold the whole file: of 5 million rows of nine columns 1.0 GB, this .4
        drawn = pl.col(ROW).is_in(pl.Series(some.astype(np.uint32)).implode())
        return replace(self, rows=self.rows.filter(drawn)), total

    def read(self, names: Sequence[str]) -> pl.DataFrame:
        """Read some columns as they are, text from CSV.

        Raises LogError if a column is missing or there twice.
        """
        return self._collected([self._column(name) for name in names]).drop(ROW)

    def numbers(self, names: Sequence[str]) -> tuple[Array, Index]:
        """Read some columns as numbers (n, names), and the numbers of their rows (n,).

        NaN is what is missing, or no number: decimals have a point.
        Raises LogError for a column of another type.
        """
        import polars as pl

        columns = {name: self._column(name) for name in names}
        for name, kind in self.rows.select(**columns).collect_schema().items():
            if isinstance(kind, pl.String):
                columns[name] = columns[name].str.strip_chars()
            elif not (kind.is_numeric() or isinstance(kind, pl.Null)):
                raise LogError(
                    f"{self.label}, column {name!r} holds {kind}, expected numbers"
                )
        # not as text: Polars would hold the whole file for some cells of it
        cast = (
            cell.cast(pl.Float64, strict=False).alias(n) for n, cell in columns.items()
        )
        table = self._collected([cell.fill_null(float("nan")) for cell in cast])
        values = (
            table.select(names)
            .to_numpy(order="c")
            .astype(np.float64)
            .reshape(-1, len(names))
        )
        return values, table[ROW].to_numpy().astype(np.intp)

    def _collected(self, columns: Sequence[pl.Expr]) -> pl.DataFrame:
        """Some columns and `ROW`, without blank lines at the end of a CSV file."""
        import polars as pl

        blank = (
            pl.all_horizontal(pl.exclude(ROW).is_null())
            if self.text
            else pl.lit(value=False)
        )
        with _told(self.label):
            rows = self.rows.select(ROW, *columns, blank.alias("\0blank"))
            found = rows.collect(engine="streaming").sort(ROW)
        there = (~found["\0blank"]).arg_true()
        return found.drop("\0blank").head(there[-1] + 1 if len(there) else 0)

    def _column(self, name: str) -> pl.Expr:
        import polars as pl

        if name not in self.header:
            near = get_close_matches(name, self.header, n=1)
            meant = f"did you mean {quoted(near[0])}? " if near else ""
            raise LogError(
                f"{self.label} has no column {quoted(name)}: {meant}columns: "
                f"{listed(map(repr, self.header))}",
                hint=f"map another name with `columns={{{clipped(name)!r}: 'OTHER'}}`",
                parameter="columns",
                value=name,
            )
        if f"{name}_duplicated_0" in self.header:  # as Polars names it
            raise LogError(
                f"{self.label} has several columns {quoted(name)}: rename all but one"
            )
        return pl.col(name)


def open_source(path: str | os.PathLike[str] | Source) -> Source:
    """Find the header of a CSV or Parquet file.

    `-` reads CSV from standard input.  A table that is open stays as it is, so that a pipe, which
    can be read only once, serves several readers.
    Raises LogError if there is no such file, or no header in it.
    """
    import polars as pl

    if isinstance(path, Source):
        return path
    name = os.fspath(path)
    label = "standard input" if name == "-" else printable(name)
    file = Path(name)
    try:
        if file.is_dir() or (file.exists() and file.suffix.lower() in RECORDINGS):
            hint = f"of a bag, pictures or a video make a log: calib log {label} -o log.csv"
            raise LogError(
                f"{label} is no table: expected a CSV or Parquet file", hint=hint
            )
        content = _content(file)
        with (
            file.open("rb")
            if isinstance(content, Path)
            else io.BytesIO(content) as opened
        ):
            head = opened.read(1 << 16)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise LogError(f"cannot read {label!r}: {why}") from None
    text = not head.startswith(b"PAR1")
    about = ""
    lines = head.decode("utf-8-sig", errors="replace").splitlines() if text else [KEY]
    lines = [line for line in lines if line.strip()]
    if lines and lines[0].startswith(COMMENT):
        about = lines.pop(0).removeprefix(COMMENT)
    if not lines:
        raise LogError(
            f"{label} is empty: expected a header with the names of the columns"
        )
    with _told(label):
        if text:
            rows = pl.scan_csv(
                content,
                separator=max(",;\t", key=lines[0].count),
                comment_prefix=COMMENT,
                infer_schema=False,
                glob=False,
                with_column_names=lambda names: [
                    n.strip().replace('""', '"') for n in names
                ],
            )
        else:
            rows = pl.scan_parquet(content, glob=False)
            about = pl.read_parquet_metadata(content).get(KEY, "")
        suffixed = [
            name for name in rows.collect_schema() if name.endswith(_POSITION_SUFFIX)
        ]
        rows = rows.rename(
            {name: name.removesuffix(_POSITION_SUFFIX) for name in suffixed}
        )
        header = tuple(rows.collect_schema())
    try:
        said = json.loads(about or "{}")
    except ValueError:
        said = {}
    said = said if isinstance(said, dict) else {}
    return Source(label, header, rows.with_row_index(ROW, 1), said, text)


def _content(file: Path) -> Path | bytes:
    """A file's path, or what a stream holds, which can be read only once."""
    if str(file) == "-":
        stream = getattr(sys.stdin, "buffer", sys.stdin)
        read = stream.read() if stream else b""
        return read.encode() if isinstance(read, str) else bytes(read)
    if file.is_block_device() or file.is_char_device():
        raise OSError("it is a device, expected a CSV or Parquet file")
    return file.read_bytes() if file.is_fifo() else file


@contextmanager
def _told(label: str) -> Iterator[None]:
    """Tell in one line that Polars cannot read a file."""
    import polars as pl

    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        reason = (str(error).strip().splitlines() or ["unreadable"])[0][:100]
        remedy = "".join(told for part, told in _REMEDIES.items() if part in reason)
        raise LogError(f"{label} cannot be read: {reason}{remedy}") from None


@dataclass(frozen=True, eq=False)
class Batch:
    """A table of queries, with the columns that go along unread."""

    # (n, k), the columns asked for as `names`; NaN throughout a row that has no number for each
    values: Array
    names: tuple[str, ...]
    invalid: tuple[
        int, ...
    ]  # numbers of the rows that are NaN; 1 is the first below the header
    table: pl.DataFrame  # all columns in their order, those asked for by their `names`

    def answered(self, added: Mapping[str, ArrayLike]) -> dict[str, Any]:
        """Return the table's columns in their places, answers in place or behind them."""
        old = [
            name
            for name in added
            if name in self.table.columns and name not in self.names
        ]
        mine = dict(zip(self.names, self.values.T, strict=True))
        return {**self.table.drop(old).to_dict(), **mine, **added}

    def take(self, rows: Index) -> Batch:
        """The table with some of its rows, which may be there more than once."""
        return replace(self, values=self.values[rows], table=self.table[rows])

    def notes(self, added: Sequence[str]) -> list[str]:
        """Say how many columns go along."""
        kept = [
            name for name in self.table.columns if name not in (*self.names, *added)
        ]
        words = f"other column{'s' * (len(kept) > 1)} copied to the output unchanged"
        return [f"{len(kept)} {words}: {listed(kept)}"] if kept else []


def read_batch(
    path: str | os.PathLike[str],
    names: Sequence[str],
    more: Sequence[Sequence[str]] = (),
    columns: Mapping[str, str] | None = None,
) -> Batch:
    """Read a batch of queries and all that stands beside them; bad rows do not stop it.

    more : groups of names of which those count that the table has as a whole
    columns : columns that have other names, by what they hold; the batch has the latter
    """
    import polars as pl

    source = open_source(path)
    called = dict(columns or {})
    there = [
        g for g in more if {called.get(name, name) for name in g} <= {*source.header}
    ]
    names = (*names, *(name for group in there for name in group))
    held = {called.get(name, name): name for name in names}
    rest = [name for name in source.header if name in held or name not in names]
    values, rows = source.numbers(list(held))
    invalid = ~np.isfinite(values).all(axis=1)
    values[invalid] = np.nan
    table = source.read(rest).rename(held).with_columns(pl.col(pl.String).fill_null(""))
    return Batch(values, names, tuple(rows[invalid].tolist()), table)


def write_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, ArrayLike],
    *,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write columns of numbers, in full, whole or not at all.

    path : Parquet if it ends in .parquet or .pq, else CSV; `-` writes CSV to standard output
    columns : mapping of str to (n,) array, the columns in their order. NaN is written as `nan`.
    about : what holds for all rows, such as `unit`: a line of comment above the header of a CSV
        file, metadata of a Parquet file. `Source.about` has it when read back.
    """
    import polars as pl

    series = {
        k: v if isinstance(v, pl.Series) else np.asarray(v) for k, v in columns.items()
    }
    frame = pl.DataFrame(series)
    told = json.dumps(about, sort_keys=True) if about else ""
    if Path(path).suffix.lower() in PARQUET:
        # by way of memory: what Polars says of a full disk is no OSError
        content = io.BytesIO()
        frame.write_parquet(content, metadata={KEY: told} if told else None)
        atomic_write(path, content.getvalue())
        return
    # Polars spells it "NaN" otherwise
    text = frame.with_columns(pl.col(pl.Float64).fill_nan(None)).write_csv(
        null_value="nan"
    )
    text = f"{COMMENT}{told}\n{text}" if told else text
    if os.fspath(path) == "-":
        if sys.stdout.isatty():  # a column may have a name that a terminal would obey
            text = "\n".join(map(printable, text.split("\n")))
        sys.stdout.write(text)
    else:
        atomic_write(path, text.encode())
