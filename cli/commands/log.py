"""The command `calib log`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from .. import camera as c
from .. import options as o
from .. import parsing
from ..output import Notes, note, show_json, tell
from ..parsing import Names
from ..units import for_people

NO = 3


def _above_zero(option: str) -> object:
    def parse(typed: object) -> float:
        value = parsing.at_least_zero(option, "s")(typed)
        if value == 0.0:
            raise parsing.bad_option(option, str(typed), "a number above zero")
        return value

    return parse


def log(
    bag: Annotated[
        str,
        typer.Argument(
            metavar="BAG|PICTURES|VIDEO",
            help="A ROS 1 .bag, the folder of a ROS 2 bag or an .mcap file; a folder or pattern of "
            "pictures; a video.",
        ),
    ],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="LOG", help="The log: CSV or Parquet.")
    ],
    joints_topic: Annotated[
        str | None,
        typer.Option(
            "--joints-topic",
            metavar="TOPIC",
            help="Topic of the JointState messages; found if there is one only.",
        ),
    ] = None,
    tip_topic: Annotated[
        str | None,
        typer.Option(
            "--tip-topic",
            metavar="TOPIC",
            help="Topic of the positions (PointStamped, PoseStamped, TransformStamped or tf); "
            "found if there is one only.",
        ),
    ] = None,
    frames: Annotated[
        Names | None,
        typer.Option(
            "--frames",
            parser=parsing.names("--frames"),
            metavar="SENSOR,TIP",
            help="For tf: frames of the sensor and of the tip; found if one transform only moves.",
        ),
    ] = None,
    joints: o.JointsOption = None,
    max_gap: Annotated[
        float,
        typer.Option(
            "--max-gap",
            parser=_above_zero("--max-gap"),
            metavar="S",
            help="Drop positions between joint states that are further apart than this [s].",
        ),
    ] = 0.1,
    still: Annotated[
        float | None,
        typer.Option(
            "--still",
            parser=_above_zero("--still"),
            metavar="SPEED",
            help="Drop positions taken while a joint moved faster than this [rad/s or m/s].",
        ),
    ] = None,
    time_offset: Annotated[
        str,
        typer.Option(
            "--time-offset",
            parser=c.offset_or_auto,
            metavar="auto|S",
            help="Added to the times of the positions [s]; auto finds it for a video and is 0 "
            "for a bag.",
        ),
    ] = "auto",
    rests: Annotated[
        bool,
        typer.Option("--rests", help="For a video, take the median of each rest (the default)."),
    ] = False,
    joints_file: Annotated[
        str | None,
        typer.Option(
            "--joints-file",
            metavar="FILE",
            help="Joint values of the pictures (column picture, or in their order) or of the "
            "video (column time).",
        ),
    ] = None,
    tag: Annotated[
        int | None,
        typer.Option(
            "--tag",
            parser=parsing.whole("--tag", 0),
            metavar="ID",
            help="Number of the tag on the tip.",
        ),
    ] = None,
    dictionary: c.DictionaryOption = c.DICTIONARY,
    board: c.BoardOption = None,
    tags_at: Annotated[
        str | None,
        typer.Option(
            "--tags-at", metavar="FILE", help="Tags on the desk: a table of tag, x, y [m]."
        ),
    ] = None,
    lens: Annotated[
        str | None,
        typer.Option(
            "--lens",
            metavar="SHOTS|lens.json",
            help="Pictures of the board that calibrate the camera, or the lens.json of an "
            "earlier run.",
        ),
    ] = None,
    tag_size: Annotated[
        str | None,
        typer.Option("--tag-size", metavar="40mm", help="Side of the tip's tag, for --pose."),
    ] = None,
    tag_height: Annotated[
        str | None,
        typer.Option(
            "--tag-height",
            metavar="25mm",
            help="Height of the tip's tag above the board or the tags.",
        ),
    ] = None,
    pose: Annotated[
        bool,
        typer.Option("--pose", help="Write z and qx, qy, qz, qw of the tag too, for spatial arms."),
    ] = False,
    since: Annotated[
        str | None,
        typer.Option(
            "--since", metavar="LOG", help="An earlier log; prints how far the camera moved since."
        ),
    ] = None,
    picture: Annotated[
        str | None,
        typer.Option("--picture", metavar="seen.png", help="Draw the detections over a photo."),
    ] = None,
    degrees: o.DegreesOption = False,
    prismatic: o.PrismaticOption = None,
    as_json: o.JsonOption = False,
) -> None:
    """Turn a ROS bag, pictures or a video into a log of joints and positions.

    Exit code 3 if no clock offset, or more than one, fits a video to its joints.
    """
    notes = Notes()
    shooting = c.Shooting(
        joints_file,
        tag,
        dictionary,
        board,
        tags_at,
        tag_size,
        tag_height,
        lens,
        pose,
        since,
        picture,
    )
    if shooting or c.is_camera(bag):
        of_bags = {"--joints-topic": joints_topic, "--tip-topic": tip_topic, "--frames": frames}
        for option, value in of_bags.items():
            if value is not None:
                raise parsing.BadOption(f"{option} is for bags, not for pictures and videos")
        if rests and still is not None:
            raise parsing.BadOption("--rests and --still are given: expected one of them")
        _from_camera(
            bag,
            output,
            shooting,
            as_json,
            joints=joints,
            degrees=degrees,
            prismatic=prismatic or (),
            time_offset=time_offset,
            still=still,
            max_gap=max_gap,
            notes=notes,
        )
    else:
        if frames is not None and len(frames) != 2:
            raise parsing.BadOption("--frames names two frames: expected SENSOR,TIP")
        read = {
            "joints_topic": joints_topic,
            "tip_topic": tip_topic,
            "joints": list(joints) if joints else None,
            "max_gap": max_gap,
            "still": still,
            "time_offset": 0.0 if time_offset == "auto" else float(time_offset),
            "frames": frames,
        }
        _from_bag(bag, output, as_json, **read)


def _from_camera(
    source: str, output: str, shooting: c.Shooting, as_json: bool, **options: Any
) -> None:
    from calib.common.atomic import check_writable
    from calib.recording.clocks import ClockError

    if output != "-":
        check_writable(output)
    try:
        made = c.record(source, output, shooting, **options)
    except ClockError as error:
        from ..app import describe_error

        told = describe_error(error)
        if as_json:
            show_json({"error": told.to_json()})
        note(told.line)
        raise typer.Exit(NO) from None
    made.write(output)
    if as_json:
        counted = {"log": output, "joints": made.joint_names, "samples": len(made)}
        show_json({**counted, **made.about(), "units": _units(made.joint_names, made.unit)})
    elif output != "-":
        factor, unit = for_people(made.unit)
        tell(
            f"{output}: {len(made)} rows of {', '.join(made.columns())} [rad, {made.unit}], noise "
            f"{factor * made.noise:.2g} {unit}"
        )


def _from_bag(bag: str, output: str, as_json: bool, **options: Any) -> None:
    from calib.samples.bags import read_bag
    from calib.samples.orientations import QUATERNION
    from calib.samples.tables import write_table

    recording = read_bag(bag, **options)
    Notes().say(recording.notes)
    columns = {name: recording.q[:, k] for k, name in enumerate(recording.joint_names)}
    columns |= {axis: recording.x[:, k] for k, axis in enumerate("xyz")}
    turns = recording.quaternion
    columns |= {} if turns is None else dict(zip(QUATERNION, turns.T, strict=True))
    write_table(output, {**columns, "time": recording.time})
    if as_json:
        counted = {"log": output, "joints": recording.joint_names, "samples": len(recording.q)}
        show_json({**counted, "units": _units(recording.joint_names, "m")})
    elif output != "-":
        tell(f"{output}: {len(recording.q)} rows of {', '.join(columns)}, time [rad, m, s]")


def _units(joints: Sequence[str], unit: str) -> dict[str, object]:
    """Units of the numbers of a log."""
    return {"joints": dict.fromkeys(joints, "rad"), "positions": unit, "time": "s"}
