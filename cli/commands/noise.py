"""Print the noise of a log's sensor, and how well the arm returns to a pose.

They are told apart where poses were read several times in a row: such readings differ by the
sensor's noise alone, those of different visits by the arm's return too. No model is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from typer import Argument

from calib.common.wording import with_unit

from .. import options as opt
from ..logs import LogFormat, Selection, read_measured_log
from ..output import Outcome, say

if TYPE_CHECKING:
    from calib.samples.repeatability import Repeatability


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
    lines = list(_lines(result))
    counts = f"{result.repeats} further readings and {result.returns} returns"
    if result.left_out:
        counts += f", without {result.left_out} that contradict others,"
    lines.append(f"from {counts} to {result.poses} poses")
    return Outcome(document, lines)


def _lines(result: Repeatability) -> Iterator[str]:
    """Report how far readings repeat: the sensor's share and the arm's, or both together."""

    def size(deviation: float, interval: tuple[float, float]) -> str:
        low, high = (with_unit(end, result.unit) for end in interval)
        sd = with_unit(deviation, result.unit)
        return f"{sd} along an axis ({low} to {high})"

    if math.isfinite(result.together) and not math.isfinite(result.sensor):
        both = size(result.together, result.together_interval)
        yield f"sensor and arm together repeat to: {both}"
        most = with_unit(result.arm_interval[1], result.unit)
        yield (
            "they are not told apart by this log, which read no pose twice in a row: each is "
            f"between 0 and {most}"
        )
        return
    yield f"the sensor reads to: {size(result.sensor, result.sensor_interval)}"
    arm = "not told by this log, which returned to no pose"
    if math.isfinite(result.arm):
        arm = size(result.arm, result.arm_interval)
    yield f"the arm returns to: {arm}"
