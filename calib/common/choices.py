"""Names that users choose by: the library checks them and the command line offers them.

Plain tuples without any import, so that `calib --help` loads nothing that is heavy.
"""

MAPS = (
    "som", "vdsom", "vdsom:residual", "vdsom:border", "vdsom:rho", "vdsom:printed", "vdsom:error",
    "vdsom:density", "vdsom:lattice", "vdsom:mixed", "vdsom:transformation", "dsom", "gng",
    "gng:error", "gng:border", "gng:density", "gas", "grid", "random", "rows",
)  # fmt: skip
"""Networks: :data:`calib.maps.density.GAINS` has the same, with the gain that each trains with."""

RULES = ("batch", "online")
"""Training rules of a map."""

MAP_READOUTS = ("linear", "activity", "winner")
"""Readouts of maps and links alone."""

READOUTS = ("local", "body", *MAP_READOUTS)
"""Every readout; ``body`` only where there is one."""

BODIES = ("auto", "none")
"""Whether a kinematic model stands under the maps."""

VIEWS = ("auto", "base", "rigid", "similarity", "affine", "homography", "pinhole")
"""What a sensor measures; ``auto`` goes by the unit, ``pinhole`` is for arms in space."""

FRAMES = ("sensor", "base")
"""Whose coordinates a query is asked and answered in."""

LOG_FRAMES = ("auto", "base")
"""Whether a log is in the robot's root frame."""

CAUSES = ("sensor", "joints")
"""What a user may know of a change."""

EYES = ("hand", "base")
"""Where the camera is: in the hand and the board stands still, or the other way round."""

METHODS = ("few-shot", "online")
"""How a model adapts."""

DICTIONARY = "apriltag_36h11"
"""The dictionary of tags that is used if none is named."""

PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
"""Endings of files that are pictures."""

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
"""Endings of files that are videos, whatever else OpenCV opens."""

MOTIONS = ("uniform", "halton", "sobol", "smooth")
"""How a simulated arm babbles."""
