"""Text: tables as spreadsheets, NumPy and calib write them, line by line."""

from __future__ import annotations

import codecs
import csv
import re
from contextlib import suppress
from itertools import dropwhile
from typing import TYPE_CHECKING

from ..errors import LogError

if TYPE_CHECKING:
    import polars as pl

COMMENT = "# calib "
"""Begins the line above the header of a CSV file with what holds for all rows, as JSON."""

NUMBER = r"^\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*$"
"""Matches a number in a cell."""

EXPECTED = (
    "expected the columns' names in the first line, decimals with a point, quotes around text that "
    "holds a comma, and UTF-8"
)
"""Ends what a file is refused with."""

_SEPARATORS = ",;\t"
_HEAD = 1 << 16  # [bytes], of a file, in which its header is


def read_text(content: bytes, label: str) -> tuple[pl.DataFrame, str]:
    """Return the rows of a CSV file, and the line above its header, or raise LogError."""
    import polars as pl

    if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        content = content.decode("utf-16", errors="replace").encode()
    head = content[:_HEAD].decode("utf-8-sig", errors="replace")
    lines = [line for line in head.splitlines() if line.strip()]
    about = ""
    if lines and lines[0].startswith(COMMENT):
        about = lines.pop(0).removeprefix(COMMENT)
    if lines and not re.search(f"^[^#].*[{_SEPARATORS}]", lines[0]):
        content = _from_numpy(content)
        text = content[:_HEAD].decode(errors="replace")
        lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise LogError(
            f"{label} is empty: expected a header with the names of the columns"
        )
    separator = max(_SEPARATORS, key=lines[0].count)
    try:
        table = pl.read_csv(
            content,
            separator=separator,
            comment_prefix=COMMENT,
            infer_schema=False,
        )
    except pl.exceptions.ComputeError:
        _refuse_long_rows(content, separator, label)
        raise
    if separator != ",":
        table = _with_points(table)
    table = table.rename(lambda name: name.strip().replace('""', '"'))
    # blank lines at the end are no rows
    is_filled = table.select(pl.any_horizontal(pl.all().is_not_null()))
    numbers = is_filled.to_series().arg_true()
    return table.head(numbers[-1] + 1 if len(numbers) else 0), about


def _from_numpy(content: bytes) -> bytes:
    """A table as NumPy writes it, blanks between columns and its header behind a ``#``, as CSV.

    Lines of comments before the header are left out.
    """
    lines = content.decode("utf-8-sig", errors="replace").splitlines()
    rows = list(dropwhile(lambda line: line.startswith("#"), lines))
    comments = lines[: len(lines) - len(rows)]
    first_cell = (
        re.split(rf"[{_SEPARATORS}\s]", rows[0].strip())[0] if rows else "0"
    )
    if comments and re.match(NUMBER, first_cell):
        rows.insert(0, comments[-1].lstrip("# "))
    has_blanks = len(rows) > 1 and len(rows[1].split()) > 1
    if has_blanks and not re.search(f"[{_SEPARATORS}]", rows[0]):
        rows = [",".join(row.split()) for row in rows]
    return "\n".join(rows).encode()


def _refuse_long_rows(content: bytes, separator: str, label: str) -> None:
    """Refuse a row of a CSV file that has more values than the header has names."""
    text = content.decode("utf-8-sig", errors="replace")
    lines = (line for line in text.splitlines() if not line.startswith(COMMENT))
    with suppress(csv.Error):  # an open quote
        header, *rows = csv.reader(lines, delimiter=separator)
        for number, row in enumerate(rows, start=1):
            if len(row) > len(header):
                raise LogError(
                    f"{label}, row {number} has {len(row)} values, the header {len(header)} names: "
                    f"{EXPECTED}"
                )


def _with_points(table: pl.DataFrame) -> pl.DataFrame:
    """A table whose decimals have commas, with points; any other unchanged."""
    import polars as pl

    number = r"^\s*[-+]?\d*{}\d+(?:[eE][-+]?\d+)?\s*$"
    has_points = pl.all().str.contains(number.format(r"\.")).any()
    if any(table.select(has_points).row(0)):
        return table
    is_decimal = pl.all().str.contains(number.format(","))
    with_point = pl.all().str.replace(",", ".", literal=True)
    return table.with_columns(
        pl.when(is_decimal).then(with_point).otherwise(pl.all())
    )
