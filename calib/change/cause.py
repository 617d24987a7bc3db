"""A cause: one change that explains a log, in numbers and in words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..body.parameters import Label

AS_ONE = {
    "view.scale": "the sensor's scale changed",
    "view.shear": "the sensor's axes are stretched or sheared",
    "view.tilt": "the camera is tilted",
    "lens": "the sensor's frame is bent, as by a lens",
    "elastic": "{joint} bends under load, by up to {size:.3g} deg",
    "curve": "{joint} has another error curve, by up to {size:.3g} deg",
}
"""Groups of which all parameters are told as one cause, in words."""

KEPT = {
    "view.rotation": "the sensor's frame",
    "view.scale": "the sensor's scale",
    "view.tilt": "the camera's tilt",
    "lens": "the lens",
    "length": "the links' lengths",
    "offset": "the joints' offsets",
    "gain": "the joints' gains",
    "elastic": "elasticity",
    "placement": "the joints' placements",
    "tool": "the tool",
}
"""Groups in the words of what an adaptation leaves as it was."""


@dataclass(frozen=True)
class Cause:
    """One change that explains a log."""

    # ``"sensor"``, ``"offset:JOINT"``, ``"length:JOINT"``, ``"gain:JOINT"``, ``"elastic:JOINT"``,
    # ``"curve:JOINT"``, ``"curve"`` of all joints, ``"scale"``, ``"tilt"``, ``"lens"``,
    # ``"mirror"``, ``"sign:JOINT"``, ``"lost:JOINT"``, ``"noise"`` or ``"unknown"``
    cause: str
    group: str  # group of parameters: ``"view.rotation"``, ``"offset"``, ``"length"``,
    words: str  # the same in words
    value: float | None = None  # size of the change, None where no number tells it
    interval: tuple[float, float] | None = None  # 95 % interval of the value
    unit: str = ""  # unit of the value

    @staticmethod
    def measured(name: str, group: str, words: str, value: float, half: float, unit: str) -> Cause:
        """A cause with half the width of its 95 % interval."""
        return Cause(name, group, words, value, (value - half, value + half), unit)

    @staticmethod
    def of_parameter(label: Label, old: float, change: float, sd: float) -> Cause:
        """A cause that one parameter tells: its old value, its change and that one's sd."""
        value, half = float(change), 1.96 * float(sd)
        joint, unit = label.joint or "", label.unit
        if unit == "rad":
            words = f"{joint} is off by {math.degrees(value):+.3g} ± {math.degrees(half):.2g} deg"
        elif label.group == "length":
            size = f"{100 * abs(value / old) if old else math.nan:.3g} %"
            if unit == "m":
                size += f" ({1e3 * abs(value):.3g} ± {1e3 * half:.2g} mm)"
            words = f"the link of {joint} is {size} {'longer' if value > 0 else 'shorter'}"
        elif label.group == "gain":
            words = f"{joint} moves {100 * value:+.3g} ± {100 * half:.2g} % further than it says"
        else:
            words = f"{label.name} changed by {value:.4g} ± {half:.2g} {unit}"
        name = f"{label.group}:{joint}" if joint else label.group
        return Cause.measured(name, label.group, words, value, half, unit)

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "cause": self.cause,
            "group": self.group,
            "value": self.value,
            "interval": None if self.interval is None else list(self.interval),
            "unit": self.unit,
            "words": self.words,
        }
