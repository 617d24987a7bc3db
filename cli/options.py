"""Options: what several commands take, with the same name and meaning in each.

Each is an annotation of Typer; a parser of `parsing` reads what is typed in a form of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from typer import Argument, Option

from calib.common import choices

from . import parsing


def word(flag: str, words: Sequence[str], help_text: str) -> object:
    """Return an option whose value is one word out of several."""
    return Option(
        flag, metavar="|".join(words), parser=parsing.one_of(words), help=help_text
    )


# what a command prints: `cli/app.py` reads these of each command
Json = Annotated[
    bool, Option("--json", help="One JSON document on standard output, in SI units.")
]
Verbose = Annotated[
    bool, Option("--verbose", "-v", help="Print what the answer rests on too.")
]
Quiet = Annotated[
    bool, Option("--quiet", "-q", help="Print the result alone, without notes.")
]

# files that commands work on
ModelFile = Annotated[
    str, Argument(metavar="MODEL", help="The file of a learned model.")
]
RobotFile = Annotated[
    str, Argument(metavar="ROBOT", help="A URDF file or a bundled robot.")
]
Data = Annotated[
    str | None,
    Option(
        "--data",
        metavar="LOG",
        help="A measured log: CSV or Parquet with the joints' columns and x, y.",
    ),
]
DataOfSensors = Annotated[
    list[str] | None,
    Option(
        "--data",
        metavar="LOG",
        help="A measured log: CSV or Parquet with the joints' columns and x, y; several, or a "
        "column `sensor`, of several sensors.",
    ),
]
NewLog = Annotated[
    str,
    Option(
        "--data",
        metavar="LOG",
        help="New samples: CSV or Parquet with the joints' columns and x, y.",
    ),
]
JointsFile = Annotated[
    str | None,
    Option("--joints-file", metavar="FILE", help="A row of joints for each picture."),
]
DatasetCamera = Annotated[
    str | None, Option("--camera", metavar="NAME", help="Of a dataset with several.")
]
NewTable = Annotated[
    str,
    Option(
        "--output", "-o", metavar="LOG", help="CSV, or Parquet by its name (- stdout)."
    ),
]

# what is babbled or sensed
JointNames = Annotated[
    Sequence[str] | None,
    Option(
        "--joints",
        metavar="A,B",
        parser=parsing.names,
        help="Active joints (default: the arm's).",
    ),
]
Tip = Annotated[
    str | None,
    Option("--tip", metavar="FRAME", help="The frame whose position is sensed."),
]
Planar = Annotated[
    bool, Option("--planar", help="Take the planar part of a robot in space: x, y.")
]
Lock = Annotated[
    list[parsing.JointValue] | None,
    Option(
        "--lock",
        metavar="JOINT=VALUE",
        parser=parsing.joint_value,
        help="Hold it there [rad, m].",
    ),
]
Ranges = Annotated[
    list[parsing.JointRange] | None,
    Option(
        "--range",
        metavar="JOINT=LO:HI",
        parser=parsing.joint_range,
        help="Part of its range.",
    ),
]
Degrees = Annotated[
    bool, Option("--degrees", help="Joint values typed, read and printed are in deg.")
]
Gravity = Annotated[
    tuple[float, ...] | None,
    Option(
        "--gravity",
        metavar="X,Y,Z",
        parser=parsing.direction,
        help="Where gravity points in the root's frame (default 0,0,-1).",
    ),
]

# simulated babbling
SAMPLES = "How many samples to babble (default 20000)."
NOISE = (
    "Noise of the simulated sensor along each axis, standard deviation [m] (default 0)."
)
Number = Annotated[
    int | None,
    Option("--samples", "-n", metavar="N", parser=parsing.count, help=SAMPLES),
]
Noise = Annotated[
    float | None,
    Option("--noise", metavar="S", parser=parsing.not_negative, help=NOISE),
]
Changes = Annotated[
    list[str] | None,
    Option(
        "--change",
        metavar="JOINT.WHAT=VALUE",
        help="Such as elbow.length=+20%, sensor.rotate=0.14.",
    ),
]
Seed = Annotated[
    int,
    Option(
        "--seed",
        metavar="K",
        parser=parsing.whole(0),
        help="Seed of the random numbers.",
    ),
]

# training
SIZE = (
    "Nodes of both maps (default 70; for three joints 17x17x17; a log chooses its own)."
)
MAP = (
    f"Kind of map: {', '.join(choices.MAPS)}. Default vdsom:residual, which also follows what "
    "the body leaves (vdsom is the paper's); of a log with --body none the better of it and gas."
)
EPOCHS = "Passes over the samples; the full lattice alone is trained then."
SIGMA = "Neighbourhood radius, start and end [nodes]; the full lattice alone is trained then."
MapSize = Annotated[
    str | None,
    Option("--size", metavar="N|NxN|NxNxN", parser=parsing.lattice_size, help=SIZE),
]
MotorSize = Annotated[
    str | None,
    Option(
        "--motor-size",
        metavar="N|NxN",
        parser=parsing.lattice_size,
        help="Of the motor map.",
    ),
]
SensorySize = Annotated[
    str | None,
    Option(
        "--sensory-size",
        metavar="N|NxN",
        parser=parsing.lattice_size,
        help="Of the sensory map.",
    ),
]
MapName = Annotated[
    str | None,
    Option("--map", metavar="NAME", parser=parsing.one_of(choices.MAPS), help=MAP),
]
TrainingRule = Annotated[
    choices.RuleWord,
    word(
        "--rule",
        choices.RULES,
        "Training rule.",
    ),
]
Epochs = Annotated[
    int | None, Option("--epochs", metavar="N", parser=parsing.count, help=EPOCHS)
]
Sigma = Annotated[
    parsing.RadiusSchedule | None,
    Option("--sigma", metavar="START:END", parser=parsing.sigma, help=SIGMA),
]
BodyKind = Annotated[
    choices.BodyWord,
    word(
        "--body",
        choices.BODIES,
        "none: maps and links alone.",
    ),
]
SensorView = Annotated[
    choices.ViewWord,
    word(
        "--view",
        choices.VIEWS,
        "What the sensor measures: base is the robot's root frame; auto is rigid for "
        "lengths, homography for pixels, pinhole for pixels of an arm in space.",
    ),
]

# logs
TimeOffset = Annotated[
    float | None,
    Option(
        "--time-offset",
        metavar="auto|S",
        parser=parsing.seconds,
        help="Of positions [s].",
    ),
]
Columns = Annotated[
    Mapping[str, str] | None,
    Option(
        "--columns",
        metavar="x=U,y=V",
        parser=parsing.column_names,
        help="Columns of other names.",
    ),
]
Unit = Annotated[
    str | None,
    Option(
        "--unit", metavar="m|mm|px|..", help="Of the log (default m, or the model's)."
    ),
]
Prismatic = Annotated[
    Sequence[str] | None,
    Option(
        "--prismatic", metavar="A,B", parser=parsing.names, help="Joints that slide."
    ),
]
LogDegrees = Annotated[
    bool | None, Option("--degrees/--radians", help="Of the log (default: as before).")
]
PhotoFile = Annotated[
    str | None,
    Option(
        "--photo", metavar="FILE", help="Of the log's camera, to draw the map over."
    ),
]
NoPhoto = Annotated[
    bool, Option("--no-photo", help="Keep no photo in the model and draw none.")
]
Distances = Annotated[
    list[str] | None,
    Option("--distance", metavar="A,B=50mm", help="Of touched points."),
]
Planes = Annotated[
    list[str] | None,
    Option("--plane", metavar="A,B,C,D", help="Touched points in a plane."),
]

# queries and what else asks a model
ReadoutKind = Annotated[
    choices.ReadoutWord | None,
    word(
        "--readout",
        choices.READOUTS,
        "Default local, or linear.",
    ),
]
InFrame = Annotated[
    choices.FrameWord,
    word(
        "--in",
        choices.FRAMES,
        "Of positions: sensor, or base [m].",
    ),
]
PositionUnit = Annotated[
    str | None,
    Option("--unit", metavar="m|mm|..", help="Of positions (default the model's)."),
]
Input = Annotated[
    str | None,
    Option(
        "--input", metavar="FILE", help="Answer every row of a CSV (- standard input)."
    ),
]
Output = Annotated[
    str | None,
    Option(
        "--output", metavar="FILE", help="CSV or Parquet (default standard output)."
    ),
]
LogView = Annotated[
    choices.LogFrameWord,
    word(
        "--view",
        choices.LOG_FRAMES,
        "base: the log is in the root frame.",
    ),
]
WhatChanged = Annotated[
    choices.CauseWord | None,
    word(
        "--cause",
        choices.CAUSES,
        "What changed, if known.",
    ),
]
FREE = ("all", "offsets")
Free = Annotated[
    Literal["all", "offsets"],
    word(
        "--free",
        FREE,
        "offsets: the drawing's geometry is true, the joints' zeros are not.",
    ),
]

# cameras
Eye = Annotated[
    choices.Eye | None,
    word(
        "--eye",
        choices.EYES,
        "hand: the camera is on the arm; base: it stands still.",
    ),
]
Dictionary = Annotated[
    str, Option("--dictionary", metavar="NAME", help="Dictionary of the tags.")
]
BOARD = (
    "A chessboard's squares: 10x7:22mm; ChArUco: 7x5:24mm:18mm:5x5_100; AprilTags: "
    "grid:6x6:88mm:26.4mm:t36h11."
)
BoardSpec = Annotated[
    str | None,
    Option(
        "--board",
        metavar="BOARD",
        help=BOARD,
    ),
]
LensFile = Annotated[
    str | None,
    Option(
        "--lens", metavar="SHOTS|lens.json", help="Pictures of a board, or a model."
    ),
]
TagNumber = Annotated[
    int | None,
    Option("--tag", metavar="ID", parser=parsing.whole(0), help="The tip's tag."),
]
TagTable = Annotated[
    str | None,
    Option("--tags-at", metavar="FILE", help="Table of desk tags: tag, x, y [m]."),
]
TagSize = Annotated[
    str | None,
    Option("--tag-size", metavar="40mm", help="Of the tip's tag, for --pose."),
]
TagHeight = Annotated[
    str | None,
    Option("--tag-height", metavar="25mm", help="Of the tip's, above the desk."),
]
WholePose = Annotated[
    bool, Option("--pose", help="z and the quaternion too, in space.")
]
SeenPicture = Annotated[
    str | None,
    Option("--picture", metavar="seen.png", help="Draw what was seen on a photo."),
]
