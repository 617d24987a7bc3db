"""Lengths as people write them on a print: `24mm`, `2.4cm`, `0.024m`."""

from __future__ import annotations

import math
import re

from ..errors import OptionError

_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}


def parse_length(text: str, what: str = "length") -> float:
    """Return a length above zero in metres.

    Raises
    ------
    OptionError
        If the text has no number, or no unit.

    Examples
    --------
    >>> parse_length("24mm"), parse_length("2.5 cm")
    (0.024, 0.025)
    """
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(mm|cm|m|in)\s*", text)
    try:
        value = float(match[1]) if match else math.nan
    except ValueError:
        value = math.nan
    if match is None or not 0.0 < value < 1e6:
        raise OptionError(f"{what} {text!r}: expected a number and its unit, such as 24mm")
    scale = _METRES[match[2]]
    return value / round(1.0 / scale) if match[2] in ("mm", "cm") else value * scale
