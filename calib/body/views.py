"""Kinds of sensors: what each fits of itself."""

from __future__ import annotations

from dataclasses import dataclass

from .parameters import Hyper
from .settings import TAG, WIDER


@dataclass(frozen=True)
class ViewKind:
    """A kind of sensor."""

    groups: tuple[str, ...] = ()  # groups of parameters that every member fits
    outputs: int = 2  # 2 positions in a plane or pixels, 3 positions in space, 6 of a pose
    least: int = 2  # fewest rows that place the sensor in front of an arm in space
    lens: bool = False  # whether the gate may fit a planar arm's lens by default
    # what is known of the tool where there is a drawing; None: nothing
    tool: Hyper | None = None

    @property
    def scaled(self) -> bool:
        """Whether it has a scale of its own."""
        return "view.scale" in self.groups

    @property
    def tilted(self) -> bool:
        """Whether it may look at a plane from the side."""
        return "view.shear" in self.groups


_FRAME = ("view.rotation", "view.shift")
_AFFINE = (*_FRAME, "view.scale", "view.shear")

PLANAR = {
    "base": ViewKind(),
    "rigid": ViewKind(_FRAME),
    "similarity": ViewKind((*_FRAME, "view.scale")),
    "affine": ViewKind(_AFFINE),
    "homography": ViewKind((*_AFFINE, "view.tilt"), lens=True),
}
"""Sensors of a planar arm; users choose among :data:`calib.common.choices.VIEWS`."""

SPATIAL = {
    "base": ViewKind(("tool",), 3, least=2),
    "rigid": ViewKind((*_FRAME, "tool"), 3, least=4),
    "similarity": ViewKind((*_FRAME, "tool", "view.scale"), 3, least=4),
    # in the robot's root frame with the orientation of the drawing's tip, or of some target there
    "base pose": ViewKind(("tool", "tool.rotation"), 6, least=3),
    "base target": ViewKind(("tool", "tool.rotation"), 6, least=3),
    "pose": ViewKind((*_FRAME, "tool", "tool.rotation"), 6, least=3),
    "pinhole": ViewKind((*_FRAME, "tool"), 2, least=6, tool=Hyper("tool", TAG, WIDER)),
}
"""Sensors of an arm in space; where there are two outputs, a camera sees it."""

VIEWS_OF_BODIES = {"planar": PLANAR, "spatial": SPATIAL}


def is_camera(view: str) -> bool:
    """Whether a view is that of a camera that sees an arm in space."""
    return view in SPATIAL and SPATIAL[view].outputs == 2
