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

_MISSING = ("", "na", "n/a", "nan", "null", "none", "-", "?")


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
    if lenient or text.lower() in _MISSING:
        return float("nan")
    shown = repr(text if len(text) <= 40 else text[:37] + "...")
    remedy = "write decimals with a point" if "," in text else "empty the cell if it is missing"
    raise LogError(f"{where}: {shown} is not a number; {remedy}")


@dataclass(frozen=True)
class NumberColumns:
    """Reads the numbers of some places of a file, some rows at a time."""

    label: str  # what errors call the file
    places: Sequence[Place]
    lenient: bool = False  # whether text that is no number is NaN

    def read(self, frame: pl.DataFrame, first: int, lengths: dict[str, int]) -> Array:
        """Numbers (n, places) of the file's next rows, of which the first has a number.

        NaN where a value, or a whole list, is missing. `lengths` of the columns of lists are kept
        from frame to frame: which element is which could not be told of lists of several.
        """
        import numpy as np

        values = np.empty((frame.height, len(self.places)))
        for k, place in enumerate(self.places):
            column = frame[place.column]
            if place.element is not None:
                column = self._elements(column, place, place.element, first, lengths)
            values[:, k] = self._numbers(column, place, first)
        return values

    def _elements(
        self, column: pl.Series, place: Place, element: int, first: int, lengths: dict[str, int]
    ) -> pl.Series:
        import polars as pl

        where = f"column {place.column!r}"
        if column.dtype == pl.Null:
            return column
        if not isinstance(column.dtype, pl.List):
            raise LogError(
                f"{self.label}, {where} holds {column.dtype}, expected lists, as in Parquet files"
            )
        found = column.list.len()
        there = column.is_not_null().arg_true()
        if len(there):
            length = lengths.setdefault(place.column, found[there[0]])
            for row in there.filter(found[there] != length):
                raise LogError(
                    f"{self.label}, row {first + row}, {where}: a list of {found[row]} after "
                    f"lists of {length}; which element is which cannot be told"
                )
        if element >= lengths.get(place.column, element + 1):
            raise LogError(
                f"{self.label}, {where} holds lists of {lengths[place.column]}, counted from 0: "
                f"there is no {place.name!r}"
            )
        return column.list.get(element, null_on_oob=True)

    def _numbers(self, column: pl.Series, place: Place, first: int) -> Array:
        """Numbers (n,) of a column, text by text where Polars knows none."""
        import polars as pl

        if column.dtype == pl.String:
            cells = column.str.strip_chars()
            numbers = cells.cast(pl.Float64, strict=False)
            values = numbers.fill_null(float("nan")).to_numpy(writable=True)
            for row in (numbers.is_null() & (cells.fill_null("") != "")).arg_true():
                where = f"{self.label}, row {first + row}, column {place.name!r}"
                values[row] = parse_cell(cells[row], where, lenient=self.lenient)
            return values
        if not (column.dtype.is_numeric() or column.dtype == pl.Null):
            lists = place.element is None and isinstance(column.dtype, pl.List)
            remedy = f"; name one element, such as {place.name}[0]" if lists else ""
            raise LogError(
                f"{self.label}, column {place.name!r} holds {column.dtype}, expected numbers"
                f"{remedy}"
            )
        return column.cast(pl.Float64).fill_null(float("nan")).to_numpy()
