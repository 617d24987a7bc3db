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
        say(
            [
                f"joints are the columns {', '.join(joints)}; --joints names others"
            ]
        )
    selection = Selection(joints, degrees=degrees)
    reading = Reading(columns, unit, prismatic=prismatic)
    result = repeatability(measured(robot, selection, source, reading))
    positions = result.unit
    document = {
        "log": log,
        **result.to_json(),
        "units": {"positions": positions},
    }
    sensor = (
        "the sensor reads to: not told by this log; read each pose several times while the arm "
        "stands"
    )
    if math.isfinite(result.sensor):
        size = _interval(result.sensor, result.sensor_interval, positions)
        sensor = f"the sensor reads to {size}"
    arm = "the arm returns to: not told by this log; leave the poses and come back"
    if math.isfinite(result.arm):
        size = _interval(result.arm, result.arm_interval, positions)
        arm = f"the arm returns to {size}"
    rows = (
        f"from {result.repeats} further readings and {result.returns} returns to {result.poses} "
        "poses"
    )
    return Outcome(document, [sensor, arm, rows])


def _interval(
    deviation: float, interval: tuple[float, float], unit: str
) -> str:
    low, high = (sized(end, unit) for end in interval)
    return f"{sized(deviation, unit)} along an axis ({low} to {high})"
