"""Names that users choose by: the library checks them and the command line offers them.

Plain texts without any import, so that `calib --help` loads nothing that is heavy.
"""

from __future__ import annotations

from typing import Literal, get_args

MAPS = (
    "som", "vdsom", "vdsom:residual", "vdsom:border", "vdsom:rho", "vdsom:printed", "vdsom:error",
    "dsom", "gng", "gng:error", "gng:border", "gas", "grid", "random", "rows",
)  # fmt: skip
"""Networks: :data:`calib.maps.density.GAINS` has the same, with the gain that each trains with."""

RuleWord = Literal["batch", "online"]
RULES: tuple[str, ...] = get_args(RuleWord)
"""Training rules of a map."""

MAP_READOUTS = ("linear", "activity", "winner")
"""Readouts of maps and links alone."""

ReadoutWord = Literal["local", "body", "linear", "activity", "winner"]
READOUTS: tuple[str, ...] = get_args(ReadoutWord)
"""Every readout; ``body`` only where there is one."""

BodyWord = Literal["auto", "none"]
BODIES: tuple[str, ...] = get_args(BodyWord)
"""Whether a kinematic model stands under the maps."""

ViewWord = Literal["auto", "base", "rigid", "similarity", "affine", "homography", "pinhole"]
VIEWS: tuple[str, ...] = get_args(ViewWord)
"""What a sensor measures; ``auto`` goes by the unit, ``pinhole`` is for arms in space."""

FrameWord = Literal["sensor", "base"]
FRAMES: tuple[str, ...] = get_args(FrameWord)
"""Whose coordinates a query is asked and answered in."""

LogFrameWord = Literal["auto", "base"]
LOG_FRAMES: tuple[str, ...] = get_args(LogFrameWord)
"""Whether a log is in the robot's root frame."""

CauseWord = Literal["sensor", "joints"]
CAUSES: tuple[str, ...] = get_args(CauseWord)
"""What a user may know of a change."""

Eye = Literal["hand", "base"]
EYES: tuple[str, ...] = get_args(Eye)
"""Where the camera is: in the hand and the board stands still, or the other way round."""

MethodWord = Literal["few-shot", "online"]
METHODS: tuple[str, ...] = get_args(MethodWord)
"""How a model adapts."""

DICTIONARY = "apriltag_36h11"
"""The dictionary of tags that is used if none is named."""

PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
"""Endings of files that are pictures."""

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
"""Endings of files that are videos, whatever else OpenCV opens."""

MotionWord = Literal["uniform", "halton", "sobol", "smooth"]
MOTIONS: tuple[str, ...] = get_args(MotionWord)
"""How a simulated arm babbles."""
