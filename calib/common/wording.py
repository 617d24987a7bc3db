"""Wording: names, choices and units as people read them, messages of one short line, pages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import Decimal
from difflib import get_close_matches

INSTALL = "pip install 'calib-arm[{0}]', or in a checkout pip install '.[{0}]'"
"""How an extra is installed."""

ROUNDED_AWAY = 1e-9
"""Errors below this [m], or below this share of a sensor's extent, are rounding."""

_PLACE = re.compile(
    r"@([a-z]+(?:\.[a-z]+)?)@"
)  # in a page that is a file of a package
_PREFIXES = ((1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm"))


def two_digits(value: float) -> str:
    """Return a number with two significant digits, never with an exponent.

    >>> two_digits(217.0), two_digits(0.0000573)
    ('220', '0.000057')
    """
    return f"{Decimal(f'{value:.2g}'):f}"


def printable(text: str) -> str:
    """Return a text whose line breaks, control characters and the like are written out."""
    if text.isprintable():  # most texts: one C loop
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def one_line(text: str, most: int = 1_500) -> str:
    """Return a message as one printable line, its middle left out where that is long."""
    line = printable(text)
    if len(line) <= most:
        return line
    return f"{line[: most // 2]} ... {line[-most // 3 :]}"


def clipped(name: str, most: int = 60) -> str:
    """Return a name that may be long, short enough for a line with several of them."""
    return name if len(name) <= most else name[: most - 3] + "..."


def quoted(name: str) -> str:
    """Return a name from a file or a user, safe to print in one line."""
    return repr(clipped(name))


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names in one line, long ones cut, and cut after `most` of them."""
    items = list(names)
    more = f", ... ({len(items)} in all)" if len(items) > most else ""
    return (", ".join(map(clipped, items[:most])) or "(none)") + more


def suggestion(name: str, names: Iterable[str]) -> str:
    """Say what may have been meant by a name, and which names there are."""
    items = list(names)
    close = get_close_matches(name, items, n=1)
    meant = f"did you mean {clipped(close[0])}? " if close else ""
    return f"{meant}choose from {listed(items)}"


def for_people(unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that tables and figures show, and its name.

    Metres become mm and radians degrees; the sensor's own unit stays.
    """
    named = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg")}
    return named.get(unit, (1.0, unit))


def unit_of_joint(revolute: bool, degrees: bool) -> tuple[float, str]:
    """Return what makes of a joint's rad or m the unit that it is typed and told in, and that."""
    if not revolute:
        return 1.0, "m"
    return (math.degrees(1.0), "deg") if degrees else (1.0, "rad")


def vector(values: Iterable[float]) -> str:
    """Return a vector as text, in which rounding errors, and a zero's sign, do not show."""
    return (
        "("
        + ", ".join(f"{round(float(value), 6) + 0.0:.4g}" for value in values)
        + ")"
    )


def length_in_words(value: float, unit: str) -> str:
    """Return a length with the prefix that suits it, three digits: 1.23 mm, below 1 nm, 2.5 px."""
    if not math.isfinite(value):
        return "unknown"
    if unit != "m" or abs(value) >= 1.0:
        return f"{value:.3g} {unit}"
    if abs(value) < ROUNDED_AWAY:
        return "below 1 nm" if value else "0"
    factor, name = next(
        (f, n) for f, n in _PREFIXES if abs(value) >= 0.9995 * f or n == "nm"
    )
    return f"{value / factor:.3g} {name}"


def filled(package: str, name: str, **parts: str) -> str:
    """Return a file of a package whose places are filled.

    A place such as `@page.css@` takes the file of that name, any other one of the parts.
    """
    from importlib.resources import files

    folder = files(package)

    def fill(match: re.Match[str]) -> str:
        place = match[1]
        return (
            parts[place]
            if place in parts
            else (folder / place).read_text(encoding="utf-8")
        )

    return _PLACE.sub(fill, (folder / name).read_text(encoding="utf-8"))
