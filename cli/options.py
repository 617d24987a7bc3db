"""Options: what several commands take, with the same name and meaning in each.

An annotation of Typer each: a command names those that it takes. What is typed in a form of its
own is read by a reader, and is Any to Typer.
"""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import Body, Cause, Frame, LogFrame, Motion, Readout, Rule, View

from . import parsing
from .parsing import JointRange, JointValue, Reader


def option(usage: str, help: str, read: Reader[Any] | None = None) -> Any:  # noqa: A002
    """Declare an option of a value as a usage line has it, such as "--output -o FILE"."""
    *flags, metavar = usage.split()
    return Option(*flags, metavar=metavar, parser=read, help=help)


# files that commands work on
Model = Annotated[str, Argument(metavar="MODEL", help="The file of a learned model.")]
Robot = Annotated[str, Argument(metavar="ROBOT", help="A URDF file or a bundled robot.")]
Data = Annotated[
    str | None,
    option("--data LOG", "A measured log: CSV or Parquet with the joints' columns and x, y."),
]
NewLog = Annotated[
    str, option("--data LOG", "New samples: CSV or Parquet with the joints' columns and x, y.")
]

# what is babbled or sensed
Joints = Annotated[
    Any,
    option(
        "--joints A,B",
        "Active joints; the others are locked. Found automatically where only one choice makes "
        "sense.",
        parsing.names,
    ),
]
Tip = Annotated[str | None, option("--tip FRAME", "The frame whose position is sensed.")]
Planar = Annotated[
    bool,
    Option("--planar", help="Take the planar part of a robot that moves in space: positions x, y."),
]
Lock = Annotated[
    list[JointValue] | None,
    option(
        "--lock JOINT=VALUE",
        "Hold another joint at this value [rad or m]; repeatable. Neutral if not given.",
        parsing.joint_value,
    ),
]
Ranges = Annotated[
    list[JointRange] | None,
    option(
        "--range JOINT=LO:HI",
        "Use only this part of a joint's range [rad or m]; repeatable.",
        parsing.joint_range,
    ),
]
Degrees = Annotated[
    bool,
    Option("--degrees", help="Joint values are typed, read and printed in degrees (default rad)."),
]

# simulated babbling
Number = Annotated[
    int | None,
    Option(
        "--samples", "-n", metavar="N", min=1, help="How many samples to babble (default 20000)."
    ),
]
Noise = Annotated[
    float | None,
    Option(
        "--noise",
        metavar="S",
        min=0,
        help="Standard deviation of the simulated sensor along each axis [m] (default 0).",
    ),
]
Moves = Annotated[
    Motion | None, Option("--motion", help="How the simulated arm babbles (default uniform).")
]
Changes = Annotated[
    list[str] | None,
    option(
        "--change JOINT.WHAT=VALUE",
        "Change the simulated arm or sensor, such as elbow.length=+20%, "
        "shoulder.offset=0.05, sensor.rotate=0.14 or sensor.mirror=x; repeatable.",
    ),
]
Seed = Annotated[int, Option("--seed", metavar="K", min=0, help="Seed of the random numbers.")]

# training
SIZE = (
    "Nodes of both maps: 70 or 70x70 if not given, for three joints 17x17x17 in the motor map; a "
    "log chooses its own."
)
MAP = (
    "Kind of map: vdsom, som, dsom or gng (default vdsom; for a log with --body none gas where "
    "held-out blocks prefer it); vdsom:error and the like name variants of the paper's rule."
)
EPOCHS = "Passes over the samples; the full lattice alone is trained then."
SIGMA = (
    "Neighbourhood radius at the start and the end [nodes]; the full lattice alone is trained then."
)
Size = Annotated[Any, option("--size N|NxN|NxNxN", SIZE, parsing.size)]
MotorSize = Annotated[
    Any,
    option("--motor-size N|NxN", "Nodes of the motor map, where they differ.", parsing.size),
]
SensorySize = Annotated[
    Any,
    option("--sensory-size N|NxN", "Nodes of the sensory map, where they differ.", parsing.size),
]
Map = Annotated[str | None, option("--map KIND", MAP, parsing.kind_of_map)]
TrainingRule = Annotated[Rule, Option("--rule", help="Training rule.")]
Epochs = Annotated[int | None, Option("--epochs", metavar="N", min=1, help=EPOCHS)]
Sigma = Annotated[Any, option("--sigma START:END", SIGMA, parsing.sigma)]
BodyKind = Annotated[
    Body,
    Option(
        "--body",
        help="auto fits a kinematic body under the maps; none learns maps and Hebbian links alone.",
    ),
]
ViewKind = Annotated[
    View,
    Option(
        "--view",
        help="What the sensor measures: base is the robot's root frame; auto is rigid for "
        "lengths, homography for pixels, pinhole for pixels of an arm in space.",
    ),
]

# logs
Columns = Annotated[
    Any,
    option(
        "--columns x=U,y=V",
        "Columns that have other names; an element of a Parquet list is tip[0].",
        parsing.typed_columns,
    ),
]
Unit = Annotated[
    str | None,
    option("--unit m|mm|px|..", "Unit of the log's positions (default m, or that of the model)."),
]
Prismatic = Annotated[
    Any, option("--prismatic A,B", "For a log without ROBOT: the joints that slide.", parsing.names)
]
LogDegrees = Annotated[
    bool | None,
    Option(
        "--degrees/--radians",
        help="Unit of the log's joint values (default: that of the log the model was made from).",
    ),
]
Photo = Annotated[
    str | None,
    option(
        "--photo FILE",
        "A picture, or a video, by the camera that made the log: the map is drawn over it.",
    ),
]
NoPhoto = Annotated[bool, Option("--no-photo", help="Keep no photo in the model and draw none.")]

# queries and what else asks a model
ReadoutKind = Annotated[
    Readout | None,
    Option(
        "--readout",
        help="Readout of the query (default local: body and local models; without a body linear: "
        "maps and Hebbian links alone).",
    ),
]
InFrame = Annotated[
    Frame,
    Option("--in", help="Frame of positions: what the sensor reads, or the arm's base [m]."),
]
PositionUnit = Annotated[
    str | None,
    option(
        "--unit m|mm|..",
        "Unit of positions that are typed, read and printed (default: typed in the model's unit, "
        "printed in mm where that is m).",
    ),
]
Input = Annotated[
    str | None,
    option("--input FILE", "Answer every row of this CSV file (- for standard input)."),
]
Output = Annotated[
    str | None,
    option("--output FILE", "Write the answers to this CSV file (default standard output)."),
]
LogView = Annotated[
    LogFrame,
    Option(
        "--view",
        help="base: the log is in the robot's root frame; auto: the sensor's frame is free.",
    ),
]
WhatChanged = Annotated[
    Cause | None,
    Option("--cause", help="What changed, if known: the sensor, or the arm's joints and links."),
]
FrameOrJoints = Annotated[
    Cause,
    Option(
        "--cause",
        help="What changed, if a turned sensor and an offset of the first joint look the same.",
    ),
]

# what is printed for a camera
Dictionary = Annotated[str, option("--dictionary NAME", "Dictionary of the tags.")]
Board = Annotated[
    str | None,
    option(
        "--board COLSxROWS:SQUARE:MARKER:DICT", "A ChArUco board, such as 7x5:24mm:18mm:5x5_100."
    ),
]
