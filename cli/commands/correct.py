"""Correct joint values so that the real arm reaches where the nominal arm would be.

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
    rows = np.flatnonzero(valid) + 1
    most = ", ".join(map(joints.change, range(len(joints.names)), result.limit))
    failures = {
        "out_of_reach": (
            rows[~result.reachable].tolist(),
            "out of reach for the real arm",
        ),
        "beyond_limit": (
            rows[result.exceeded].tolist(),
            f"a joint would change by more than the limit ({most}), no answer; if the change is "
            "right, give a larger --limit",
        ),
    }
    change = {}
    sizes = []
    answered = np.isfinite(result.q).all(axis=1)
    # of changes that are all beyond the limit their sizes are told
    shown = answered if answered.any() else result.reachable
    size = np.abs(result.change[shown])
    if len(size):
        units = query.model.about.units_of_joints
        for name, kind, column, bound in zip(
            joints.names, units, size.T, result.limit.tolist(), strict=True
        ):
            mean = float(column.mean())
            largest = float(column.max())
            change[name] = {"mean": mean, "max": largest, "limit": bound}
            words = (
                f"{with_unit(mean, kind)} (largest {with_unit(largest, kind)})"
            )
            sizes.append(f"{name} {words}")
    lines = [f"mean change: {', '.join(sizes)}"] if sizes else []
    refused = result.exceeded.any() and not answered.any()
    return query.write(
        batch,
        None if refused else with_answers(batch, table),
        failures,
        lines=lines,
        facts={"change": change or None},
    )
