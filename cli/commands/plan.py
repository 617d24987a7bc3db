"""Plan poses to measure: within the limits, well spread, with short moves between them.

With the model of a log the plan is of poses that tell most beside it. With --handeye the board is
in the middle of the picture at --from, or where the model of `calib handeye -o` knows it.
Obstacles are not checked: move slowly the first time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Argument

import calib
from calib.common.choices import Eye
from calib.common.wording import by_name

from .. import options as opt
from .. import parsing
from ..logs import Selection
from ..output import Outcome, fields, say
from ..parsing import TABLES, BadOption, check_file, refuse
from ..units import JointFormat, in_si

if TYPE_CHECKING:
    from calib.arm.arm import Arm
    from calib.use.plan import Plan


def plan(
    robot: Annotated[
        str, Argument(metavar="ROBOT|MODEL", help="To measure, or to improve.")
    ],
    output: opt.NewTable,
    poses: Annotated[
        int,
        opt.value("--poses -n N", "How many poses.", parsing.whole(1, 1000)),
    ] = 60,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    degrees: opt.Degrees = False,
    margin: Annotated[
        float | None,
        opt.value(
            "--margin M",
            "Kept from joints' limits (1 deg).",
            parsing.not_negative,
        ),
    ] = None,
    start: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--from Q1,Q2", "Joints before the first pose.", parsing.reals
        ),
    ] = None,
    touch: Annotated[
        parsing.Numbers | None,
        opt.value(
            "--touch X,Y,Z", "A point of the base frame [m].", parsing.point
        ),
    ] = None,
    above: Annotated[
        float | None,
        opt.value(
            "--above Z",
            "Stay above this height of the base [m].",
            parsing.number,
        ),
    ] = None,
    handeye: Annotated[
        bool, opt.option("--handeye", "A camera sees --board in all poses.")
    ] = False,
    board: opt.BoardSpec = None,
    eye: Annotated[
        Eye | None, opt.option("--eye", "Of --handeye (default hand).")
    ] = None,
    seed: opt.Seed = 0,
) -> Outcome:
    is_model = robot.endswith(".calib")
    if not handeye or is_model:
        refuse(
            {"board": board, "eye": eye},
            "is for --handeye of ROBOT: a model knows its board",
        )
    elif board is None:
        raise BadOption(
            "--handeye needs --board, such as 7x5:24mm:18mm:5x5_100"
        )
    elif start is None:
        raise BadOption(
            "--handeye of ROBOT needs --from, joints at which the camera sees the board in the "
            "middle of its picture"
        )
    check_file(output, TABLES, stream=True)
    if handeye and is_model:
        from calib.recording.rig import is_rig

        if is_rig(robot):
            of_joints = {
                "joints": joints,
                "tip": tip,
                "lock": lock,
                "range": ranges,
                "margin": margin,
                "from": start,
                "touch": touch,
                "above": above,
            }
            refuse(of_joints, "is of joints: a rig has flange poses alone")
            return _flange_poses(robot, output, poses, seed)
    source: Arm | calib.Model
    within = None
    if is_model:
        of_robot = {
            "joints": joints,
            "tip": tip,
            "lock": lock,
            "planar": planar or None,
        }
        refuse(
            of_robot,
            "is for ROBOT: a model has its joints and its tip already",
        )
        source = calib.load(robot)
        about = source.about
        shown = JointFormat(about, degrees)
        # an arm was loaded with its ranges, which it may need where it states no limits
        revolute = by_name(shown.names, about.revolute)
        within = in_si("--range", ranges, revolute, degrees)
    else:
        selection = Selection(joints, tip, planar, lock, ranges, degrees)
        source = selection.load(robot)
        say(source.notes)
        shown = JointFormat(source, degrees)
    margins = None
    if margin is not None:
        margins = [margin / factor for factor in shown.to_typed]
    result = calib.plan(
        source,
        poses,
        seed=seed,
        margin=margins,
        ranges=within,
        start=shown.one_each("--from", start),
        touch=touch,
        handeye=board or handeye or None,
        eye=eye or "hand",
        above=above,
    )
    say(result.notes)
    return _joint_poses(result, output, shown, seed)


def _joint_poses(
    result: Plan, output: str, shown: JointFormat, seed: int
) -> Outcome:
    """Write the joint values of a plan."""
    from calib.samples.tables import write_table

    names = shown.names
    table = result.columns()
    table |= by_name(names, (result.q * shown.to_typed).T)
    write_table(output, table)
    travel = result.travel.tolist()
    document = {
        "output": output,
        "rows": len(result),
        "joints": result.joint_names,
        "seed": seed,
        "travel": by_name(names, travel),
        "poses": result.columns(),
        **fields(result, "start", "length", "unit", "why"),
        "units": {
            "joints": by_name(names, shown.about.units_of_joints),
            "positions": result.unit,
        },
    }
    unit = "deg" if shown.degrees else "rad"
    line = f"{output}: {len(result)} rows of {', '.join(table)} [{unit}, {result.unit}]"
    ways = ", ".join(shown.change(k, way) for k, way in enumerate(travel))
    return Outcome(document, [line, *result.why, f"joints travel {ways}"])


def _flange_poses(rig: str, output: str, count: int, seed: int) -> Outcome:
    """Write the flange poses that best determine what a rig left open."""
    import numpy as np

    from calib.arm.rotations import QUATERNION, quaternion_of
    from calib.recording.next_poses import next_poses
    from calib.recording.rig import load_rig
    from calib.samples.tables import write_table

    flange, intervals = next_poses(load_rig(rig), count, seed)
    numbers = np.column_stack(
        [flange[:, :3, 3], quaternion_of(flange[:, :3, :3])]
    )
    table = by_name(("x", "y", "z", *QUATERNION), numbers.T)
    write_table(output, table)
    document = {
        "output": output,
        "rows": count,
        "poses": table,
        "position_95": intervals,
        "seed": seed,
        "units": {"positions": "m"},
    }
    after = 1e3 * intervals[-1].max()
    return Outcome(
        document,
        [
            f"{output}: {count} flange poses with the board in view [m]; with pictures of them "
            f"what is in the hand is known to {after:.2g} mm"
        ],
    )
