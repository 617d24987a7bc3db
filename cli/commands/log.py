"""Turn a ROS bag, pictures or a video into a log of joints and positions.

Exit code 3 if no clock offset, or more than one, fits a video to its joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

from typer import Argument

from calib.common.choices import DICTIONARY
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..output import Outcome, say
from ..parsing import TABLES, BadOption, above_zero, check_file, refuse
from ..pictures import (
    is_film,
    is_of_camera,
    read_tag_scene,
    record_board,
    with_seen_picture,
)

if TYPE_CHECKING:
    from calib.recording.motion_tables import JointTable
    from calib.recording.tag_scene import TagScene
    from calib.samples.samples import Samples


def log(
    bag: Annotated[
        list[str],
        Argument(
            metavar="BAG|PICTURES|VIDEO|DATASET",
            help="A ROS bag, a folder or files, a video; with --eye a LeRobotDataset.",
        ),
    ],
    output: Annotated[
        str, opt.value("--output -o LOG", "The log: CSV or Parquet.")
    ],
    joints_topic: Annotated[
        str | None,
        opt.value(
            "--joints-topic TOPIC", "Joint states, if there are several."
        ),
    ] = None,
    tip_topic: Annotated[
        str | None,
        opt.value(
            "--tip-topic TOPIC",
            "The tip's positions or poses, if there are several.",
        ),
    ] = None,
    frames: Annotated[
        Sequence[str] | None,
        opt.value(
            "--frames SENSOR,TIP",
            "Frames of tf, if there are several.",
            parsing.frames,
        ),
    ] = None,
    joints: opt.JointNames = None,
    max_gap: Annotated[
        float,
        opt.value(
            "--max-gap S", "Longest gap between joint states [s].", above_zero
        ),
    ] = 0.1,
    still: Annotated[
        float | None,
        opt.value(
            "--still V", "Drop rows that move faster [rad/s].", above_zero
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
    picture: opt.SeenPicture = None,
    camera: opt.DatasetCamera = None,
    eye: opt.Eye = None,
    degrees: opt.Degrees = False,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    from calib.recording.motion_tables import read_joints
    from calib.samples.logs import write_log

    check_file(output, TABLES, stream=True)
    sliding = prismatic or ()
    of_tag = {
        "tag": tag,
        "tags_at": tags_at,
        "tag_size": tag_size,
        "tag_height": tag_height,
        "picture": picture,
    }
    of_pictures = (*of_tag.values(), joints_file, board, lens, camera, eye)
    is_bag = not any(map(is_of_camera, bag)) and all(
        option is None for option in of_pictures
    )
    table = None
    if not is_bag:
        of_bags = {
            "joints_topic": joints_topic,
            "tip_topic": tip_topic,
            "frames": frames,
        }
        _check_pictures(
            bag, eye, of_bags, {"still": still, "time_offset": time_offset}
        )
    if joints_file is not None:
        table = read_joints(
            joints_file, joints, degrees=degrees, prismatic=sliding
        )
    if is_bag:
        from calib.recording.bags import read_bag

        if len(bag) > 1:
            raise BadOption(
                f"{len(bag)} names are for pictures: expected one bag"
            )
        rows = read_bag(
            bag[0],
            joints_topic=joints_topic,
            tip_topic=tip_topic,
            frames=frames,
            joints=joints,
            max_gap=max_gap,
            still=still,
            time_offset=time_offset,
        )
        say(rows.notes)
    elif eye is not None:
        refuse(of_tag, "is of logs of a tag, --eye of a board")
        rows = record_board(bag[0], table, joints, board, eye, lens, camera)
    else:
        scene = read_tag_scene(
            output,
            tag=tag,
            dictionary=dictionary,
            board=board,
            tags_at=tags_at,
            lens=lens,
            tag_size=tag_size,
            tag_height=tag_height,
        )
        rows = _tag_log(bag, table, scene, time_offset, still, max_gap)
        rows = with_seen_picture(rows, bag, output, scene, picture)
    write_log(rows, output)
    units = "[rad, m, s]"
    if not is_bag:
        units = f"[rad, {rows.unit}]{_noise(rows)}"
    return _outcome(rows, output, sliding, units)


def _check_pictures(
    names: Sequence[str],
    eye: str | None,
    of_bags: Mapping[str, object],
    of_videos: Mapping[str, object],
) -> None:
    """Refuse options of bags, of a video where pictures are named, and several videos."""
    refuse(of_bags, "is for bags, not for pictures and videos")
    if not is_film(names):
        refuse(of_videos, "is for videos and bags, not pictures")
    if len(names) > 1 and (is_film(names) or eye is not None):
        raise BadOption(
            f"{len(names)} names: expected one video or dataset, or pictures"
        )


def _tag_log(
    names: Sequence[str],
    joints: JointTable | None,
    scene: TagScene,
    time_offset: float | None,
    still: float | None,
    max_gap: float,
) -> Samples:
    """Make a log of a video or of pictures of a tag."""
    from calib.recording.tag_logs import log_pictures, log_video

    if joints is None:
        raise BadOption(
            "--joints-file FILE is missing: pictures and videos need it"
        )
    if is_film(names):
        rows = log_video(
            names[0],
            joints,
            scene,
            time_offset=time_offset,
            still=still,
            max_gap=max_gap,
        )
    else:
        rows = log_pictures(names, joints, scene)
    say(rows.notes)
    return rows


def _outcome(
    rows: Samples, path: str, sliding: Sequence[str], units: str
) -> Outcome:
    """Report a log that was written to a file."""
    from calib.samples.roles import log_columns

    names = rows.joint_names
    document = {
        "log": path,
        "joints": names,
        "samples": len(rows),
        "unit": rows.unit,
        **rows.source,
        "units": {
            "joints": {
                name: "m" if name in sliding else "rad" for name in names
            },
            "positions": rows.unit,
            "time": "s",
        },
    }
    columns = ", ".join(log_columns(rows))
    return Outcome(document, [f"{path}: {len(rows)} rows of {columns} {units}"])


def _noise(rows: Samples) -> str:
    """The noise of pictures, in words; none where they show none."""
    factor, unit = for_people(rows.unit)
    noise = factor * float(rows.source["noise"])
    return f", noise {noise:.2g} {unit}" if noise else ""
