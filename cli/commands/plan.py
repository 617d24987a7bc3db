"""The command `calib plan`: plan poses to measure: well spread, within the limits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..measurements import Reading, log_for
from ..options import takes
from ..output import Notes, conclude, fields
from ..parsing import Columns, at_least_zero, integer, reals
from ..samples import Selection
from ..units import JointFormat, in_si
from ..usage import argument, one_document, option, refuse

if TYPE_CHECKING:
    from calib import Model, Samples
    from calib.arm.arm import Arm


@takes(
    robot=argument(
        "ROBOT|MODEL",
        "A URDF file or a bundled robot, to be measured for the first time; or a model, "
        "to be improved or checked.",
    ),
    output=option("--output -o FILE", "CSV, or Parquet by its name (- for standard output)."),
    poses=option("--poses -n N", "How many poses.", integer(1, 1000)),
    margin=option(
        "--margin M",
        "Distance from the joints' limits [rad or m]; 1 deg, but at most 2 % of the range, if "
        "not given.",
        at_least_zero("rad or m"),
    ),
    start=option(
        "--from Q1,Q2", "Joint values before the first pose; neutral if not given.", reals
    ),
    data=option("--data LOG", "A log of what was measured already; the plan covers the rest."),
)
def plan(
    *,
    robot: str,
    output: str,
    poses: int = 60,
    selection: Selection,
    margin: float | None = None,
    start: tuple[float, ...] | None = None,
    data: str | None = None,
    columns: Columns | None = None,
    seed: int = 0,
    as_json: bool = False,
) -> None:
    """Plan poses to measure: within the limits, well spread, with short moves between them.

    Obstacles and self-collision are not checked: move slowly the first time.
    """
    one_document(output, as_json)
    if data is None:
        refuse({"columns": columns}, "applies to a log: expected --data LOG too")
    import calib
    from calib.samples.tables import write_table

    is_model, degrees, notes = _is_model(robot), selection.degrees, Notes()
    known: Arm | Model
    if is_model:
        of_robots = {name: getattr(selection, name) for name in ("joints", "tip", "lock")}
        refuse(of_robots, "is for ROBOT: a model has its joints and its tip already")
        known = calib.load(robot)
    else:
        known = selection.load(robot)
    notes.say(getattr(known, "notes", ()))  # an arm's
    facts: Any = getattr(known, "about", known)  # what tells the joints and their ranges
    joints_typed = JointFormat(facts, degrees)
    names, typed = joints_typed.names, joints_typed.typed
    turning = dict(zip(names, facts.revolute, strict=True))
    found = calib.plan(
        known,
        poses,
        seed=seed,
        margin=None if margin is None else [margin / factor for factor in typed],
        # an arm was loaded with them, which it may need where it states no limits
        ranges=in_si("--range", selection.ranges, turning, degrees) if is_model else None,
        start=joints_typed.one_each("--from", start),
        measured=None if data is None else _measured(known, data, columns, degrees, notes),
    )
    notes.say(found.notes)
    table = found.columns()
    table |= {name: found.q[:, k] * typed[k] for k, name in enumerate(names)}
    write_table(output, table)
    units = {"joints": dict(zip(names, facts.units_of_joints, strict=True))}
    document = {
        "output": output,
        "rows": len(found),
        "joints": found.joint_names,
        "seed": seed,
        "travel": dict(zip(names, found.travel.tolist(), strict=True)),
        "poses": found.columns(),
        **fields(found, "start length random_length unit why"),
        "units": {**units, "positions": found.unit},
    }
    # angles first, then slides, then positions, each unit once
    units_typed = [u for u in ("rad", "m") if u in facts.units_of_joints]
    shown = ["deg" if degrees and unit == "rad" else unit for unit in units_typed]
    shown = list(dict.fromkeys([*shown, found.unit]))
    line = f"{len(found)} rows of {', '.join(table)} [{', '.join(shown)}]"
    ways = [joints_typed.change(k, way) for k, way in enumerate(found.travel.tolist())]
    travel = f"joints travel {', '.join(ways)}"
    if found.random_length > 0:
        share = 100 * found.length / found.random_length
        travel += f": {share:.0f} % of the way of a random order"
    conclude(output, line, [*found.why, travel], document if as_json else None)


def _is_model(source: str) -> bool:
    """Whether a file is a model rather than a robot: by its name, or by its first bytes."""
    from calib.arm.robots import robots_folder

    if source.endswith(".calib"):
        return True
    # before the file is looked at: a folder may hold a model of a bundled robot's name
    if (robots_folder() / f"{source}.urdf").is_file():
        return False
    try:
        with Path(source).open("rb") as file:
            return file.read(9)[8:] == b"{"  # of a model file the header's length comes first
    except (OSError, ValueError):  # whoever loads it tells what is wrong
        return False


def _measured(
    known: Arm | Model, data: str, columns: Columns | None, degrees: bool, notes: Notes
) -> Samples:
    import calib

    if isinstance(known, calib.Model):  # which remembers columns, unit and degrees of its log
        return log_for(known, data, Reading(columns, None, degrees or None), notes)
    names = list(known.joint_names)
    sliding = [n for n, turns in zip(names, known.revolute, strict=True) if not turns]
    log = calib.read_log(data, joints=names, columns=columns, degrees=degrees, prismatic=sliding)
    notes.say(log.notes)
    return log
