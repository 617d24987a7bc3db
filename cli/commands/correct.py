"""Correct joint values so that the real arm reaches where the nominal arm would be.

Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
more than the limit; the other rows are written.
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import calib
from calib.common.wording import by_name, with_unit

from .. import options as opt
from ..output import Outcome, say
from ..parsing import above_zero


def correct(
    model: opt.ModelFile,
    limit: Annotated[
        float | None,
        opt.value(
            "--limit L",
            "Of a joint's change (three times the usual).",
            above_zero,
        ),
    ] = None,
    orientation: Annotated[
        Literal["keep", "free"],
        opt.option("--orientation", "free: the tool may turn (six joints)."),
    ] = "keep",
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    import numpy as np

    from calib.common.rows import finite_rows

    from ..query import Files, Query, with_answers

    files = Files(input_, columns, output)
    query = Query.of(model, files, unit, degrees)
    joints = query.joints
    batch, valid = query.read(joints.names)
    factors = np.array(joints.to_typed)
    result = calib.correct(
        query.model,
        batch.values[valid] / factors,
        limit=None if limit is None else limit / factors,
        orientation=orientation,
    )
    say(result.notes)
    table = by_name(joints.names, (result.q * factors).T)
    table |= by_name(query.model.axes, result.target.T)
    table["distance"] = result.distance
    table["expected_error"] = result.expected_error
    table["reachable"] = result.reachable
    if result.angle is not None:  # in space
        table["angle"] = result.angle
    rows = np.flatnonzero(valid)
    most = ", ".join(map(joints.change, range(len(joints.names)), result.limit))
    failures = {
        "out_of_reach": (
            rows[~result.reachable],
            "out of reach for the real arm",
        ),
        "beyond_limit": (
            rows[result.exceeded],
            f"a joint would change by more than the limit ({most}), no answer; if the change is "
            "right, give a larger --limit",
        ),
    }
    answered = finite_rows(result.q)
    refused = result.exceeded.any() and not answered.any()
    # of changes that are all beyond the limit their sizes are told
    shown = np.flatnonzero(answered if answered.any() else result.reachable)
    change = _change_of_joints(joints.names, result, shown.tolist())
    sizes = []
    for k, (name, size) in enumerate(change.items()):
        unit = query.model.about.units_of_joints[k]
        mean = with_unit(size["mean"], unit)
        sizes.append(f"{name} {mean} (largest {with_unit(size['max'], unit)})")
    return query.write(
        batch,
        None if refused else with_answers(batch, table),
        failures,
        lines=[f"mean change: {', '.join(sizes)}"] if sizes else [],
        facts={"change": change or None},
    )


def _change_of_joints(
    names: Sequence[str], result: calib.Corrected, rows: Sequence[int]
) -> dict[str, dict[str, float]]:
    """Mean and largest change of each joint [rad or m] in some rows, and its limit."""
    if not rows:
        return {}
    changes = {}
    for k, name in enumerate(names):
        sizes = abs(result.change[rows, k])
        mean = float(sizes.mean())
        largest = float(sizes.max())
        limit = float(result.limit[k])
        changes[name] = {"mean": mean, "max": largest, "limit": limit}
    return changes
