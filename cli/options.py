"""Options: what several commands take, with the same name and meaning in each.

Each is an annotation of Typer; a parser of `parsing` reads what is typed in a form of its own.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, TypeVar

from typer import Argument, Option

from calib.common import choices

from . import parsing

_T = TypeVar("_T")


def value(
    form: str, help_text: str, parser: parsing.Parser[_T] | None = None
) -> object:
    """Return an option with a value, by its form such as `--output -o FILE`."""
    *flags, metavar = form.split()
    return Option(*flags, metavar=metavar, parser=parser, help=help_text)


def option(flags: str, help_text: str) -> object:
    """Return an option without a value, or with a word of its type's."""
    return Option(*flags.split(), help=help_text)


# how every command prints: `cli/app.py` takes these anywhere in the line
Json = Annotated[
    bool, option("--json", "One JSON document on standard output, in SI units.")
]
Verbose = Annotated[
    bool, option("--verbose -v", "Print what the answer rests on too.")
]
Quiet = Annotated[
    bool, option("--quiet -q", "Print the result alone, without notes.")
]

# files that commands work on
ModelFile = Annotated[
    str, Argument(metavar="MODEL", help="The file of a learned model.")
]
RobotFile = Annotated[
    str, Argument(metavar="ROBOT", help="A URDF file or a bundled robot.")
]
_LOG = "CSV or Parquet with the joints' columns and x, y"
Data = Annotated[str | None, value("--data LOG", f"A measured log: {_LOG}.")]
DataOfSensors = Annotated[
    list[str] | None,
    value(
        "--data LOG",
        f"A measured log: {_LOG}; several, or a column `sensor`, of several sensors.",
    ),
]
NewLog = Annotated[str, value("--data LOG", f"New samples: {_LOG}.")]
JointsFile = Annotated[
    str | None, value("--joints-file FILE", "A row of joints for each picture.")
]
DatasetCamera = Annotated[
    str | None, value("--camera NAME", "Which one of a dataset with several.")
]
_TABLE = "CSV, or Parquet by its name (- stdout)."
NewTable = Annotated[str, value("--output -o FILE", _TABLE)]

# what is babbled or sensed
JointNames = Annotated[
    Sequence[str] | None,
    value("--joints A,B", "Active joints (default: the arm's).", parsing.names),
]
Tip = Annotated[
    str | None, value("--tip FRAME", "The frame whose position is sensed.")
]
Planar = Annotated[
    bool, option("--planar", "Take the planar part of a robot in space: x, y.")
]
Lock = Annotated[
    list[parsing.OfJoint] | None,
    value(
        "--lock JOINT=VALUE",
        "Hold a joint there [rad, m].",
        parsing.joint_value,
    ),
]
Ranges = Annotated[
    list[parsing.OfJoint] | None,
    value(
        "--range JOINT=LO:HI", "Part of a joint's range.", parsing.joint_range
    ),
]
Degrees = Annotated[
    bool,
    option("--degrees", "Joint values typed, read and printed are in deg."),
]
Gravity = Annotated[
    parsing.Numbers | None,
    value(
        "--gravity X,Y,Z",
        "Where gravity points in the root's frame (default 0,0,-1).",
        parsing.direction,
    ),
]

# simulated babbling
Number = Annotated[
    int | None,
    value(
        "--samples -n N",
        "How many samples to babble (default 20000).",
        parsing.count,
    ),
]
Noise = Annotated[
    float | None,
    value(
        "--noise S",
        "Noise of the simulated sensor along each axis, standard deviation [m] (default 0).",
        parsing.not_negative,
    ),
]
Changes = Annotated[
    list[str] | None,
    value(
        "--change JOINT.WHAT=VALUE",
        "Such as elbow.length=+20%, sensor.rotate=0.14.",
    ),
]
Seed = Annotated[
    int, value("--seed K", "Seed of the random numbers.", parsing.whole(0))
]

# training
MAP = (
    f"Kind of map: {', '.join(choices.MAPS)}. Default vdsom:residual, which also follows what "
    "the body leaves (vdsom is the paper's)."
)
_SIZE = parsing.lattice_size
MapSize = Annotated[
    str | None,
    value(
        "--size N|NxN|NxNxN",
        "Nodes of both maps (default 70; for three joints 17x17x17; a log chooses its own).",
        _SIZE,
    ),
]
MotorSize = Annotated[
    str | None, value("--motor-size N|NxN", "Of the motor map.", _SIZE)
]
SensorySize = Annotated[
    str | None, value("--sensory-size N|NxN", "Of the sensory map.", _SIZE)
]
MapName = Annotated[
    str | None, value("--map NAME", MAP, parsing.one_of(choices.MAPS))
]
TrainingRule = Annotated[choices.RuleWord, option("--rule", "Training rule.")]
Epochs = Annotated[
    int | None,
    value(
        "--epochs N",
        "Passes over the samples; the full lattice alone is trained then.",
        parsing.count,
    ),
]
Sigma = Annotated[
    parsing.Numbers | None,
    value(
        "--sigma START:END",
        "Neighbourhood radius, start and end [nodes]; the full lattice alone is trained then.",
        parsing.sigma,
    ),
]
BodyKind = Annotated[
    choices.BodyWord, option("--body", "none: maps and links alone.")
]
SensorView = Annotated[
    choices.ViewWord,
    option(
        "--view",
        "What the sensor measures: base is the robot's root frame; auto is rigid for "
        "lengths, homography for pixels, pinhole for pixels of an arm in space.",
    ),
]

# logs
TimeOffset = Annotated[
    float | None,
    value(
        "--time-offset auto|S",
        "Added to the positions' times [s].",
        parsing.seconds,
    ),
]
Columns = Annotated[
    Mapping[str, str] | None,
    value(
        "--columns x=U,y=V",
        "Columns that have other names.",
        parsing.column_names,
    ),
]
Unit = Annotated[
    str | None,
    value(
        "--unit m|mm|px|..",
        "Of the log's positions (default m, or the model's).",
    ),
]
Prismatic = Annotated[
    Sequence[str] | None,
    value("--prismatic A,B", "Joints that slide.", parsing.names),
]
LogDegrees = Annotated[
    bool | None,
    option("--degrees/--radians", "Of the log (default: as the model's)."),
]
PhotoFile = Annotated[
    str | None,
    value("--photo FILE", "By the log's camera, to draw the map over."),
]
NoPhoto = Annotated[
    bool, option("--no-photo", "Keep no photo in the model and draw none.")
]
Distances = Annotated[
    list[str] | None, value("--distance A,B=50mm", "Between touched points.")
]
Planes = Annotated[
    list[str] | None, value("--plane A,B,C,D", "Touched points of one plane.")
]

# queries and other uses of a model
ReadoutKind = Annotated[
    choices.ReadoutWord | None,
    option("--readout", "How to answer: local, or linear without a body."),
]
StartJoints = Annotated[
    parsing.Numbers | None,
    value("--from Q1,Q2", "Start near these joints.", parsing.reals),
]
InFrame = Annotated[
    str, value("--in SENSOR|base", "Frame of positions (the first sensor's).")
]
OfSensor = Annotated[
    str,
    value(
        "--in SENSOR",
        "The sensor (by default the first, or the one a log names).",
    ),
]
PositionUnit = Annotated[
    str | None,
    value("--unit m|mm|..", "Of typed and printed positions (the model's)."),
]
Input = Annotated[
    str | None,
    value("--input FILE", "Answer every row of a CSV (- standard input)."),
]
Output = Annotated[
    str | None,
    value("--output -o FILE", "CSV or Parquet (default standard output)."),
]
WhatChanged = Annotated[
    choices.CauseWord | None, option("--cause", "What changed, if known.")
]
Free = Annotated[
    choices.FreeWord,
    option(
        "--free",
        "offsets: the drawing's geometry is true, the joints' zeros are not.",
    ),
]

# cameras
_EYE = "hand: the camera is on the arm; base: it stands still."
Eye = Annotated[choices.Eye | None, option("--eye", _EYE)]
OneEye = Annotated[choices.Eye, option("--eye", _EYE)]
Dictionary = Annotated[
    str, value("--dictionary NAME", "Dictionary of the tags.")
]
BOARD = (
    "A chessboard's squares: 10x7:22mm; ChArUco: 7x5:24mm:18mm:5x5_100; AprilTags: "
    "grid:6x6:88mm:26.4mm:t36h11."
)
BoardSpec = Annotated[str | None, value("--board BOARD", BOARD)]
LensFile = Annotated[
    str | None,
    value(
        "--lens SHOTS|lens.json", "Pictures of a board, a lens file or a model."
    ),
]
TagNumber = Annotated[
    int | None, value("--tag ID", "The tip's tag.", parsing.whole(0))
]
TagTable = Annotated[
    str | None, value("--tags-at FILE", "Table of desk tags: tag, x, y [m].")
]
TagSize = Annotated[
    str | None,
    value("--tag-size 40mm", "Side of the tip's tag, to measure its pose."),
]
TagHeight = Annotated[
    str | None,
    value("--tag-height 25mm", "Height of the tip's tag above the desk."),
]
SeenPicture = Annotated[
    str | None, value("--picture seen.png", "Draw what was seen on a photo.")
]
