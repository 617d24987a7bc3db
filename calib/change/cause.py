"""A cause: one change that explains a log, in numbers and in words."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from ..body.parameters import Label


class Words(NamedTuple):
    """A group of parameters in words."""

    kept: str  # of what an adaptation leaves as it was; "" where that is not told
    # of a change; `value` and `half` its interval are in deg or %
    changed: str = "{name} changed by {raw:.4g} ± {raw_half:.2g} {unit}"
    whole: bool = False  # whether all of its parameters are one cause


_OFF = "{who} is off by {value:+.3g} ± {half:.2g} deg"
WORDS = {
    "view.rotation": Words("the sensor's frame"),
    "view.scale": Words("the sensor's scale", "the sensor's scale changed by {value:+.3g} %", True),
    "view.shear": Words("", "the sensor's axes are stretched or sheared", True),
    "view.tilt": Words("the camera's tilt", "the camera is tilted", True),
    "lens": Words("the lens", "the sensor's frame is bent, as by a lens", True),
    "length": Words("the links' lengths", "the link of {joint} is {share}{size} {longer}"),
    "offset": Words("the joints' offsets", _OFF),
    "gain": Words(
        "the joints' gains", "{joint} moves {value:+.3g} ± {half:.2g} % further than it says"
    ),
    "elastic": Words("elasticity", "{joint} bends under load, by up to {most:.3g} deg", True),
    "placement": Words("the joints' placements"),
    "tool": Words("the tool"),
    "curve": Words("", "{joint} has another error curve, by up to {most:.3g} deg", True),
}
"""What is said of each group; its numbers are those of the posterior."""


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
    def of_parameter(
        label: Label, old: float, change: float, sd: float, most: float = 0.0
    ) -> Cause:
        """A cause that one parameter tells: its old value, its change and that one's sd.

        most : the largest change of all parameters of its group and joint
        """
        group, joint, half = label.group.partition(".")[0], label.joint or "", 1.96 * sd
        group = label.group if group in ("view", "tool") else group
        told = WORDS.get(group, Words(""))
        if label.unit == "rad" and not told.whole:
            told = Words("", _OFF)
        factor = math.degrees(1.0) if label.unit == "rad" else 100.0
        value = math.expm1(change) if group == "view.scale" else change
        share = f"{100 * abs(change / old) if old else math.nan:.3g} %"
        size = f" ({1e3 * abs(change):.3g} ± {1e3 * half:.2g} mm)" if label.unit == "m" else ""
        words = told.changed.format(
            joint=joint, name=label.name, who=joint or label.name, unit=label.unit, raw=change,
            raw_half=half, value=factor * value, half=factor * half, share=share, size=size,
            longer="longer" if change > 0 else "shorter", most=math.degrees(most),
        )  # fmt: skip
        kind = group.removeprefix("view.")
        return Cause.measured(
            f"{kind}:{joint}" if joint else kind, label.group, words, change, half, label.unit
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}
