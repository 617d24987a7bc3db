"""A cause: one change that explains a log, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
    value: float | None  # size of the change, None where no number tells it
    interval: tuple[float, float] | None  # 95 % interval of the value
    unit: str  # unit of the value
    words: str  # the same in words

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
