"""Checks of plain data, from a file that may come from anyone or from a caller."""

from __future__ import annotations

import math
from operator import index
from typing import Any, TypeVar

from ..errors import OptionError

_T = TypeVar("_T")

LARGEST = 1e15
"""No measure of an arm is so large, and its powers are numbers still."""


def of_type(name: str, value: Any, kind: type[_T]) -> _T:
    """Return a value that is of a type; true and false are no numbers.

    Raises ValueError if it is not.
    """
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{name}: {value!r:.40} is no {kind.__name__}")
    return value


def finite(name: str, value: Any) -> float:
    """Return a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name}: {value!r:.40} is no finite number")
    return float(value)


def numbers(name: str, values: Any, count: int) -> list[float]:
    """Return a list of so many finite numbers."""
    found = [finite(name, value) for value in of_type(name, values, list)]
    if len(found) != count:
        raise ValueError(f"{name}: {len(found)} numbers, expected {count}")
    return found


def texts(name: str, values: Any) -> list[str]:
    """Return a list of texts."""
    return [of_type(name, value, str) for value in of_type(name, values, list)]


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
