"""The command `calib plan`: plan poses to measure: well spread, within the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from calib.common.choices import Eye

from .. import options as opt
from ..options import flag, option
from ..output import Outcome, fields, say
from ..parsing import TABLES, BadOption, check_file, not_negative, reals
from ..samples import Compared, Logged, Selection, log_for, measured_samples, refuse
from ..units import JointFormat, in_si

if TYPE_CHECKING:
    from calib import Model
    from calib.arm.arm import Arm


def plan(
    robot: Annotated[str, Argument(metavar="ROBOT|MODEL", help="To measure, or to improve.")],
    *,
    output: Annotated[str, option("--output -o FILE", "CSV, or Parquet by its name (- stdout).")],
    poses: Annotated[int, option("--poses -n N", "How many poses.", min=1, max=1000)] = 60,
    selection: Selection,
    margin: Annotated[Any, option("--margin M", "From limits (1 deg).", not_negative)] = None,
    start: Annotated[Any, option("--from Q1,Q2", "Joints before the first pose.", reals)] = None,
    data: opt.Data = None,
    columns: opt.Columns = None,
    touch: Annotated[Any, option("--touch X,Y,Z", "A point of the base frame [m].", reals)] = None,
    handeye: Annotated[bool, flag("--handeye", "A camera sees --board in all poses.")] = False,
    board: opt.BoardSpec = None,
    eye: Annotated[Eye | None, flag("--eye", "Of --handeye (default hand).")] = None,
    seed: opt.Seed = 0,
) -> Outcome:
    """Plan poses to measure: within the limits, well spread, with short moves between them.

    With --data the plan covers what that log has not measured. With --handeye the board is in the
    middle of the picture at --from, or where the model of `calib handeye -o` knows it. Obstacles
    are not checked: move slowly the first time.
    """
    is_model, degrees = robot.endswith(".calib"), selection.degrees
    of_robot = ("joints", "tip", "lock")
    if not handeye or is_model:
        refuse({"board": board, "eye": eye}, "is for --handeye of ROBOT: a model knows its board")
    elif board is None:
        raise BadOption("--handeye needs --board, such as 7x5:24mm:18mm:5x5_100")
    check_file(output, TABLES, stream=True)
    if data is None:
        refuse({"columns": columns}, "applies to a log: expected --data LOG too")
    import calib
    from calib.samples.tables import write_table

    known: Arm | Model
    measured = ranges = None
    if is_model:
        why = "is for ROBOT: a model has its joints and its tip already"
        refuse({name: getattr(selection, name) for name in of_robot}, why)
        known = calib.load(robot)
        facts: Any = known.about
        if data is not None:
            reading = Compared(columns=columns, degrees=degrees or None)
            measured = log_for(known, data, reading)
        # an arm was loaded with its ranges, which it may need where it states no limits
        turning = dict(zip(facts.joint_names, facts.revolute, strict=True))
        ranges = in_si("--range", selection.ranges, turning, degrees)
    else:
        known = facts = selection.load(robot)
        say(known.notes)
        if data is not None:
            measured = measured_samples(robot, selection, data, Logged(columns=columns))
    joints = JointFormat(facts, degrees)
    found = calib.plan(
        known,
        poses,
        seed=seed,
        margin=None if margin is None else [margin / factor for factor in joints.typed],
        ranges=ranges,
        start=joints.one_each("--from", start),
        measured=measured,
        touch=touch,
        handeye=board or (True if handeye else None),
        eye=eye or "hand",
    )
    say(found.notes)
    names, kinds, table = joints.names, facts.units_of_joints, found.columns()
    table |= dict(zip(names, (found.q * joints.typed).T, strict=True))
    write_table(output, table)
    document = {
        "output": output,
        "rows": len(found),
        "joints": found.joint_names,
        "seed": seed,
        "travel": dict(zip(names, found.travel.tolist(), strict=True)),
        "poses": found.columns(),
        **fields(found, "start length random_length unit why"),
        "units": {"joints": dict(zip(names, kinds, strict=True)), "positions": found.unit},
    }
    units = "deg" if degrees else "rad"
    line = f"{output}: {len(found)} rows of {', '.join(table)} [{units}, {found.unit}]"
    ways = ", ".join(joints.change(k, way) for k, way in enumerate(found.travel.tolist()))
    return Outcome(document, [line, *found.why, f"joints travel {ways}"])
