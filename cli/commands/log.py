"""The command `calib log`: turn a ROS bag, pictures or a video into a log."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument

from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import Shooting, is_picture
from ..options import Text, option
from ..output import Outcome, say
from ..parsing import TABLES, BadOption, above_zero, check_file
from ..samples import refuse


def log(
    bag: Annotated[
        list[str],
        Argument(
            metavar="BAG|PICTURES|VIDEO|DATASET",
            help="A ROS bag, a folder or files, a video; with --eye a LeRobotDataset.",
        ),
    ],
    *,
    output: Annotated[str, option("--output -o LOG", "The log: CSV or Parquet.")],
    joints_topic: Annotated[Text, option("--joints-topic TOPIC", "JointState, if several.")] = None,
    tip_topic: Annotated[Text, option("--tip-topic TOPIC", "Points, poses, tf if several.")] = None,
    frames: Annotated[Any, option("--frames SENSOR,TIP", "Of tf, if many.", parsing.names)] = None,
    joints: opt.JointNames = None,
    max_gap: Annotated[float, option("--max-gap S", "Between joint states [s].", above_zero)] = 0.1,
    still: Annotated[
        Any, option("--still V", "Drop rows that move faster [rad/s].", above_zero)
    ] = None,
    time_offset: opt.TimeOffset = None,
    shooting: Shooting,
    degrees: opt.Degrees = False,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    from calib.samples.logs import write_log
    from calib.samples.roles import log_columns

    check_file(output, TABLES, stream=True)
    bags: dict[str, Any] = {"joints_topic": joints_topic, "tip_topic": tip_topic, "frames": frames}
    timed: dict[str, Any] = {"max_gap": max_gap, "still": still, "time_offset": time_offset}
    if shooting.given() or any(map(is_picture, bag)):
        refuse(bags, "is for bags, not for pictures and videos")
        made = shooting.record(bag, output, joints, degrees, prismatic or (), **timed)
        factor, shown = for_people(made.unit)
        kinds = f"[rad, {made.unit}]"
        noise = factor * float(made.source["noise"])
        kinds += f", noise {noise:.2g} {shown}" if noise else ""
    else:
        from calib.recording.bags import read_bag

        if len(bag) > 1:
            raise BadOption(f"{len(bag)} names are for pictures: expected one bag")
        if frames is not None and len(frames) != 2:
            raise BadOption("--frames names two frames: expected SENSOR,TIP")
        made = read_bag(bag[0], **bags, **timed, joints=joints)
        say(made.notes)
        kinds = "[rad, m, s]"
    write_log(made, output)
    names = made.joint_names
    units = {name: "m" if name in (prismatic or ()) else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), "unit": made.unit}
    document |= made.source
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(log_columns(made))} {kinds}"
    return Outcome(document, [f"{output}: {line}"])
