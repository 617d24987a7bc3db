"""Changes of a simulated arm or sensor, as typed: `elbow.length=+20%`."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from ..common.checks import LARGEST
from ..errors import OptionError

_RELATIVE = ("length", "gear", "scale")  # +20% means times 1.2
_ANGLES = ("offset", "noise", "backlash", "lock")  # of a joint that is typed in degrees
_PAIRS = (("tip", "offset"), ("sensor", "shift"))  # of two numbers

_Rule = tuple[str, Callable[[float], bool]]
_FORMS: dict[tuple[str, str], _Rule] = {
    ("joint", "length"): ("+20% or 0.3 [m], above zero", lambda value: value > 0),
    ("joint", "offset"): ("0.05 [rad or m]", math.isfinite),
    ("joint", "gear"): ("1.02, not 0 (lock holds a joint)", bool),
    ("joint", "noise"): ("0.01 [rad or m], not negative", lambda value: value >= 0),
    ("joint", "backlash"): ("0.01 [rad or m], not negative", lambda value: value >= 0),
    ("joint", "lock"): ("1.0 [rad or m]", math.isfinite),
    ("tip", "offset"): ("0.01,0.02 [m]", math.isfinite),
    ("sensor", "mirror"): ("x or y", lambda _: False),
    ("sensor", "scale"): ("1.05, above zero", lambda value: value > 0),
    ("sensor", "rotate"): ("0.14 [rad]", math.isfinite),
    ("sensor", "shift"): ("0.03,-0.02 [m]", math.isfinite),
    ("sensor", "outliers"): ("5%, a share of the rows below 1", lambda value: 0 <= value < 1),
}
"""What can change, a value of each, and which values are possible."""

JOINT_CHANGES = tuple(what for part, what in _FORMS if part == "joint")
SENSOR_CHANGES = tuple(what for part, what in _FORMS if part == "sensor")
_CHOICES = f"JOINT.{'|'.join(JOINT_CHANGES)}, tip.offset, sensor.{'|'.join(SENSOR_CHANGES)}"


@dataclass(frozen=True)
class Change:
    """One change of the simulated arm or sensor."""

    part: Literal["joint", "tip", "sensor"]
    joint: str  # the joint's name; empty for the tip and the sensor
    # `length`, `offset`, ...: one of `JOINT_CHANGES`, `SENSOR_CHANGES`; the tip has `offset`
    what: str
    # one number, or two for `tip.offset` and `sensor.shift` [rad, m or 1]. For `sensor.mirror` the
    # factors of x and y, such as (-1, 1). Where `relative`, the factor itself: 1.2 for +20%.
    values: tuple[float, ...]
    relative: bool
    text: str  # the change as typed

    def __str__(self) -> str:
        return self.text

    @property
    def value(self) -> float:
        """The first or only number."""
        return self.values[0]


def parse_change(text: str, *, degrees: Collection[str] = ()) -> Change:
    """Read one change, such as `elbow.length=+20%`, `tip.offset=0.01,0.02` or `sensor.mirror=x`.

    The last dot before the last `=` divides the name from what is changed, so a joint's
    name may hold dots, and a joint may even be called `sensor` or `tip`: a joint's
    changes differ from a sensor's, and the tip's offset has two numbers.  Offset, noise, backlash
    and lock of the joints in `degrees` are typed in degrees; the answer is in SI units.

    Raises OptionError if the text is no change or its value is impossible.

    Examples
    --------
    >>> change = parse_change("left.elbow.length=+20%")
    >>> change.joint, change.what, change.value, change.relative
    ('left.elbow', 'length', 1.2, True)
    """
    name, _, value = text.strip().rpartition("=")
    target, _, what = name.strip().rpartition(".")
    value = value.strip()
    part: Literal["joint", "tip", "sensor"] = "joint"
    if target == "sensor" and what in SENSOR_CHANGES:
        part = "sensor"
    elif target == "tip" and what == "offset" and "," in value:
        part = "tip"
    if not target or not value or (part, what) not in _FORMS:
        raise OptionError(
            f"change {text!r} is not WHO.WHAT=VALUE such as elbow.length=+20%; choices: {_CHOICES}"
        )
    values = _values(part, what, value)
    form, possible = _FORMS[part, what]
    if values is None or not (what == "mirror" or all(map(possible, values))):
        raise OptionError(f"change {text!r}: expected a value such as {form}")
    joint = target if part == "joint" else ""
    if joint and joint in degrees and what in _ANGLES:
        values = (math.radians(values[0]),)
        text = f"{target}.{what}={values[0]!r}"
    relative = value.endswith("%") and what in _RELATIVE
    return Change(part, joint, what, values, relative, text.strip())


def parse_changes(
    changes: Iterable[str | Change], *, degrees: Collection[str] = ()
) -> tuple[Change, ...]:
    """Read several changes; the same thing changed twice is refused. See `parse_change`."""
    if isinstance(changes, str):
        changes = (changes,)
    parsed: dict[tuple[str, str, str], Change] = {}
    for item in changes:
        change = item if isinstance(item, Change) else parse_change(item, degrees=degrees)
        before = parsed.setdefault((change.part, change.joint, change.what), change)
        if before is not change:
            raise OptionError(
                f"change {change.text!r} comes after {before.text!r}: give one of the two"
            )
    return tuple(parsed.values())


def _values(part: str, what: str, value: str) -> tuple[float, ...] | None:
    """The numbers of a change as typed; None if they are none of its kind."""
    if what == "mirror":
        return {"x": (-1.0, 1.0), "y": (1.0, -1.0)}.get(value)
    percent, signed = value.endswith("%"), value[0] in "+-"
    try:
        values = tuple(float(number) for number in value.removesuffix("%").split(","))
    except ValueError:
        return None
    if len(values) != 1 + ((part, what) in _PAIRS) or not all(abs(v) < LARGEST for v in values):
        return None
    if percent:
        if what not in (*_RELATIVE, "outliers") or (what == "length" and not signed):
            return None
        # +20% is 1.2 and -20% is 0.8, but 105% without a sign 1.05, and a share of rows itself
        share = values[0] / 100.0
        values = (1.0 + share if signed and what != "outliers" else share,)
    return values
