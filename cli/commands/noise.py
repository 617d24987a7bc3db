"""The command `calib noise`."""

from __future__ import annotations

import math
from typing import Annotated

from typer import Argument, Option

from .. import options as opt
from ..output import Outcome, say, sized
from ..samples import Logged, Selection, measured_samples


def noise(
    log: Annotated[
        str,
        Argument(
            metavar="LOG", help="CSV or Parquet with the joints' columns and x, y."
        ),
    ],
    robot: Annotated[
        str | None, Option("--robot", metavar="ROBOT", help="Whose joints they are.")
    ] = None,
    joints: opt.JointNames = None,
    degrees: opt.Degrees = False,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    prismatic: opt.Prismatic = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Print the noise of a log's sensor, and how well the arm returns to a pose.

    They are told apart where poses were measured again: readings that follow each other while the
    arm stands are the sensor's, visits to one pose the arm's. No model is needed.
    """
    from calib.samples.repeatability import repeatability
    from calib.samples.tables import open_source

    source = open_source(log)  # once: it may be a pipe
    names = joints
    if robot is None and joints is None:
        from calib.recording.joint_table import joint_columns

        names = joint_columns(source.header)
        say([f"joints are the columns {', '.join(names)}; --joints names others"])
    selection = Selection(joints=names, degrees=degrees)
    logged = Logged(columns=columns, unit=unit, prismatic=prismatic)
    samples = measured_samples(robot, selection, source, logged)
    result = repeatability(samples)
    document = {"log": log, **result.to_json()}
    document["units"] = {"positions": result.unit}
    lines = [
        _line(
            "the sensor reads to", result.sensor, result.sensor_interval, result.unit
        ),
        _line("the arm returns to", result.arm, result.arm_interval, result.unit),
        f"from {result.repeats} further readings and {result.returns} returns to {result.poses} "
        "poses",
    ]
    return Outcome(document, lines)


def _line(what: str, deviation: float, interval: tuple[float, float], unit: str) -> str:
    if not math.isfinite(deviation):
        missing = {
            "the sensor reads to": "read each pose several times while the arm stands",
            "the arm returns to": "leave the poses and come back",
        }
        return f"{what}: not told by this log; {missing[what]}"
    low, high = (sized(end, unit) for end in interval)
    return f"{what} {sized(deviation, unit)} along an axis ({low} to {high})"
