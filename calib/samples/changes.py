"""Changes of a simulated arm or sensor, as typed: `elbow.length=+20%`."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from ..common.checks import LARGEST
from ..errors import OptionError

_RELATIVE = ("length", "gear", "scale")  # +20% means times 1.2
_ANGLES = ("offset", "noise", "backlash", "lock")  # of a joint that is typed in degrees
_FORMS = {
    ("joint", "length"): "+20% or 0.3 [m]",
    ("joint", "offset"): "0.05 [rad or m]",
    ("joint", "gear"): "1.02",
    ("joint", "noise"): "0.01 [rad or m]",
    ("joint", "backlash"): "0.01 [rad or m]",
    ("joint", "lock"): "1.0 [rad or m]",
    ("tip", "offset"): "0.01,0.02 [m]",
    ("sensor", "mirror"): "x or y",
    ("sensor", "scale"): "1.05",
    ("sensor", "rotate"): "0.14 [rad]",
    ("sensor", "shift"): "0.03,-0.02 [m]",
    ("sensor", "outliers"): "0.05, a share of the rows",
}
_PAIRS = (("tip", "offset"), ("sensor", "shift"))  # of two numbers

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
    name, equals, value = text.strip().rpartition("=")
    target, dot, what = name.strip().rpartition(".")
    value = value.strip()
    if not (equals and dot and target and value):
        raise OptionError(
            f"change {text!r} is not WHO.WHAT=VALUE such as elbow.length=+20%; choices: {_CHOICES}"
        )
    part: Literal["joint", "tip", "sensor"] = "joint"
    if target == "sensor" and what in SENSOR_CHANGES:
        part = "sensor"
    elif target == "tip" and what == "offset" and "," in value:
        part = "tip"
    elif what not in JOINT_CHANGES:
        choices = ", ".join(SENSOR_CHANGES if target == "sensor" else JOINT_CHANGES)
        more = " (or tip.offset=DX,DY)" if target == "tip" else ""
        raise OptionError(f"change {text!r}: {target!r} has no {what!r}; choices: {choices}{more}")
    values = _values(text, part, what, value)
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
        key = (change.part, change.joint, change.what)
        if key in parsed:
            raise OptionError(
                f"change {change.text!r} comes after {parsed[key].text!r}: give one of the two"
            )
        parsed[key] = change
    return tuple(parsed.values())


def _values(text: str, part: str, what: str, value: str) -> tuple[float, ...]:
    """The numbers of a change; OptionError if they are impossible."""
    if what == "mirror" and value in ("x", "y"):
        return (-1.0, 1.0) if value == "x" else (1.0, -1.0)
    percent, signed = value.endswith("%"), value[0] in "+-"
    if percent and what == "length" and not signed:
        raise OptionError(
            f"change {text!r}: expected +{value} to lengthen by it, -{value} to shorten, "
            "or a length such as 0.3 [m]"
        )
    try:
        values = tuple(float(number) for number in value.removesuffix("%").split(","))
    except ValueError:
        values = ()
    count = 2 if (part, what) in _PAIRS else 1
    typed = what != "mirror" and (not percent or what in (*_RELATIVE, "outliers"))
    if len(values) != count or not typed or not all(abs(v) < LARGEST for v in values):
        raise OptionError(f"change {text!r}: expected a value such as {_FORMS[part, what]}")
    if percent:
        # +20% is 1.2 and -20% is 0.8, but 105% without a sign 1.05, and a share of rows itself
        share = values[0] / 100.0
        values = (1.0 + share if signed and what != "outliers" else share,)
    first = values[0]
    refusals = {
        f"the {what} must stay above zero": what in ("length", "scale") and first <= 0.0,
        "a gear of 0 moves nothing; use lock to hold a joint": what == "gear" and first == 0.0,
        f"the {what} cannot be negative": what in ("noise", "backlash") and first < 0.0,
        "expected a share of the rows from 0 to below 1": (
            what == "outliers" and not 0.0 <= first < 1.0
        ),
    }
    for words, wrong in refusals.items():
        if wrong:
            raise OptionError(f"change {text!r}: {words}")
    return values
