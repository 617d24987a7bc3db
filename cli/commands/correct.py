"""Correct joint values: the measured point of the real arm reaches where the nominal one is.

Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
more than the limit; the other rows are written.
"""

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
    # where all changes are beyond the limit, their sizes are reported
    shown = np.flatnonzero(answered if answered.any() else result.reachable)
    change = {}
    sizes = []
    for k, name in enumerate(joints.names if len(shown) else ()):
        of_rows = abs(result.change[shown, k])
        mean = float(of_rows.mean())
        largest = float(of_rows.max())
        change[name] = {"mean": mean, "max": largest, "limit": result.limit[k]}
        unit = query.model.about.units_of_joints[k]
        usual = with_unit(mean, unit)
        sizes.append(f"{name} {usual} (largest {with_unit(largest, unit)})")
    return query.write(
        batch,
        None if refused else with_answers(batch, table),
        failures,
        lines=[f"mean change: {', '.join(sizes)}"] if sizes else [],
        facts={"change": change or None},
    )
