"""The command `calib plan`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from calib.common.choices import EYES, Eye

from .. import options as opt
from ..output import Outcome, fields, say
from ..parsing import TABLES, BadOption, check_file, not_negative, number, reals, whole
from ..samples import Compared, Logged, Selection, log_for, refuse
from ..samples import measured_samples as measured
from ..units import JointFormat, in_si

if TYPE_CHECKING:
    from calib import Model
    from calib.arm.arm import Arm


def plan(
    robot: Annotated[
        str, Argument(metavar="ROBOT|MODEL", help="To measure, or to improve.")
    ],
    output: Annotated[
        str,
        Option(
            "--output",
            "-o",
            metavar="FILE",
            help="CSV, or Parquet by its name (- stdout).",
        ),
    ],
    poses: Annotated[
        int,
        Option(
            "--poses", "-n", metavar="N", parser=whole(1, 1000), help="How many poses."
        ),
    ] = 60,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    degrees: opt.Degrees = False,
    margin: Annotated[
        Any,
        Option(
            "--margin", metavar="M", parser=not_negative, help="From limits (1 deg)."
        ),
    ] = None,
    start: Annotated[
        Any,
        Option(
            "--from",
            metavar="Q1,Q2",
            parser=reals,
            help="Joints before the first pose.",
        ),
    ] = None,
    data: opt.Data = None,
    columns: opt.Columns = None,
    touch: Annotated[
        Any,
        Option(
            "--touch",
            metavar="X,Y,Z",
            parser=reals,
            help="A point of the base frame [m].",
        ),
    ] = None,
    above: Annotated[
        float | None,
        Option(
            "--above",
            metavar="Z",
            parser=number,
            help="Stay above this height of the base [m].",
        ),
    ] = None,
    handeye: Annotated[
        bool, Option("--handeye", help="A camera sees --board in all poses.")
    ] = False,
    board: opt.BoardSpec = None,
    eye: Annotated[
        Eye | None, opt.word("--eye", EYES, "Of --handeye (default hand).")
    ] = None,
    seed: opt.Seed = 0,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Plan poses to measure: within the limits, well spread, with short moves between them.

    With --data the plan covers what that log has not measured. With --handeye the board is in the
    middle of the picture at --from, or where the model of `calib handeye -o` knows it. Obstacles
    are not checked: move slowly the first time.
    """
    selection = Selection(
        joints=joints, tip=tip, planar=planar, lock=lock, ranges=ranges, degrees=degrees
    )
    is_model = robot.endswith(".calib")
    of_robot = ("joints", "tip", "lock")
    if not handeye or is_model:
        refuse(
            {"board": board, "eye": eye},
            "is for --handeye of ROBOT: a model knows its board",
        )
    elif board is None:
        raise BadOption("--handeye needs --board, such as 7x5:24mm:18mm:5x5_100")
    check_file(output, TABLES, stream=True)
    if data is None:
        refuse({"columns": columns}, "applies to a log: expected --data LOG too")
    import calib
    from calib.samples.tables import write_table

    arm_or_model: Arm | Model
    rows = None
    within = None
    if is_model:
        why = "is for ROBOT: a model has its joints and its tip already"
        refuse({name: getattr(selection, name) for name in of_robot}, why)
        arm_or_model = calib.load(robot)
        facts: Any = arm_or_model.about
        if data is not None:
            reading = Compared(columns=columns, degrees=degrees or None)
            rows = log_for(arm_or_model, data, reading)
        # an arm was loaded with its ranges, which it may need where it states no limits
        turning = dict(zip(facts.joint_names, facts.revolute, strict=True))
        within = in_si("--range", selection.ranges, turning, degrees)
    else:
        arm_or_model = facts = selection.load(robot)
        say(arm_or_model.notes)
        if data is not None:
            rows = measured(robot, selection, data, Logged(columns=columns))
    shown = JointFormat(facts, degrees)
    pose_plan = calib.plan(
        arm_or_model,
        poses,
        seed=seed,
        margin=None if margin is None else [margin / factor for factor in shown.typed],
        ranges=within,
        start=shown.one_each("--from", start),
        measured=rows,
        touch=touch,
        handeye=board or (True if handeye else None),
        eye=eye or "hand",
        above=above,
    )
    say(pose_plan.notes)
    names = shown.names
    kinds = facts.units_of_joints
    table = pose_plan.columns()
    table |= dict(zip(names, (pose_plan.q * shown.typed).T, strict=True))
    write_table(output, table)
    document = {
        "output": output,
        "rows": len(pose_plan),
        "joints": pose_plan.joint_names,
        "seed": seed,
        "travel": dict(zip(names, pose_plan.travel.tolist(), strict=True)),
        "poses": pose_plan.columns(),
        **fields(pose_plan, "start length random_length unit why"),
        "units": {
            "joints": dict(zip(names, kinds, strict=True)),
            "positions": pose_plan.unit,
        },
    }
    unit = "deg" if degrees else "rad"
    line = f"{output}: {len(pose_plan)} rows of {', '.join(table)} [{unit}, {pose_plan.unit}]"
    ways = ", ".join(
        shown.change(k, way) for k, way in enumerate(pose_plan.travel.tolist())
    )
    return Outcome(document, [line, *pose_plan.why, f"joints travel {ways}"])
