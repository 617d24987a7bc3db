"""The command `calib log`."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import DICTIONARY
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import Shooting
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
    output: Annotated[
        str, Option("--output", "-o", metavar="LOG", help="The log: CSV or Parquet.")
    ],
    joints_topic: Annotated[
        str | None,
        Option("--joints-topic", metavar="TOPIC", help="JointState, if several."),
    ] = None,
    tip_topic: Annotated[
        str | None,
        Option("--tip-topic", metavar="TOPIC", help="Points, poses, tf if several."),
    ] = None,
    frames: Annotated[
        Any,
        Option(
            "--frames",
            metavar="SENSOR,TIP",
            parser=parsing.names,
            help="Of tf, if many.",
        ),
    ] = None,
    joints: opt.JointNames = None,
    max_gap: Annotated[
        float,
        Option(
            "--max-gap",
            metavar="S",
            parser=above_zero,
            help="Between joint states [s].",
        ),
    ] = 0.1,
    still: Annotated[
        Any,
        Option(
            "--still",
            metavar="V",
            parser=above_zero,
            help="Drop rows that move faster [rad/s].",
        ),
    ] = None,
    time_offset: opt.TimeOffset = None,
    joints_file: opt.JointsFile = None,
    tag: opt.TagNumber = None,
    dictionary: opt.Dictionary = DICTIONARY,
    board: opt.BoardSpec = None,
    tags_at: opt.TagTable = None,
    lens: opt.LensFile = None,
    tag_size: opt.TagSize = None,
    tag_height: opt.TagHeight = None,
    pose: opt.WholePose = False,
    picture: opt.SeenPicture = None,
    camera: opt.DatasetCamera = None,
    eye: opt.Eye = None,
    degrees: opt.Degrees = False,
    prismatic: opt.Prismatic = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    shooting = Shooting(
        joints_file=joints_file,
        tag=tag,
        dictionary=dictionary,
        board=board,
        tags_at=tags_at,
        lens=lens,
        tag_size=tag_size,
        tag_height=tag_height,
        pose=pose,
        picture=picture,
        camera=camera,
        eye=eye,
    )
    from calib.samples.logs import write_log
    from calib.samples.roles import log_columns

    check_file(output, TABLES, stream=True)
    slides = prismatic or ()
    bags: dict[str, Any] = {
        "joints_topic": joints_topic,
        "tip_topic": tip_topic,
        "frames": frames,
    }
    timed: dict[str, Any] = {
        "max_gap": max_gap,
        "still": still,
        "time_offset": time_offset,
    }
    if shooting.taken(bag):
        refuse(bags, "is for bags, not for pictures and videos")
        made = shooting.record(
            bag, output, joints, timed, degrees=degrees, prismatic=slides
        )
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
    units = {name: "m" if name in slides else "rad" for name in names}
    document = {"log": output, "joints": names, "samples": len(made), "unit": made.unit}
    document |= made.source
    document["units"] = {"joints": units, "positions": made.unit, "time": "s"}
    line = f"{len(made)} rows of {', '.join(log_columns(made))} {kinds}"
    return Outcome(document, [f"{output}: {line}"])
