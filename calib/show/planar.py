"""Planar: what cannot be drawn yet is refused in one line, before anything is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import OptionError

if TYPE_CHECKING:
    from ..model.model import Model


def planar_only(model: Model, what: str) -> None:
    """Refuse a model of an arm in space, which `what` does not draw."""
    if len(model.axes) != 2:
        raise OptionError(
            f"the {what} draws planar arms; {model.about.robot or 'this arm'} moves in space",
            hint="use `calib info` and `calib evaluate`, or train with `planar=True`",
        )
