"""CSV files: their rows in batches, as text.

How rows are split is decided here: versions of Polars differ in
what they make of short rows, blank lines and stray quotes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import LogError

if TYPE_CHECKING:
    import polars as pl

CSV_BLOCK = 1 << 22
"""Characters of a CSV file that are held at once."""

COMMENT = "# calib "
"""Begins a line above the header that says what holds for all rows."""

_LONGEST_HEADER = 1 << 20  # characters; a file without line ends must not fill the memory
_ROWS = 1 << 16  # rows of a batch of quoted cells


@dataclass(frozen=True)
class CsvFile:
    """A CSV file, of which the header is read."""

    label: str  # what errors call the file
    path: Path
    header: tuple[str, ...]
    separator: str  # between the fields of a row
    skip: int  # lines up to the end of the header, the `comments` above it included
    comments: tuple[str, ...]
    keep: object = None  # whatever has to live as long as the file is needed

    def frames(self, names: Sequence[str], lenient: bool | None = None) -> Iterator[pl.DataFrame]:
        """Yield columns of some rows at a time, as text; blank lines are no rows.

        A row with more fields than the header is refused, where `lenient` its cells are empty; None
        takes them as they are.
        """
        import polars as pl

        width, first = len(self.header), 1
        for rows in self._rows():
            # empty cells beyond the header are no fields
            surplus = rows.list.slice(width).list.join("").str.strip_chars() != ""
            if lenient is False and surplus.any():
                k = surplus.arg_true()[0]
                raise LogError(
                    f"{self.label}, row {first + k} has {len(rows[k])} fields under a header of "
                    f"{width}: write decimals with a point and quote text that holds a comma"
                )
            cells = [rows.list.get(self.header.index(n), null_on_oob=True).alias(n) for n in names]
            frame = pl.DataFrame(cells).with_columns(pl.col(pl.String).fill_null(""))
            yield frame.with_columns(pl.when(~surplus).then(pl.all())) if lenient else frame
            first += len(rows)

    def about(self) -> str:
        """Return what the comments say of all rows, as JSON."""
        return next((comment[len(COMMENT) :] for comment in self.comments), "{}")

    def _rows(self) -> Iterator[pl.Series]:
        """Yield the fields of some rows at a time, as lists of text."""
        import polars as pl

        kind = pl.List(pl.String)
        with self.path.open(encoding="utf-8-sig") as file, _csv_errors(self.label):
            for _ in range(self.skip):
                file.readline()
            while block := file.read(CSV_BLOCK):
                block += (rest := file.readline(CSV_BLOCK))
                if len(rest) == CSV_BLOCK and not rest.endswith("\n"):
                    raise LogError(f"{self.label} has a line of more than {CSV_BLOCK >> 20} MB")
                if '"' in block:
                    # quoted cells may hold line ends: no later block begins a row for sure
                    reader = csv.reader(chain(io.StringIO(block), file), delimiter=self.separator)
                    quoted_rows = filter(_is_row, reader)
                    while some := list(islice(quoted_rows, _ROWS)):
                        yield pl.Series(some, dtype=kind)
                    return
                lines = pl.Series([block]).str.split("\n").explode()
                lines = lines.filter(lines.str.strip_chars(" ") != "")
                if len(lines):
                    yield lines.str.split(self.separator)


def open_csv(label: str, path: Path) -> CsvFile:
    """Find the header of a CSV file, below its comments, and what stands between the fields."""
    with path.open(encoding="utf-8-sig") as file, _csv_errors(label):
        comments = []
        while (start := file.readline(_LONGEST_HEADER)).startswith(COMMENT):
            comments.append(start.strip())
        if len(start) == _LONGEST_HEADER:
            raise LogError(
                f"{label} has no line end in its first megabyte: expected CSV or Parquet"
            )
        separator = max(",;\t", key=start.count)
        reader = csv.reader(chain([start], file), delimiter=separator)
        for row in filter(_is_row, reader):
            header = tuple(name.strip() for name in row)
            skip = len(comments) + reader.line_num
            return CsvFile(label, path, header, separator, skip, tuple(comments))
    raise LogError(f"{label} is empty: expected a header with the names of the columns")


@contextmanager
def _csv_errors(label: str) -> Iterator[None]:
    try:
        yield
    except UnicodeDecodeError:
        raise LogError(f"{label} is not UTF-8 text: save it as UTF-8 CSV") from None
    except csv.Error as error:
        raise LogError(f"{label} is no CSV: {error}") from None


def _is_row(fields: Sequence[str]) -> bool:
    return len(fields) > 1 or any(field.strip() for field in fields)
