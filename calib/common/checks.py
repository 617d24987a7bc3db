"""Checks of plain data, from a file that may come from anyone or from a caller."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

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
    good = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (good and least <= value <= most):  # type: ignore[operator]
        raise OptionError(f"{name} is {value!r}, expected a whole number, {least} to {most:,}")
    return int(value)  # type: ignore[call-overload, no-any-return]
