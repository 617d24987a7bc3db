"""The command `calib log`: turn a ROS bag, pictures or a video into a log."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import DICTIONARY
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import Shooting, is_picture, offset_or_auto, record
from ..files import TABLES, check_file
from ..measurements import refuse
from ..options import option
from ..output import Outcome, say
from ..parsing import BadOption


def log(
    bag: Annotated[
        str, Argument(metavar="BAG|PICTURES|VIDEO", help="A ROS bag, pictures (folder), a video.")
    ],
    *,
    output: Annotated[str, option("--output -o LOG", "The log: CSV or Parquet.")],
    joints_topic: Annotated[
        str | None, option("--joints-topic TOPIC", "Of JointState; found if there is one only.")
    ] = None,
    tip_topic: Annotated[
        str | None, option("--tip-topic TOPIC", "Of points, poses or tf; found if one only.")
    ] = None,
    frames: Annotated[
        Any, option("--frames SENSOR,TIP", "For tf; found if one transform moves.", parsing.names)
    ] = None,
    joints: opt.JointNames = None,
    max_gap: Annotated[
        float, option("--max-gap S", "Longest gap between joint states [s].", parsing.above_zero)
    ] = 0.1,
    still: Annotated[
        float | None,
        option("--still V", "Drop rows of faster joints [rad/s or m/s].", parsing.above_zero),
    ] = None,
    time_offset: Annotated[
        Any,
        option("--time-offset auto|S", "Added to times of positions [s].", offset_or_auto),
    ] = None,
    rests: Annotated[
        bool, Option("--rests", help="Of a video the median of each rest (the default).")
    ] = False,
    joints_file: Annotated[
        str | None,
        option("--joints-file FILE", "Joints of pictures (column picture) or a video (time)."),
    ] = None,
    tag: Annotated[
        int | None, Option("--tag", metavar="ID", min=0, help="Number of the tag on the tip.")
    ] = None,
    dictionary: opt.Dictionary = DICTIONARY,
    board: opt.BoardSpec = None,
    tags_at: Annotated[
        str | None, option("--tags-at FILE", "Tags on the desk: a table of tag, x, y [m].")
    ] = None,
    lens: Annotated[
        str | None, option("--lens SHOTS|lens.json", "Pictures of the board, or a lens of before.")
    ] = None,
    tag_size: Annotated[
        str | None, option("--tag-size 40mm", "Side of the tip's tag, for --pose.")
    ] = None,
    tag_height: Annotated[
        str | None, option("--tag-height 25mm", "Height of the tip's tag above the desk.")
    ] = None,
    pose: Annotated[
        bool, Option("--pose", help="Write z and the tag's quaternion too, for arms in space.")
    ] = False,
    since: Annotated[
        str | None, option("--since LOG", "An earlier log: how far has the camera moved since?")
    ] = None,
    picture: Annotated[
        str | None, option("--picture seen.png", "Draw the detections over a photo.")
    ] = None,
    camera: Annotated[
        str | None,
        option("--camera DEVICE", "Take pictures now, one for each line of joints on stdin."),
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
    check_file(output, TABLES, stream=True)
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
        from calib.recording.bags import read_bag

        if frames is not None and len(frames) != 2:
            raise BadOption("--frames names two frames: expected SENSOR,TIP")
        made = read_bag(bag, **bags, **shared, time_offset=time_offset)
        say(made.notes)
        kinds = "[rad, m, s]"
    made.write(output)
    names = made.joint_names
    units = {name: "m" if name in (prismatic or ()) else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), **made.about()}
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(made.columns())} {kinds}"
    return Outcome(document, [f"{output}: {line}"], to_stderr=output == "-")
