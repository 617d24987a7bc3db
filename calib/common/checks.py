"""Checks of plain data, from a file that may come from anyone or from a caller."""

from __future__ import annotations

import math
from operator import index
from typing import Any

from ..errors import OptionError

LARGEST = 1e15
"""No measure of an arm is so large, and its powers are numbers still."""


def numbers(name: str, values: Any, count: int) -> list[float]:
    """Return a list of so many finite numbers, or raise ValueError; true and false are none."""
    given = values if isinstance(values, list) else []
    good = [v for v in given if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(good) != count or len(given) != count or not all(map(math.isfinite, good)):
        raise ValueError(f"{name}: {values!r:.40} are not {count} finite numbers")
    return [float(value) for value in good]


def whole(name: str, value: object, least: int, most: int) -> int:
    """Return a whole number within bounds, NumPy's too; True and 3.0 are none."""
    try:
        number = index(None if isinstance(value, bool) else value)  # type: ignore[arg-type]
    except TypeError:
        expected = f"expected a whole number such as {least + 1}"
        raise OptionError(f"{name} is {value!r}, {expected}") from None
    if not least <= number <= most:
        raise OptionError(f"{name} is {number}, expected {least} to {most:,}")
    return number
