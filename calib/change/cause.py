"""A cause: one change that explains a log, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Cause:
    """One change that explains a log.

    Attributes
    ----------
    cause : str
        ``"sensor"``, ``"offset:JOINT"``, ``"length:JOINT"``, ``"gain:JOINT"``,
        ``"elastic:JOINT"``, ``"curve:JOINT"``, ``"scale"``, ``"tilt"``, ``"lens"``,
        ``"mirror"``, ``"sign:JOINT"``, ``"lost:JOINT"``, ``"noise"`` or ``"unknown"``.
    group : str
        Group of parameters: ``"view.rotation"``, ``"offset"``, ``"length"``, ...
    value : float or None
        Size of the change, None where no number tells it.
    interval : (float, float) or None
        95 % interval of the value.
    unit : str
        Unit of the value.
    words : str
        The same in words.
    """

    cause: str
    group: str
    value: float | None
    interval: tuple[float, float] | None
    unit: str
    words: str

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
