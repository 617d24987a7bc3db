"""The command `calib plan`: plan poses to measure: well spread, within the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from calib.common.choices import Eye
from calib.common.wording import unit_of_joint

from .. import options as opt
from ..measurements import Reading, log_for, refuse
from ..options import flag, option
from ..output import Outcome, fields, say
from ..parsing import TABLES, BadOption, check_file, not_negative, reals
from ..samples import Selection
from ..units import JointFormat, in_si

if TYPE_CHECKING:
    from calib import Model, Samples
    from calib.arm.arm import Arm


def plan(
    robot: Annotated[str, Argument(metavar="ROBOT|MODEL", help="To measure, or to improve.")],
    *,
    output: Annotated[str, option("--output -o FILE", "CSV, or Parquet by its name (- stdout).")],
    poses: Annotated[
        int, Option("--poses", "-n", metavar="N", min=1, max=1000, help="How many poses.")
    ] = 60,
    selection: Selection,
    margin: Annotated[
        Any, option("--margin M", "From limits [rad, m] (1 deg).", not_negative)
    ] = None,
    start: Annotated[Any, option("--from Q1,Q2", "Joints before the first pose.", reals)] = None,
    data: opt.Data = None,
    columns: opt.Columns = None,
    touch: Annotated[Any, option("--touch X,Y,Z", "A point of the base frame [m].", reals)] = None,
    handeye: Annotated[bool, option("--handeye", "A camera sees --board in all poses.")] = False,
    board: opt.BoardSpec = None,
    eye: Annotated[Eye | None, flag("--eye", "Of --handeye (default hand).")] = None,
    seed: opt.Seed = 0,
) -> Outcome:
    """Plan poses to measure: within the limits, well spread, with short moves between them.

    With --data the plan covers what that log has not measured. With --handeye the board is in the
    middle of the picture at --from, or where the model of `calib handeye -o` knows it. Obstacles
    are not checked: move slowly the first time.
    """
    is_model = robot.endswith(".calib")
    of_board = {"board": board, "eye": eye}
    if not handeye:
        refuse(of_board, "applies to a camera and a board: expected --handeye too")
    elif is_model:
        refuse(of_board, "is for ROBOT: a model knows its board")
    elif board is None:
        raise BadOption("--handeye needs --board, such as 7x5:24mm:18mm:5x5_100")
    check_file(output, TABLES, stream=True)
    if data is None:
        refuse({"columns": columns}, "applies to a log: expected --data LOG too")
    import calib
    from calib.samples.tables import write_table

    known: Arm | Model
    if is_model:
        refuse(
            {name: getattr(selection, name) for name in ("joints", "tip", "lock")},
            "is for ROBOT: a model has its joints and its tip already",
        )
        known = calib.load(robot)
    else:
        known = selection.load(robot)
    say(getattr(known, "notes", ()))  # an arm's
    degrees = selection.degrees
    facts: Any = getattr(known, "about", known)  # what tells the joints and their ranges
    joints_typed = JointFormat(facts, degrees)
    names, typed, kinds = joints_typed.names, joints_typed.typed, facts.units_of_joints
    turning = dict(zip(names, facts.revolute, strict=True))
    found = calib.plan(
        known,
        poses,
        seed=seed,
        margin=None if margin is None else [margin / factor for factor in typed],
        # an arm was loaded with them, which it may need where it states no limits
        ranges=in_si("--range", selection.ranges, turning, degrees) if is_model else None,
        start=joints_typed.one_each("--from", start),
        measured=None if data is None else _measured(known, data, columns, degrees),
        touch=touch,
        handeye=board or (True if handeye else None),
        eye=eye or "hand",
    )
    say(found.notes)
    table = found.columns()
    table |= {name: found.q[:, k] * typed[k] for k, name in enumerate(names)}
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
    shown = [unit_of_joint(kind == "rad", degrees)[1] for kind in ("rad", "m") if kind in kinds]
    units = ", ".join(dict.fromkeys([*shown, found.unit]))
    line = f"{output}: {len(found)} rows of {', '.join(table)} [{units}]"
    ways = [joints_typed.change(k, way) for k, way in enumerate(found.travel.tolist())]
    travel = f"joints travel {', '.join(ways)}"
    if found.random_length > 0:
        share = 100 * found.length / found.random_length
        travel += f": {share:.0f} % of the way of a random order"
    return Outcome(document, [line, *found.why, travel])


def _measured(
    known: Arm | Model, data: str, columns: dict[str, str] | None, degrees: bool
) -> Samples:
    import calib

    if isinstance(known, calib.Model):  # which remembers columns, unit and degrees of its log
        return log_for(known, data, Reading(columns=columns, degrees=degrees or None))
    names = list(known.joint_names)
    sliding = [n for n, turns in zip(names, known.revolute, strict=True) if not turns]
    log = calib.read_log(data, joints=names, columns=columns, degrees=degrees, prismatic=sliding)
    say(log.notes)
    return log
