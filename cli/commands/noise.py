"""Print the noise of a log's sensor, and how well the arm returns to a pose.

They are told apart where poses were measured again: readings that follow each other while the
arm stands are the sensor's, visits to one pose the arm's. No model is needed.
"""

import math
from typing import Annotated

from typer import Argument

from calib.common.wording import with_unit

from .. import options as opt
from ..logs import LogFormat, Selection, read_measured_log
from ..output import Outcome, say


def noise(
    log: Annotated[
        str,
        Argument(
            metavar="LOG",
            help="CSV or Parquet with the joints' columns and x, y.",
        ),
    ],
    robot: Annotated[
        str | None, opt.value("--robot ROBOT", "Whose joints they are.")
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
        from calib.recording.motion_tables import joint_columns

        joints = joint_columns(source.header) or None
        if joints is not None:
            names = ", ".join(joints)
            say([f"joints are the columns {names}; --joints names others"])
    selection = Selection(joints, degrees=degrees)
    log_format = LogFormat(columns, unit, prismatic=prismatic)
    result = repeatability(
        read_measured_log(robot, selection, source, log_format)
    )
    unit = result.unit
    document = {"log": log, **result.to_json(), "units": {"positions": unit}}
    lines = []
    for what, deviation, interval in (
        ("the sensor reads to", result.sensor, result.sensor_interval),
        ("the arm returns to", result.arm, result.arm_interval),
    ):
        low, high = (with_unit(end, unit) for end in interval)
        size = f"{with_unit(deviation, unit)} along an axis ({low} to {high})"
        if not math.isfinite(deviation):
            size = "not told by this log, which measured no pose again"
        lines.append(f"{what}: {size}")
    counts = f"{result.repeats} further readings and {result.returns} returns"
    if result.left_out:
        counts += f", without {result.left_out} that contradict others,"
    lines.append(f"from {counts} to {result.poses} poses")
    return Outcome(document, lines)
