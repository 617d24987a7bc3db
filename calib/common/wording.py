"""Wording: names, choices and units as people read them, messages of one short line, pages."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from difflib import get_close_matches
from typing import TypeVar

_T = TypeVar("_T")

INSTALL = "pip install 'calib-arm[{0}]', or in a checkout pip install '.[{0}]'"
"""How an extra is installed."""

ROUNDED_AWAY = 1e-9
"""Errors below this [m], or below this share of a sensor's extent, are rounding."""

SMALLEST = 1e-6
"""Smallest error in words: a nanometre in mm, or a millionth of a degree."""


@dataclass(frozen=True)
class Longest:
    """Most characters of what is printed."""

    line: int = 1_500  # a message; of a longer one both ends are shown
    name: int = 60  # in a line with several names


LONGEST = Longest()

# a place to fill in, in a page that is a file of a package
_PLACE = re.compile(r"@([a-z]+(?:\.[a-z]+)?)@")


def number(value: float, digits: int = 3) -> str:
    """Return a number with some digits and never an exponent; below a millionth it is 0.

    >>> number(1041.7), number(0.12345), number(0.0000573, 2)
    ('1040', '0.123', '0.000057')
    """
    rounded = f"{value:.{digits}g}" if abs(value) >= 1e-6 else "0"
    return f"{Decimal(rounded):f}"


def two_digits(value: float) -> str:
    """Return a number with two digits and never an exponent."""
    return number(value, 2)


def printable(text: str) -> str:
    """Return a text whose line breaks, control characters and the like are written out."""
    if text.isprintable():  # most texts: one C loop
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def one_line(text: str, longest: int = LONGEST.line) -> str:
    """Return a message as one printable line, its middle left out where that is long."""
    line = printable(text)
    if len(line) <= longest:
        return line
    return f"{line[: longest // 2]} ... {line[-longest // 3 :]}"


def clipped(name: str) -> str:
    """Return a name that may be long, short enough for a line with several of them."""
    if len(name) <= LONGEST.name:
        return name
    return name[: LONGEST.name - 3] + "..."


def quoted(name: str) -> str:
    """Return a name from a file or a user, safe to print in one line."""
    return repr(clipped(name))


def listing(names: Iterable[str], most: int = 12) -> str:
    """Return names in one line: long ones are cut, and the rest after `most` of them is counted."""
    items = list(names)
    more = f", ... ({len(items)} in all)" if len(items) > most else ""
    return (", ".join(map(clipped, items[:most])) or "(none)") + more


def by_name(names: Iterable[str], values: Iterable[_T]) -> dict[str, _T]:
    """Return values by their names, of which there are as many.

    >>> by_name(("shoulder", "elbow"), (0.1, 0.2))
    {'shoulder': 0.1, 'elbow': 0.2}
    """
    return dict(zip(names, values, strict=True))


def suggestion(name: str, names: Iterable[str]) -> str:
    """Suggest the name that may have been meant, and list those that exist."""
    items = list(names)
    close = get_close_matches(name, items, n=1)
    meant = f"did you mean {clipped(close[0])}? " if close else ""
    return f"{meant}choose from {listing(items)}"


def for_people(unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that tables and figures show, and its name.

    Metres become mm and radians degrees; a unit that is not known is the sensor's own.
    """
    units = {
        "m": (1e3, "mm"),
        "rad": (math.degrees(1.0), "deg"),
        "sensor": (1.0, "sensor units"),
    }
    return units.get(unit, (1.0, unit))


def unit_of_joint(revolute: bool, degrees: bool) -> tuple[float, str]:
    """Return the factor from a joint's rad or m to the unit that people read, and its name."""
    if not revolute:
        return 1.0, "m"
    return (math.degrees(1.0), "deg") if degrees else (1.0, "rad")


def error_size(value: float | None) -> str:
    """Return the size of an error with three significant digits, or a dash for none."""
    if value is None or not math.isfinite(value):
        return "-"
    size = abs(value)
    if size < SMALLEST:
        return "<1e-6" if size else "0"
    # decimals that three digits need: 1.23, 12.3, 0.000123
    return f"{value:.{max(0, 2 - math.floor(math.log10(size)))}f}"


def with_unit(value: float, unit: str) -> str:
    """Return a length or an angle with the unit that people read, mm or degrees."""
    factor, shown = for_people(unit)
    if 0.0 < abs(factor * value) < SMALLEST:
        return f"below {SMALLEST:.6f} {shown}"
    return f"{error_size(factor * value)} {shown}"


def vector(values: Iterable[float]) -> str:
    """Return a vector as text, in which rounding errors, and a zero's sign, do not show."""
    digits = [f"{round(float(value), 6) + 0.0:.4g}" for value in values]
    return f"({', '.join(digits)})"


def quantity(value: float, unit: str, half: float = 0.0, sign: str = "") -> str:
    """Return a value in the unit that suits it, with half of its interval if there is one.

    >>> quantity(0.00012345, "m"), quantity(0.01, "rad", 0.0005), quantity(1e-12, "m")
    ('0.123 mm', '0.573 ± 0.029 deg', 'below 1 nm')
    >>> quantity(0.0039, "m", 0.00009)  # as many decimals as two digits of the interval have
    '3.900 ± 0.090 mm'
    """
    if unit == "m" and abs(value) + half < ROUNDED_AWAY:
        return "below 1 nm"
    factor, name = unit_for(abs(value) + half, unit)
    if not half:
        return f"{number(factor * value)} {name}"
    return f"{with_interval(factor * value, factor * half, sign)} {name}"


def with_interval(value: float, half: float, sign: str = "") -> str:
    """Return a value and half of its interval, both to two digits of that and six decimals at most.

    >>> with_interval(0.5774, 0.0099, "+"), with_interval(1.0, 4e-9)
    ('+0.5774 ± 0.0099', '1.000000 ± 0.000001')
    """
    if not math.isfinite(half):
        return f"{value:{sign}.3g} ± {half:g}"
    half = float(f"{max(half, 1e-6):.1e}")
    decimals = min(max(0, 1 - math.floor(math.log10(half))), 6)
    # a value that rounds to zero has no sign
    rounded = round(value, decimals) + 0.0
    return f"{rounded:{sign}.{decimals}f} ± {half:.{decimals}f}"


def unit_for(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that errors up to `largest` are shown in."""
    if unit == "1":
        return 100.0, "%"
    if unit == "m" and largest < 2e-8:
        return 1e9, "nm"
    if unit == "m" and largest < 2e-5:
        return 1e6, "µm"
    return for_people(unit)


def fill_template(package: str, name: str, **parts: str) -> str:
    """Return a file of a package with its places filled in.

    A place such as `@page.css@` is filled with the file of that name, others with the parts.
    """
    from importlib.resources import files

    folder = files(package)

    def fill(match: re.Match[str]) -> str:
        place = match[1]
        if place in parts:
            return parts[place]
        return (folder / place).read_text(encoding="utf-8")

    return _PLACE.sub(fill, (folder / name).read_text(encoding="utf-8"))
