"""The command `calib log`."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import options as o
from .. import parsing
from ..output import Notes, show_json, tell


def _above_zero(option: str) -> object:
    def parse(typed: object) -> float:
        value = parsing.at_least_zero(option, "s")(typed)
        if value == 0.0:
            raise parsing.bad_option(option, str(typed), "a number above zero")
        return value

    return parse


def _seconds(typed: object) -> float:
    try:
        return parsing.finite(str(typed).strip())
    except ValueError:
        raise parsing.bad_option("--time-offset", str(typed), "a number of seconds") from None


def log(
    bag: Annotated[
        str,
        typer.Argument(
            metavar="BAG", help="A ROS 1 .bag, the folder of a ROS 2 bag, or an .mcap file."
        ),
    ],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="LOG", help="The log: CSV or Parquet.")
    ],
    joints_topic: Annotated[
        str | None,
        typer.Option("--joints-topic", metavar="TOPIC", help="JointState; found if only one."),
    ] = None,
    tip_topic: Annotated[
        str | None,
        typer.Option(
            "--tip-topic",
            metavar="TOPIC",
            help="PointStamped, PoseStamped or TransformStamped; found if only one.",
        ),
    ] = None,
    joints: o.JointsOption = None,
    max_gap: Annotated[
        float,
        typer.Option(
            "--max-gap",
            parser=_above_zero("--max-gap"),
            metavar="S",
            help="Leave out positions between joint states further apart [s].",
        ),
    ] = 0.1,
    still: Annotated[
        float | None,
        typer.Option(
            "--still",
            parser=_above_zero("--still"),
            metavar="SPEED",
            help="Leave out positions taken while a joint moved faster [rad/s or m/s].",
        ),
    ] = None,
    time_offset: Annotated[
        float,
        typer.Option(
            "--time-offset",
            parser=_seconds,
            metavar="S",
            help="Added to the times of the positions: clock difference or latency [s].",
        ),
    ] = 0.0,
    as_json: o.JsonOption = False,
) -> None:
    """Turn a ROS bag or an MCAP file into a log of joints and positions."""
    from calib.samples.bags import read_bag
    from calib.samples.tables import write_table

    recording = read_bag(
        bag,
        joints_topic,
        tip_topic,
        joints=list(joints) if joints else None,
        max_gap=max_gap,
        still=still,
        time_offset=time_offset,
    )
    Notes().say(recording.notes)
    columns = {name: recording.q[:, k] for k, name in enumerate(recording.joint_names)}
    columns |= {axis: recording.x[:, k] for k, axis in enumerate("xyz")}
    write_table(output, {**columns, "time": recording.time})
    if as_json:
        show_json({"log": output, "joints": recording.joint_names, "samples": len(recording.q)})
    elif output != "-":
        names = ", ".join(recording.joint_names)
        tell(f"{output}: {len(recording.q)} rows of {names}, x, y, z, time [rad, m, s]")
