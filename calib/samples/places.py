"""Places and cells: a column of a log or an element of its lists, and the numbers that it holds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..common.arrays import Array
from ..common.wording import quoted
from ..errors import LogError, OptionError

if TYPE_CHECKING:
    import polars as pl

_ELEMENT = re.compile(r"(.+)\[(.*)\]", re.DOTALL)
_INDEX = re.compile(r"0|[1-9][0-9]{0,8}")


@dataclass(frozen=True)
class Place:
    """Where the numbers of one name stand."""

    name: str  # as asked for: `time`, or `observation.state[0]`
    column: str  # a column of the file
    # which element of the column's lists, counted from 0; None for a column of numbers
    element: int | None = None


def find_place(header: Sequence[str], name: str) -> Place | None:
    """Find a name in a header; one that is there as written is a column, whatever it looks like.

    Raises OptionError if what stands in the brackets is no place in a list.

    Examples
    --------
    >>> find_place(["state"], "state[2]")
    Place(name='state[2]', column='state', element=2)
    >>> find_place(["state", "state[2]"], "state[2]")
    Place(name='state[2]', column='state[2]', element=None)
    >>> find_place(["state"], "speed") is None
    True
    """
    if name in header:
        return Place(name, name)
    match = _ELEMENT.fullmatch(name)
    if match is None or match[1] not in header:
        return None
    if not _INDEX.fullmatch(match[2]):
        raise OptionError(
            f"{quoted(name)}: {quoted(match[2])} is no place in a list, expected a whole number "
            "counted from 0"
        )
    return Place(name, match[1], int(match[2]))


MISSING = ("", "na", "n/a", "nan", "null", "none", "-", "?")


def parse_cell(text: str, where: str, *, lenient: bool = False) -> float:
    """Read one number, NaN for an empty cell and for the usual words for a missing value.

    `text` has no blanks around it; errors call it `where`; where `lenient` other text is NaN too.

    Examples
    --------
    >>> parse_cell("1.5", "row 1"), parse_cell("NA", "row 1")
    (1.5, nan)
    """
    try:
        if text.isascii() and "_" not in text:  # float() also takes 1_0 and other digits
            return float(text)
    except ValueError:
        pass
    if lenient or text.lower() in MISSING:
        return float("nan")
    shown = repr(text if len(text) <= 40 else text[:37] + "...")
    remedy = "write decimals with a point" if "," in text else "empty the cell if it is missing"
    raise LogError(f"{where}: {shown} is not a number; {remedy}")


def numbers_of(
    cells: pl.Series, label: str, name: str, first: int, *, lenient: bool = False
) -> Array:
    """Read a column of texts as numbers (n,), cell by cell where Polars knows none.

    Errors say `label`, the column's `name` and a row, of which the `first` is the number of the
    first cell; see `parse_cell`.
    """
    import polars as pl

    cells = cells.str.strip_chars()
    numbers = cells.cast(pl.Float64, strict=False)
    values = numbers.fill_null(float("nan")).to_numpy(writable=True)
    for row in (numbers.is_null() & (cells.fill_null("") != "")).arg_true():
        where = f"{label}, row {first + row}, column {name!r}"
        values[row] = parse_cell(cells[row], where, lenient=lenient)
    return values
