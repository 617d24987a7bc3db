"""Options that several commands share, always with the same name and meaning."""

from __future__ import annotations

from typing import Annotated

import typer

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

RobotArgument = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A URDF file, or a bundled robot (calib robots).")
]
ModelArgument = Annotated[
    str, typer.Argument(metavar="MODEL", help="A model file, as written by calib train.")
]

JointsOption = Annotated[
    Names | None,
    typer.Option(
        "--joints",
        parser=parsing.names("--joints"),
        metavar="A,B",
        help="Active joints; the others are locked. Found automatically where only one choice "
        "makes sense.",
    ),
]
TipOption = Annotated[
    str | None,
    typer.Option("--tip", metavar="FRAME", help="The frame whose position is sensed."),
]
PlanarOption = Annotated[
    bool,
    typer.Option(
        "--planar", help="Take the planar part of a robot that moves in space: positions x, y."
    ),
]
LockOption = Annotated[
    list[JointValue] | None,
    typer.Option(
        "--lock",
        parser=parsing.joint_value,
        metavar="JOINT=VALUE",
        help="Hold another joint at this value [rad or m]; repeatable. Neutral if not given.",
    ),
]
RangeOption = Annotated[
    list[JointRange] | None,
    typer.Option(
        "--range",
        parser=parsing.joint_range,
        metavar="JOINT=LO:HI",
        help="Use only this part of a joint's range [rad or m]; repeatable.",
    ),
]

MapOption = Annotated[
    str,
    typer.Option(
        "--map",
        parser=parsing.kind_of_map(MAPS),
        metavar="|".join(MAPS),
        help="Kind of map; vdsom:error and the like name a reading of the paper's rule.",
    ),
]
SizeOption = Annotated[
    Size | None,
    typer.Option(
        "--size",
        parser=parsing.size("--size"),
        metavar="N|NxN|NxNxN",
        help="Nodes of both maps: 70 or 70x70 if not given, for three joints 17x17x17 in the "
        "motor map; a log chooses its own.",
    ),
]
MotorSizeOption = Annotated[
    Size | None,
    typer.Option(
        "--motor-size",
        parser=parsing.size("--motor-size"),
        metavar="N|NxN",
        help="Nodes of the motor map, where they differ.",
    ),
]
SensorySizeOption = Annotated[
    Size | None,
    typer.Option(
        "--sensory-size",
        parser=parsing.size("--sensory-size"),
        metavar="N|NxN",
        help="Nodes of the sensory map, where they differ.",
    ),
]
BodyOption = Annotated[
    str,
    typer.Option(
        "--body",
        parser=parsing.one_of("--body", BODIES),
        metavar="|".join(BODIES),
        help="auto fits a kinematic body under the maps; none learns maps and Hebbian links alone.",
    ),
]
SensorViewOption = Annotated[
    str,
    typer.Option(
        "--view",
        parser=parsing.one_of("--view", VIEWS),
        metavar="|".join(VIEWS),
        help="What the sensor measures: base is the robot's root frame; auto is rigid for "
        "lengths, homography for pixels, pinhole for pixels of an arm in space.",
    ),
]
RuleOption = Annotated[
    str,
    typer.Option(
        "--rule",
        parser=parsing.one_of("--rule", RULES),
        metavar="|".join(RULES),
        help="Training rule.",
    ),
]
EpochsOption = Annotated[
    int | None,
    typer.Option(
        "--epochs",
        parser=parsing.whole("--epochs", 1),
        metavar="N",
        help="Passes over the samples; the full lattice alone is trained then.",
    ),
]
SigmaOption = Annotated[
    Sigma | None,
    typer.Option(
        "--sigma",
        parser=parsing.sigma,
        metavar="START:END",
        help="Neighbourhood radius at the start and the end [nodes]; the full lattice alone "
        "is trained then.",
    ),
]

SamplesOption = Annotated[
    int | None,
    typer.Option(
        "--samples",
        "-n",
        parser=parsing.whole("--samples", 1),
        metavar="N",
        help="How many samples to babble (default 20000).",
    ),
]
NoiseOption = Annotated[
    float | None,
    typer.Option(
        "--noise",
        parser=parsing.at_least_zero("--noise", "m"),
        metavar="S",
        help="Standard deviation of the simulated sensor along each axis [m] (default 0).",
    ),
]
MotionOption = Annotated[
    str | None,
    typer.Option(
        "--motion",
        parser=parsing.one_of("--motion", MOTIONS),
        metavar="|".join(MOTIONS),
        help="How the simulated arm babbles (default uniform).",
    ),
]
ChangeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--change",
        metavar="JOINT.WHAT=VALUE",
        help="Change the simulated arm or sensor, such as elbow.length=+20%, "
        "shoulder.offset=0.05, sensor.rotate=0.14 or sensor.mirror=x; repeatable.",
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed",
        parser=parsing.whole("--seed", 0),
        metavar="K",
        help="Seed of the random numbers.",
    ),
]

DataOption = Annotated[
    str | None,
    typer.Option(
        "--data",
        metavar="LOG",
        help="A measured log: CSV or Parquet with the joints' columns and x, y.",
    ),
]
ColumnsOption = Annotated[
    Columns | None,
    typer.Option(
        "--columns",
        parser=parsing.columns,
        metavar="x=U,y=V",
        help="Columns of the log that have other names; an element of a Parquet list is tip[0].",
    ),
]
UnitOption = Annotated[
    str | None,
    typer.Option(
        "--unit",
        metavar="m|mm|px|..",
        help="Unit of the log's positions (default m, or that of the model).",
    ),
]
CauseOption = Annotated[
    str | None,
    typer.Option(
        "--cause",
        parser=parsing.one_of("--cause", CAUSES),
        metavar="|".join(CAUSES),
        help="What changed, if known: the sensor, or the arm's joints and links.",
    ),
]
PrismaticOption = Annotated[
    Names | None,
    typer.Option(
        "--prismatic",
        parser=parsing.names("--prismatic"),
        metavar="A,B",
        help="For a log without ROBOT: the joints that slide.",
    ),
]

ViewOption = Annotated[
    str,
    typer.Option(
        "--view",
        parser=parsing.one_of("--view", LOG_FRAMES),
        metavar="|".join(LOG_FRAMES),
        help="base: the log is in the robot's root frame; auto: the sensor's frame is free.",
    ),
]

BlameOption = Annotated[
    str,
    typer.Option(
        "--cause",
        parser=parsing.one_of("--cause", CAUSES),
        metavar="|".join(CAUSES),
        help="What changed, if a turned sensor and an offset of the first joint look the same.",
    ),
]

ReadoutOption = Annotated[
    str | None,
    typer.Option(
        "--readout",
        parser=parsing.one_of("--readout", READOUTS),
        metavar="|".join(READOUTS),
        help="Readout of the query (default local: body and local models; without a body linear: "
        "maps and Hebbian links alone).",
    ),
]
NearOption = Annotated[
    Numbers | None,
    typer.Option(
        "--near",
        parser=parsing.numbers("--near"),
        metavar="Q1,Q2",
        help="Answer with the branch nearest to these joint values.",
    ),
]
FrameOption = Annotated[
    str,
    typer.Option(
        "--in",
        parser=parsing.one_of("--in", FRAMES),
        metavar="|".join(FRAMES),
        help="Frame of positions: what the sensor reads, or the arm's base [m].",
    ),
]
AllOption = Annotated[bool, typer.Option("--all", help="Answer with every branch.")]
InputOption = Annotated[
    str | None,
    typer.Option(
        "--input", metavar="FILE", help="Answer every row of this CSV file (- for standard input)."
    ),
]
AnswersOption = Annotated[
    str | None,
    typer.Option(
        "--output",
        metavar="FILE",
        help="Write the answers to this CSV file (default standard output).",
    ),
]
DegreesOption = Annotated[
    bool,
    typer.Option(
        "--degrees", help="Joint values are typed, read and printed in degrees (default rad)."
    ),
]
LogDegreesOption = Annotated[
    bool | None,
    typer.Option(
        "--degrees/--radians",
        help="Unit of the log's joint values (default: that of the log the model was made from).",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="One JSON document on standard output, in SI units.")
]
