"""The command `calib log`: turn a ROS bag, pictures or a video into a log."""

from __future__ import annotations

from typing import Any

from calib.common.wording import for_people

from .. import parsing
from ..camera import Shooting, is_picture, offset_or_auto, record
from ..options import takes
from ..output import Notes, conclude
from ..parsing import Names
from ..usage import BadOption, argument, flag, option, refuse


@takes(
    bag=argument(
        "BAG|PICTURES|VIDEO",
        "A ROS 1 .bag, the folder of a ROS 2 bag or an .mcap file; a folder or pattern of "
        "pictures; a video.",
    ),
    output=option("--output -o LOG", "The log: CSV or Parquet."),
    joints_topic=option(
        "--joints-topic TOPIC", "Topic of the JointState messages; found if there is one only."
    ),
    tip_topic=option(
        "--tip-topic TOPIC",
        "Topic of the positions (PointStamped, PoseStamped, TransformStamped or tf); found "
        "if there is one only.",
    ),
    frames=option(
        "--frames SENSOR,TIP",
        "For tf: frames of the sensor and of the tip; found if one transform only moves.",
        parsing.names,
    ),
    max_gap=option(
        "--max-gap S",
        "Drop positions between joint states that are further apart than this [s].",
        parsing.above_zero("s"),
    ),
    still=option(
        "--still SPEED",
        "Drop positions taken while a joint moved faster than this [rad/s or m/s].",
        parsing.above_zero("rad/s or m/s"),
    ),
    time_offset=option(
        "--time-offset auto|S",
        "Added to the times of the positions [s]; auto finds it from the motion (default auto).",
        offset_or_auto,
    ),
    rests=flag("--rests", "For a video, take the median of each rest (the default)."),
)
def log(
    *,
    bag: str,
    output: str,
    joints_topic: str | None = None,
    tip_topic: str | None = None,
    frames: Names | None = None,
    joints: Names | None = None,
    max_gap: float = 0.1,
    still: float | None = None,
    time_offset: float | None = None,
    rests: bool = False,
    shooting: Shooting,
    degrees: bool = False,
    prismatic: Names | None = None,
    as_json: bool = False,
) -> None:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    bags: dict[str, Any] = {"joints_topic": joints_topic, "tip_topic": tip_topic, "frames": frames}
    shared: dict[str, Any] = {"joints": joints, "max_gap": max_gap, "still": still}
    notes = Notes()
    if shooting.given() or is_picture(bag):
        from calib.common.atomic import check_writable

        refuse(bags, "is for bags, not for pictures and videos")
        if rests and still is not None:
            raise BadOption("--rests and --still are given: expected one of them")
        if output != "-":
            check_writable(output)
        shared |= {"degrees": degrees, "prismatic": prismatic or (), "time_offset": time_offset}
        made = record(bag, output, shooting, **shared, notes=notes)
        factor, shown = for_people(made.unit)
        kinds = f"[rad, {made.unit}], noise {factor * made.noise:.2g} {shown}"
    else:
        from calib.recording.bags import read_bag

        if frames is not None and len(frames) != 2:
            raise BadOption("--frames names two frames: expected SENSOR,TIP")
        made = read_bag(bag, **bags, **shared, time_offset=time_offset)
        notes.say(made.notes)
        kinds = "[rad, m, s]"
    made.write(output)
    names = made.joint_names
    units = {name: "m" if name in (prismatic or ()) else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), **made.about()}
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(made.columns())} {kinds}"
    conclude(output, line, (), document if as_json else None)
