"""The command `calib log`: turn a ROS bag, pictures or a video into a log."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import DICTIONARY
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import Shooting, is_picture, offset_or_auto, record
from ..files import TABLES, check_output
from ..measurements import refuse
from ..output import Outcome, say
from ..parsing import BadOption


def log(
    bag: Annotated[
        str,
        Argument(
            metavar="BAG|PICTURES|VIDEO",
            help="A ROS 1 .bag, the folder of a ROS 2 bag or an .mcap file; a folder or pattern of "
            "pictures; a video.",
        ),
    ],
    *,
    output: Annotated[str, opt.option("--output -o LOG", "The log: CSV or Parquet.")],
    joints_topic: Annotated[
        str | None,
        opt.option(
            "--joints-topic TOPIC", "Topic of the JointState messages; found if there is one only."
        ),
    ] = None,
    tip_topic: Annotated[
        str | None,
        opt.option(
            "--tip-topic TOPIC",
            "Topic of the positions (PointStamped, PoseStamped, TransformStamped or tf); found "
            "if there is one only.",
        ),
    ] = None,
    frames: Annotated[
        Any,
        opt.option(
            "--frames SENSOR,TIP",
            "For tf: frames of the sensor and of the tip; found if one transform only moves.",
            parsing.names,
        ),
    ] = None,
    joints: opt.Joints = None,
    max_gap: Annotated[
        float,
        opt.option(
            "--max-gap S",
            "Drop positions between joint states that are further apart than this [s].",
            parsing.above_zero,
        ),
    ] = 0.1,
    still: Annotated[
        float | None,
        opt.option(
            "--still SPEED",
            "Drop positions taken while a joint moved faster than this [rad/s or m/s].",
            parsing.above_zero,
        ),
    ] = None,
    time_offset: Annotated[
        Any,
        opt.option(
            "--time-offset auto|S",
            "Added to the times of the positions [s]; auto finds it for a video and is 0 for a bag "
            "(default auto).",
            offset_or_auto,
        ),
    ] = None,
    rests: Annotated[
        bool, Option("--rests", help="For a video, take the median of each rest (the default).")
    ] = False,
    joints_file: Annotated[
        str | None,
        opt.option(
            "--joints-file FILE",
            "Joint values of the pictures (column picture, or in their order) or of the video "
            "(column time).",
        ),
    ] = None,
    tag: Annotated[
        int | None, Option("--tag", metavar="ID", min=0, help="Number of the tag on the tip.")
    ] = None,
    dictionary: opt.Dictionary = DICTIONARY,
    board: opt.Board = None,
    tags_at: Annotated[
        str | None, opt.option("--tags-at FILE", "Tags on the desk: a table of tag, x, y [m].")
    ] = None,
    lens: Annotated[
        str | None,
        opt.option(
            "--lens SHOTS|lens.json",
            "Pictures of the board that calibrate the camera, or the lens.json of an earlier run.",
        ),
    ] = None,
    tag_size: Annotated[
        str | None, opt.option("--tag-size 40mm", "Side of the tip's tag, for --pose.")
    ] = None,
    tag_height: Annotated[
        str | None,
        opt.option("--tag-height 25mm", "Height of the tip's tag above the board or the tags."),
    ] = None,
    pose: Annotated[
        bool,
        Option("--pose", help="Write z and qx, qy, qz, qw of the tag too, for spatial arms."),
    ] = False,
    since: Annotated[
        str | None,
        opt.option("--since LOG", "An earlier log; prints how far the camera moved since."),
    ] = None,
    picture: Annotated[
        str | None, opt.option("--picture seen.png", "Draw the detections over a photo.")
    ] = None,
    camera: Annotated[
        str | None,
        opt.option(
            "--camera DEVICE",
            "Take the pictures now, into PICTURES: one for each line of joints on standard input, "
            "below a line with their names.",
        ),
    ] = None,
    degrees: opt.Degrees = False,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    shooting = Shooting(
        joints_file, tag, dictionary, board, tags_at, lens, tag_size, tag_height, pose, since,
        picture, camera,
    )  # fmt: skip
    check_output(output, TABLES, stream=True)
    bags: dict[str, Any] = {"joints_topic": joints_topic, "tip_topic": tip_topic, "frames": frames}
    shared: dict[str, Any] = {"joints": joints, "max_gap": max_gap, "still": still}
    if shooting.given() or is_picture(bag):
        refuse(bags, "is for bags, not for pictures and videos")
        if rests and still is not None:
            raise BadOption("--rests and --still are given: expected one of them")
        shared |= {"degrees": degrees, "prismatic": prismatic or (), "time_offset": time_offset}
        made = record(bag, output, shooting, **shared)
        factor, shown = for_people(made.unit)
        kinds = f"[rad, {made.unit}], noise {factor * made.noise:.2g} {shown}"
    else:
        from calib.samples.bags import read_bag

        if frames is not None and len(frames) != 2:
            raise BadOption("--frames names two frames: expected SENSOR,TIP")
        made = read_bag(bag, **bags, **shared, time_offset=time_offset or 0.0)
        say(made.notes)
        kinds = "[rad, m, s]"
    made.write(output)
    names = made.joint_names
    units = {name: "m" if name in (prismatic or ()) else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), **made.about()}
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(made.columns())} {kinds}"
    return Outcome(document, [f"{output}: {line}"], to_stderr=output == "-")
