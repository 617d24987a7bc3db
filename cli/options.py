"""Options that several commands share, always with the same name and meaning."""

from __future__ import annotations

from typing import Annotated

from calib.common.choices import (
    BODIES,
    CAUSES,
    FRAMES,
    LOG_FRAMES,
    MAPS,
    MOTIONS,
    READOUTS,
    RULES,
    VIEWS,
)

from . import parsing
from .parsing import Columns, JointRange, JointValue, Names, Numbers, Sigma, Size
from .usage import argument, choice, flag, option

RobotArgument = Annotated[str, argument("ROBOT", "A URDF file, or a bundled robot (calib robots).")]
ModelArgument = Annotated[str, argument("MODEL", "A model file, as written by calib train.")]

JointsOption = Annotated[
    Names | None,
    option(
        "--joints A,B",
        "Active joints; the others are locked. Found automatically where only one choice makes "
        "sense.",
        parsing.names,
    ),
]
TipOption = Annotated[str | None, option("--tip FRAME", "The frame whose position is sensed.")]
PlanarOption = Annotated[
    bool, flag("--planar", "Take the planar part of a robot that moves in space: positions x, y.")
]
LockOption = Annotated[
    list[JointValue] | None,
    option(
        "--lock JOINT=VALUE",
        "Hold another joint at this value [rad or m]; repeatable. Neutral if not given.",
        parsing.joint_value,
    ),
]
RangeOption = Annotated[
    list[JointRange] | None,
    option(
        "--range JOINT=LO:HI",
        "Use only this part of a joint's range [rad or m]; repeatable.",
        parsing.joint_range,
    ),
]

MapOption = Annotated[
    str | None,
    option(
        f"--map {'|'.join(MAPS)}",
        "Kind of map (default vdsom; for a log with --body none gas where held-out blocks prefer "
        "it); vdsom:error and the like name variants of the paper's rule.",
        parsing.kind_of_map(MAPS),
    ),
]
SizeOption = Annotated[
    Size | None,
    option(
        "--size N|NxN|NxNxN",
        "Nodes of both maps: 70 or 70x70 if not given, for three joints 17x17x17 in the "
        "motor map; a log chooses its own.",
        parsing.size,
    ),
]
MotorSizeOption = Annotated[
    Size | None,
    option("--motor-size N|NxN", "Nodes of the motor map, where they differ.", parsing.size),
]
SensorySizeOption = Annotated[
    Size | None,
    option("--sensory-size N|NxN", "Nodes of the sensory map, where they differ.", parsing.size),
]
BodyOption = Annotated[
    str,
    choice(
        "--body",
        BODIES,
        "auto fits a kinematic body under the maps; none learns maps and Hebbian links alone.",
    ),
]
SensorViewOption = Annotated[
    str,
    choice(
        "--view",
        VIEWS,
        "What the sensor measures: base is the robot's root frame; auto is rigid for "
        "lengths, homography for pixels, pinhole for pixels of an arm in space.",
    ),
]
RuleOption = Annotated[str, choice("--rule", RULES, "Training rule.")]
EpochsOption = Annotated[
    int | None,
    option(
        "--epochs N",
        "Passes over the samples; the full lattice alone is trained then.",
        parsing.whole(1),
    ),
]
SigmaOption = Annotated[
    Sigma | None,
    option(
        "--sigma START:END",
        "Neighbourhood radius at the start and the end [nodes]; the full lattice alone "
        "is trained then.",
        parsing.sigma,
    ),
]

SamplesOption = Annotated[
    int | None,
    option("--samples -n N", "How many samples to babble (default 20000).", parsing.whole(1)),
]
NoiseOption = Annotated[
    float | None,
    option(
        "--noise S",
        "Standard deviation of the simulated sensor along each axis [m] (default 0).",
        parsing.at_least_zero("m"),
    ),
]
MotionOption = Annotated[
    str | None, choice("--motion", MOTIONS, "How the simulated arm babbles (default uniform).")
]
ChangeOption = Annotated[
    list[str] | None,
    option(
        "--change JOINT.WHAT=VALUE",
        "Change the simulated arm or sensor, such as elbow.length=+20%, "
        "shoulder.offset=0.05, sensor.rotate=0.14 or sensor.mirror=x; repeatable.",
    ),
]
SeedOption = Annotated[int, option("--seed K", "Seed of the random numbers.", parsing.whole(0))]

DataOption = Annotated[
    str | None,
    option("--data LOG", "A measured log: CSV or Parquet with the joints' columns and x, y."),
]
NewLogOption = Annotated[
    str, option("--data LOG", "New samples: CSV or Parquet with the joints' columns and x, y.")
]
ColumnsOption = Annotated[
    Columns | None,
    option(
        "--columns x=U,y=V",
        "Columns of the log that have other names; an element of a Parquet list is tip[0].",
        parsing.columns,
    ),
]
UnitOption = Annotated[
    str | None,
    option("--unit m|mm|px|..", "Unit of the log's positions (default m, or that of the model)."),
]
CauseOption = Annotated[
    str | None,
    choice("--cause", CAUSES, "What changed, if known: the sensor, or the arm's joints and links."),
]
PrismaticOption = Annotated[
    Names | None,
    option("--prismatic A,B", "For a log without ROBOT: the joints that slide.", parsing.names),
]

ViewOption = Annotated[
    str,
    choice(
        "--view",
        LOG_FRAMES,
        "base: the log is in the robot's root frame; auto: the sensor's frame is free.",
    ),
]

BlameOption = Annotated[
    str,
    choice(
        "--cause",
        CAUSES,
        "What changed, if a turned sensor and an offset of the first joint look the same.",
    ),
]

ReadoutOption = Annotated[
    str | None,
    choice(
        "--readout",
        READOUTS,
        "Readout of the query (default local: body and local models; without a body linear: maps "
        "and Hebbian links alone).",
    ),
]
NearOption = Annotated[
    Numbers | None,
    option(
        "--near Q1,Q2", "Answer with the branch nearest to these joint values.", parsing.numbers
    ),
]
FrameOption = Annotated[
    str, choice("--in", FRAMES, "Frame of positions: what the sensor reads, or the arm's base [m].")
]
AllOption = Annotated[bool, flag("--all", "Answer with every branch.")]
InputOption = Annotated[
    str | None, option("--input FILE", "Answer every row of this CSV file (- for standard input).")
]
AnswersOption = Annotated[
    str | None,
    option("--output FILE", "Write the answers to this CSV file (default standard output)."),
]
DegreesOption = Annotated[
    bool, flag("--degrees", "Joint values are typed, read and printed in degrees (default rad).")
]
LogDegreesOption = Annotated[
    bool | None,
    flag(
        "--degrees/--radians",
        "Unit of the log's joint values (default: that of the log the model was made from).",
    ),
]
JsonOption = Annotated[bool, flag("--json", "One JSON document on standard output, in SI units.")]
