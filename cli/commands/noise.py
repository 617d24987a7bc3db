"""Print the noise of a log's sensor, and how well the arm returns to a pose.

They are told apart where poses were measured again: readings that follow each other while the
arm stands are the sensor's, visits to one pose the arm's. No model is needed.
"""

from __future__ import annotations

import math
from typing import Annotated

from typer import Argument

from .. import options as opt
from ..logs import Reading, Selection, measured
from ..output import Outcome, say, sized


def noise(
    log: Annotated[
        str,
        Argument(
            metavar="LOG",
            help="CSV or Parquet with the joints' columns and x, y.",
        ),
    ],
    robot: Annotated[
        str | None, opt.value("--robot", "ROBOT", "Whose joints they are.")
    ] = None,
    joints: opt.JointNames = None,
    degrees: opt.Degrees = False,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    from calib.samples.repeatability import repeatability
    from calib.samples.tables import open_source

    source = open_source(log)  # once: it may be a pipe
    if robot is None and joints is None:
        from calib.recording.joint_table import joint_columns

        joints = joint_columns(source.header)
        names = ", ".join(joints)
        say([f"joints are the columns {names}; --joints names others"])
    selection = Selection(joints, degrees=degrees)
    reading = Reading(columns, unit, prismatic=prismatic)
    result = repeatability(measured(robot, selection, source, reading))
    positions = result.unit
    document = {
        "log": log,
        **result.to_json(),
        "units": {"positions": positions},
    }
    lines = []
    for what, deviation, interval, remedy in (
        (
            "the sensor reads to",
            result.sensor,
            result.sensor_interval,
            "read each pose several times while the arm stands",
        ),
        (
            "the arm returns to",
            result.arm,
            result.arm_interval,
            "leave the poses and come back",
        ),
    ):
        if math.isfinite(deviation):
            low, high = (sized(end, positions) for end in interval)
            size = sized(deviation, positions)
            lines.append(f"{what} {size} along an axis ({low} to {high})")
        else:
            lines.append(f"{what}: not told by this log; {remedy}")
    lines.append(
        f"from {result.repeats} further readings and {result.returns} returns to {result.poses} "
        "poses"
    )
    return Outcome(document, lines)
