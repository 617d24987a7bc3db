"""Options: what several commands take, with the same name and meaning in each.

An annotation of Typer each; what is typed in a form of its own has a reader, and is Any to Typer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from typer import Argument, Option

from calib.common import choices

from . import parsing as read

Text = str | None
Many = list[Any] | None


def option(usage: str, told: str, reader: read.Reader[Any] | None = None, **limits: Any) -> Any:
    """Declare an option of a value as a usage line has it, such as "--output -o FILE"."""
    *flags, metavar = usage.split()
    return Option(*flags, metavar=metavar, parser=reader, help=told, **limits)


def flag(name: str, told: str) -> Any:
    """Declare an option without a value, or one that is a choice or a number of Typer's own."""
    return Option(name, help=told)


# files that commands work on
_LOG = "CSV or Parquet with the joints' columns and x, y"
ModelFile = Annotated[str, Argument(metavar="MODEL", help="The file of a learned model.")]
RobotFile = Annotated[str, Argument(metavar="ROBOT", help="A URDF file or a bundled robot.")]
Data = Annotated[Text, option("--data LOG", f"A measured log: {_LOG}.")]
JointsFile = Annotated[Text, option("--joints-file FILE", "A row of joints for each picture.")]
DatasetCamera = Annotated[Text, option("--camera NAME", "Of a dataset with several.")]
NewLog = Annotated[str, option("--data LOG", f"New samples: {_LOG}.")]

# what is babbled or sensed
JointNames = Annotated[Any, option("--joints A,B", "Active joints (default found).", read.names)]
Tip = Annotated[Text, option("--tip FRAME", "The frame whose position is sensed.")]
Planar = Annotated[bool, flag("--planar", "Take the planar part of a robot in space: x, y.")]
Lock = Annotated[Many, option("--lock JOINT=VALUE", "Hold it there [rad, m].", read.joint_value)]
Ranges = Annotated[Many, option("--range JOINT=LO:HI", "Part of its range.", read.joint_range)]
Degrees = Annotated[bool, flag("--degrees", "Joint values typed, read and printed are in deg.")]

# simulated babbling
BABBLED = "How many samples to babble (default 20000)."
NOISE = "Noise of the simulated sensor along each axis, standard deviation [m] (default 0)."
Number = Annotated[int | None, Option("--samples", "-n", metavar="N", min=1, help=BABBLED)]
Noise = Annotated[float | None, Option("--noise", metavar="S", min=0, help=NOISE)]
CHANGES = "Such as elbow.length=+20%, sensor.rotate=0.14."
Changes = Annotated[list[str] | None, option("--change JOINT.WHAT=VALUE", CHANGES)]
Seed = Annotated[int, Option("--seed", metavar="K", min=0, help="Seed of the random numbers.")]

# training
SIZE = "Nodes of both maps (default 70; for three joints 17x17x17; a log chooses its own)."
MAP = (
    f"Kind of map: {', '.join(choices.MAPS)}. Default vdsom:residual, which also follows what "
    "the body leaves (vdsom is the paper's); of a log with --body none the better of it and gas."
)
EPOCHS = "Passes over the samples; the full lattice alone is trained then."
SIGMA = "Neighbourhood radius, start and end [nodes]; the full lattice alone is trained then."
MapSize = Annotated[Any, option("--size N|NxN|NxNxN", SIZE, read.size)]
MotorSize = Annotated[Any, option("--motor-size N|NxN", "Of the motor map.", read.size)]
SensorySize = Annotated[Any, option("--sensory-size N|NxN", "Of the sensory map.", read.size)]
MapName = Annotated[Text, option("--map NAME", MAP, read.one_of(choices.MAPS))]
TrainingRule = Annotated[choices.RuleWord, flag("--rule", "Training rule.")]
Epochs = Annotated[int | None, Option("--epochs", metavar="N", min=1, help=EPOCHS)]
Sigma = Annotated[Any, option("--sigma START:END", SIGMA, read.sigma)]
BodyKind = Annotated[choices.BodyWord, flag("--body", "none: maps and links alone.")]
VIEW = (
    "What the sensor measures: base is the robot's root frame; auto is rigid for lengths, "
    "homography for pixels, pinhole for pixels of an arm in space."
)
SensorView = Annotated[choices.ViewWord, flag("--view", VIEW)]

# logs
TimeOffset = Annotated[Any, option("--time-offset auto|S", "Of positions [s].", read.seconds)]
Columns = Annotated[Any, option("--columns x=U,y=V", "Columns of other names.", read.typed_columns)]
Unit = Annotated[Text, option("--unit m|mm|px|..", "Of the log (default m, or the model's).")]
Prismatic = Annotated[Any, option("--prismatic A,B", "Joints that slide.", read.names)]
LogDegrees = Annotated[bool | None, flag("--degrees/--radians", "Of the log (default: as before).")]
PhotoFile = Annotated[Text, option("--photo FILE", "Of the log's camera, to draw the map over.")]
NoPhoto = Annotated[bool, flag("--no-photo", "Keep no photo in the model and draw none.")]
Distances = Annotated[list[str] | None, option("--distance A,B=50mm", "Of touched points.")]
Planes = Annotated[list[str] | None, option("--plane A,B,C,D", "Touched points in a plane.")]

# queries and what else asks a model
ReadoutKind = Annotated[choices.ReadoutWord | None, flag("--readout", "Default local, or linear.")]
InFrame = Annotated[choices.FrameWord, flag("--in", "Of positions: sensor, or base [m].")]
PositionUnit = Annotated[Text, option("--unit m|mm|..", "Of positions (default the model's).")]
Input = Annotated[Text, option("--input FILE", "Answer every row of a CSV (- standard input).")]
Output = Annotated[Text, option("--output FILE", "CSV or Parquet (default standard output).")]
LogView = Annotated[choices.LogFrameWord, flag("--view", "base: the log is in the root frame.")]
WhatChanged = Annotated[choices.CauseWord | None, flag("--cause", "What changed, if known.")]
FrameOrJoints = Annotated[choices.CauseWord, flag("--cause", "Whose a turn is that both explain.")]

# what is printed for a camera
Dictionary = Annotated[str, option("--dictionary NAME", "Dictionary of the tags.")]
BOARD = (
    "A chessboard's squares: 10x7:22mm; ChArUco: 7x5:24mm:18mm:5x5_100; AprilTags: "
    "grid:6x6:88mm:26.4mm:t36h11."
)
LENS = "Default: fitted. Pictures of the board, calib's, ROS's or OpenCV's file, or a model."
BoardSpec = Annotated[Text, option("--board BOARD", BOARD)]


@dataclass(frozen=True, kw_only=True)
class Asking:
    """How a model is asked, one question or a table of them, as typed."""

    input_: Input = None
    columns: Columns = None
    output: Output = None
    unit: PositionUnit = None
    degrees: Degrees = False
