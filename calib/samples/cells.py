"""Cells: one number of a table, as text."""

from __future__ import annotations

from ..errors import LogError

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
