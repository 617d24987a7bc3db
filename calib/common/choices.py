"""Names that users choose by: the library checks them and the command line offers them.

`calib --help` reads them: no import here is heavy.
"""

from collections.abc import Iterable
from typing import Literal, get_args

from ..errors import CalibError, OptionError

# networks: `calib.maps.density.gain_of` has the gain that each trains with
MAPS = (
    "som",
    "vdsom",
    "vdsom:residual",
    "vdsom:border",
    "vdsom:rho",
    "vdsom:printed",
    "vdsom:error",
    "dsom",
    "gng",
    "gng:error",
    "gng:border",
)
MAP_READOUTS = ("linear", "activity", "winner")  # of maps and links alone

RuleWord = Literal["batch", "online"]
# body where there is one
ReadoutWord = Literal["local", "body", "linear", "activity", "winner"]
# whether there is a kinematic model under the maps
BodyWord = Literal["auto", "none"]
# what a sensor measures; auto goes by the unit, pinhole is for arms in space
ViewWord = Literal[
    "auto", "base", "rigid", "similarity", "affine", "homography", "pinhole"
]
# whose coordinates a query and its answer are in
FrameWord = Literal["sensor", "base"]
CauseWord = Literal["sensor", "joints"]  # what a user may know of a change
# where the camera is; the board is at the other place
Eye = Literal["hand", "base"]
MethodWord = Literal["few-shot", "online"]  # how a model adapts

FreeWord = Literal["all", "offsets"]
"""What of a drawing may be off: all, or the joints' zeros and the sensor's frame alone."""

RULES: tuple[str, ...] = get_args(RuleWord)
READOUTS: tuple[str, ...] = get_args(ReadoutWord)
BODIES: tuple[str, ...] = get_args(BodyWord)
VIEWS: tuple[str, ...] = get_args(ViewWord)
FREED: tuple[str, ...] = get_args(FreeWord)
FRAMES: tuple[str, ...] = get_args(FrameWord)
CAUSES: tuple[str, ...] = get_args(CauseWord)
EYES: tuple[str, ...] = get_args(Eye)
# of flange poses
ROTATIONS = ("xyzw", "wxyz", "vector", "rpy", "kuka", "fanuc", "matrix")
METHODS: tuple[str, ...] = get_args(MethodWord)

DICTIONARY = "apriltag_36h11"  # of tags, if none is named
PICTURES = (
    ".jpg",
    ".jpeg",
    ".png",
    ".bmp",
    ".tif",
    ".tiff",
    ".webp",
    ".ppm",
    ".pgm",
)
# whatever else OpenCV opens
VIDEOS = (
    ".mp4",
    ".mov",
    ".avi",
    ".mkv",
    ".webm",
    ".m4v",
    ".mpg",
    ".mpeg",
    ".wmv",
)


def check_choice(
    name: str,
    value: object,
    choices: Iterable[str],
    error: type[CalibError] = OptionError,
) -> None:
    """Raise an error where the value of a parameter is none of its choices."""
    names = tuple(choices)
    if value not in names:
        raise error(
            f"{name} {value!r}: expected one of {', '.join(names)}",
            parameter=name,
            value=value,
        )
