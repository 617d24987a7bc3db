"""Units: what people read of metres and radians."""

from __future__ import annotations

import math


def for_people(unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that tables and figures show, and its name.

    Metres become mm and radians degrees; the sensor's own unit stays.
    """
    named = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg")}
    return named.get(unit, (1.0, unit))
