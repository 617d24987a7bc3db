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
        help="Active joints; the others are locked. Found where only one choice makes sense.",
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
        help="Babble and learn only this part of a joint's range [rad or m]; repeatable.",
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
        help="auto fits a kinematic model under the maps, none learns from maps and links alone.",
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
        help="Alter the simulated arm or sensor, such as elbow.length=+20%, "
        "shoulder.offset=0.05, sensor.rotate=0.14 or sensor.mirror=x; repeatable.",
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed",
        parser=parsing.whole("--seed", 0),
        metavar="K",
        help="Seed of all that is random.",
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
        help="Other names of the log's columns; of Parquet lists one element: x=tip[0],y=tip[1].",
    ),
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", metavar="m|mm|px|..", help="Unit of the log's positions (default m)."),
]
CauseOption = Annotated[
    str | None,
    typer.Option(
        "--cause",
        parser=parsing.one_of("--cause", CAUSES),
        metavar="|".join(CAUSES),
        help="What is known of a change: the sensor's, or the arm's joints and links.",
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
        help="What changed, where a turned sensor and the first joint's offset look the same.",
    ),
]

ReadoutOption = Annotated[
    str | None,
    typer.Option(
        "--readout",
        parser=parsing.one_of("--readout", READOUTS),
        metavar="|".join(READOUTS),
        help="How the query is answered (default local, the body and its local models; of a "
        "model without a body linear, maps and links alone).",
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
        "--input", metavar="FILE", help="Many queries at once, a CSV file (- standard input)."
    ),
]
AnswersOption = Annotated[
    str | None,
    typer.Option(
        "--output", metavar="FILE", help="Where their answers go, as CSV (default standard output)."
    ),
]
DegreesOption = Annotated[
    bool,
    typer.Option("--degrees", help="Joint values are in degrees as typed, read and printed."),
]
LogDegreesOption = Annotated[
    bool | None,
    typer.Option(
        "--degrees/--radians",
        help="Unit of the log's joint values; as in the model's own log if not given.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="One JSON document on standard output, in SI units.")
]
