"""Changes of the simulated arm and sensor, as typed: `elbow.length=+20%`."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from ..common.rows import LARGEST
from ..errors import OptionError


class Rule(NamedTuple):
    """A value that can change."""

    form: str  # what is typed
    possible: Callable[[float], bool]
    relative: bool = False  # whether it may be typed as a change in percent
    numbers: int = 1
    angle: bool = False  # whether it is typed in degrees where the joint is


def _positive(value: float) -> bool:
    return value > 0


def _not_negative(value: float) -> bool:
    return value >= 0


def _share(value: float) -> bool:
    return 0 <= value < 1


OF_JOINT = {
    "length": Rule("+20% or 0.3 [m], above zero", _positive, relative=True),
    "offset": Rule("0.05 [rad or m]", math.isfinite, angle=True),
    "gear": Rule("1.02, not 0 (lock holds a joint)", bool, relative=True),
    "noise": Rule("0.01 [rad or m], not negative", _not_negative, angle=True),
    "backlash": Rule(
        "0.01 [rad or m], not negative", _not_negative, angle=True
    ),
    "lock": Rule("1.0 [rad or m]", math.isfinite, angle=True),
}
OF_SENSOR = {
    "mirror": Rule("x or y", math.isfinite, numbers=2),
    "scale": Rule("1.05, above zero", _positive, relative=True),
    "rotate": Rule("0.14 [rad]", math.isfinite),
    "shift": Rule("0.03,-0.02 [m]", math.isfinite, numbers=2),
    "outliers": Rule("5%, a share of the rows below 1", _share),
}
PARTS = {
    "tip": {"offset": Rule("0.01,0.02 [m]", math.isfinite, numbers=2)},
    "sensor": OF_SENSOR,
}
"""What can change beside the joints."""

IN_SPACE = ("scale", "outliers")
"""Changes of the sensor that an arm in space can have."""

_CHOICES = (
    f"JOINT.{'|'.join(OF_JOINT)}, tip.offset, sensor.{'|'.join(OF_SENSOR)}"
)
_MIRRORS = {"x": (-1.0, 1.0), "y": (1.0, -1.0)}


@dataclass(frozen=True)
class Change:
    """One change of the simulated arm or sensor."""

    part: str  # a joint's name, "tip" or "sensor"
    what: str  # `length`, `offset`, ...
    # one number, or two for `tip.offset` and `sensor.shift` [rad, m or 1]. For `sensor.mirror` the
    # factors of x and y, such as (-1, 1). Where `relative`, the factor itself: 1.2 for +20%.
    values: tuple[float, ...]
    relative: bool
    text: str  # the change as typed

    def __str__(self) -> str:
        return self.text


def parse_change(text: str, *, degrees: Collection[str] = ()) -> Change:
    """Read one change, such as `elbow.length=+20%`, `tip.offset=0.01,0.02` or `sensor.mirror=x`.

    The last dot before the last `=` divides the name from what is changed, so a joint's name may
    hold dots.  Offset, noise, backlash and lock of the joints in `degrees` are typed in degrees;
    the answer is in SI units.

    Raises OptionError if the text is no change or its value is impossible.

    Examples
    --------
    >>> change = parse_change("left.elbow.length=+20%")
    >>> change.part, change.what, change.values, change.relative
    ('left.elbow', 'length', (1.2,), True)
    """
    name, _, value = (piece.strip() for piece in text.rpartition("="))
    part, _, what = name.rpartition(".")
    rules = PARTS.get(part, OF_JOINT)
    if not part or not value or what not in rules:
        raise OptionError(
            f"change {text!r} is not WHO.WHAT=VALUE such as elbow.length=+20%; choices: {_CHOICES}"
        )
    rule = rules[what]
    relative = rule.relative and value[0] in "+-" and value.endswith("%")
    values = _values(what, value, relative)
    possible = all(
        abs(number) < LARGEST and rule.possible(number) for number in values
    )
    if len(values) != rule.numbers or not possible:
        raise OptionError(
            f"change {text!r}: expected a value such as {rule.form}"
        )
    if part in degrees and rule.angle:
        values = (math.radians(values[0]),)
        text = f"{part}.{what}={values[0]!r}"
    return Change(part, what, values, relative, text.strip())


def parse_changes(
    changes: Iterable[str | Change], *, degrees: Collection[str] = ()
) -> tuple[Change, ...]:
    """Read several changes; the same thing changed twice is refused. See `parse_change`."""
    parsed: dict[tuple[str, str], Change] = {}
    for item in (changes,) if isinstance(changes, str) else changes:
        change = (
            item
            if isinstance(item, Change)
            else parse_change(item, degrees=degrees)
        )
        before = parsed.setdefault((change.part, change.what), change)
        if before is not change:
            raise OptionError(
                f"change {change} comes after {before}: give one of the two"
            )
    return tuple(parsed.values())


def _values(what: str, value: str, relative: bool) -> tuple[float, ...]:
    """The numbers of a change as typed, +20% as 1.2; none where there are no such numbers."""
    if what == "mirror":
        return _MIRRORS.get(value, ())
    percent = value.endswith("%") and (relative or what == "outliers")
    try:
        numbers = [
            float(number)
            for number in value.removesuffix("%" * percent).split(",")
        ]
    except ValueError:
        return ()
    if percent:
        numbers = [number / 100.0 for number in numbers]
    if relative:
        numbers = [1.0 + number for number in numbers]
    return tuple(numbers)
