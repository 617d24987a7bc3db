"""CSV files: batches of numbers, fast where every line is plain, careful where it is not."""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import LogError
from .places import Place, parse_cell

if TYPE_CHECKING:
    import polars as pl

BLOCK = 1 << 23
"""Bytes of a CSV file that are held at once."""

COMMENT = b"# calib "
"""Begins a line above the header that says what holds for all rows."""

_LONGEST_HEADER = 1 << 20  # [bytes]; a file without line ends must not fill the memory
_ROWS = 1 << 16  # rows of a batch that is read cell by cell


@dataclass(frozen=True)
class CsvFile:
    """A CSV file, of which the header is read."""

    label: str  # what errors call the file
    path: Path
    header: tuple[str, ...]
    separator: str  # between the fields of a row
    skip: int  # lines up to the end of the header, the `comments` above it included
    comments: tuple[str, ...]

    def batches(self, places: Sequence[Place], *, lenient: bool) -> Iterator[Array]:
        """Yield (n, len(places)) arrays, NaN where a value is missing; blank lines are no rows."""
        for place in places:
            if place.element is not None:
                raise LogError(
                    f"{self.label} is CSV, which has no lists: there is a column "
                    f"{quoted(place.column)} but none {quoted(place.name)}; lists are read from "
                    "Parquet"
                )
        return self._batches([self.header.index(place.column) for place in places], lenient)

    def texts(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Read columns as they are, as text."""
        import polars as pl

        index = [self.header.index(name) for name in names]
        texts: list[list[str]] = [[] for _ in names]
        with self.path.open("rb") as file:
            for line, row in csv_rows(self.label, file, self.separator):
                if line > self.skip:
                    for cells, i in zip(texts, index, strict=True):
                        cells.append(row[i] if i < len(row) else "")
        return {n: pl.Series(n, cells, pl.String) for n, cells in zip(names, texts, strict=True)}

    def about(self) -> str:
        """Return what the comments say of all rows, as JSON."""
        mark = COMMENT.decode()
        return next((c[len(mark) :] for c in self.comments if c.startswith(mark)), "{}")

    def _batches(self, index: Sequence[int], lenient: bool) -> Iterator[Array]:
        with self.path.open("rb") as file:
            start = [file.readline() for _ in range(self.skip)]
            comments = all(line.startswith(COMMENT) for line in start[:-1])
            # a header of several lines, or one that only a carriage return ends
            if not comments or b"\r" in start[-1].rstrip(b"\r\n"):
                file.seek(0)
                yield from self._by_cell(file, index, lenient, 0, 0, self.skip)
                return
            rows, lines = 0, self.skip
            while block := _next_block(self.label, file):
                values = _read_plain(block, len(self.header), self.separator, index)
                found = iter(() if values is None else (values,))
                quoted_cells = b'"' in block
                if quoted_cells:  # they may hold line ends: no later block begins a row for sure
                    file.seek(-len(block), io.SEEK_CUR)
                    found = self._by_cell(file, index, lenient, rows, lines)
                elif values is None:
                    found = self._by_cell(io.BytesIO(block), index, lenient, rows, lines)
                for values in found:
                    yield values
                    rows += len(values)
                lines += block.count(b"\n")

    def _by_cell(
        self,
        file: IO[bytes],
        index: Sequence[int],
        lenient: bool,
        number: int,
        lines: int,
        skip: int = 0,
    ) -> Iterator[Array]:
        """Read the rest of a file row by row: slower, with an opinion on every cell.

        number, lines : rows and lines that were read before
        skip : lines up to the end of the header, where it is part of the rest
        """
        width, values = len(self.header), array("d")
        for line, row in csv_rows(self.label, file, self.separator, lines):
            if line <= skip:
                continue
            number += 1
            where = f"{self.label}, row {number}"
            surplus = any(field.strip() for field in row[width:])
            if surplus and not lenient:
                raise LogError(
                    f"{where} has {len(row)} fields under a header of {width}: write decimals "
                    "with a point and quote text that holds a comma"
                )
            for i in index:
                cell = row[i].strip() if i < len(row) and not surplus else ""
                place = f"{where}, column {self.header[i]!r}"
                values.append(parse_cell(cell, place, lenient=lenient))
            if len(values) == _ROWS * len(index):
                yield np.array(values).reshape(-1, len(index))
                values = array("d")
        if values:
            yield np.array(values).reshape(-1, len(index))


def open_csv(label: str, path: Path) -> CsvFile:
    """Find the header of a CSV file, below its comments, and what stands between the fields."""
    with path.open("rb") as file:
        start, comments = file.readline(_LONGEST_HEADER), []
        while start.startswith(COMMENT):
            comments.append(start.decode("utf-8", "replace").strip())
            start = file.readline(_LONGEST_HEADER)
        if len(start) == _LONGEST_HEADER:
            raise LogError(
                f"{label} has no line end in its first megabyte: expected CSV or Parquet"
            )
        separator = max(",;\t", key=lambda mark: start.count(mark.encode()))
        file.seek(0)
        for _ in comments:
            file.readline()
        for line, row in csv_rows(label, file, separator, len(comments)):
            header = tuple(name.strip() for name in row)
            return CsvFile(label, path, header, separator, line, tuple(comments))
    raise LogError(f"{label} is empty: expected a header with the names of the columns")


def csv_rows(
    label: str, file: IO[bytes], separator: str, lines: int = 0
) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line that ends a row, and its fields; blank lines are skipped."""
    text = io.TextIOWrapper(file, encoding="utf-8" if lines else "utf-8-sig", newline="")
    reader = csv.reader(text, delimiter=separator)
    try:
        for row in reader:
            if row and (len(row) > 1 or row[0].strip()):
                yield lines + reader.line_num, row
    except UnicodeDecodeError:
        raise LogError(f"{label} is not UTF-8 text: save it as UTF-8 CSV") from None
    except csv.Error as error:
        raise LogError(f"{label}, line {lines + reader.line_num} is no CSV: {error}") from None
    finally:
        text.detach()  # the file is its owner's to close


def _next_block(label: str, file: IO[bytes]) -> bytes:
    """Return the next whole lines."""
    block = file.read(BLOCK)
    if block and not block.endswith(b"\n"):
        rest = file.readline(BLOCK)
        if len(rest) == BLOCK and not rest.endswith(b"\n"):
            raise LogError(f"{label} has a line of more than {BLOCK >> 20} MB: expected CSV")
        block += rest
    return block


def _read_plain(block: bytes, width: int, separator: str, index: Sequence[int]) -> Array | None:
    """Read clean lines in Polars; None sends every doubtful block to the careful reader."""
    import polars as pl

    if not _is_plain(block, width, separator):
        return None
    wanted = sorted(set(index))
    schema = {f"c{i}": pl.Float64() if i in wanted else pl.String() for i in range(width)}
    try:
        frame = pl.read_csv(
            io.BytesIO(block), has_header=False, separator=separator, schema=schema, columns=wanted
        )
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError):
        return None
    frame = frame.select([f"c{i}" for i in index])
    blank = frame.select(pl.all_horizontal(pl.all().is_null())).to_series().any()
    if frame.height == 0 or blank:
        return None
    return frame.to_numpy()


def _is_plain(block: bytes, width: int, separator: str) -> bool:
    """Whether every line has as many fields as the header, and none is quoted.

    Versions of Polars differ in what they make of the others.
    """
    if b'"' in block:
        return False
    text = np.frombuffer(block, dtype=np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    if not block.endswith(b"\n"):
        ends = np.append(ends, len(text))
    marks = np.flatnonzero(text == ord(separator))
    before = np.searchsorted(marks, ends)
    return bool((before == (width - 1) * np.arange(1, len(ends) + 1)).all())
