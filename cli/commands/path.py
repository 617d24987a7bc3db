"""The command `calib query path`: find joint values along straight lines through waypoints."""

from __future__ import annotations

import math
from typing import Annotated, Any

from .. import options as opt
from ..options import option
from ..output import NO, Outcome, fields, note
from ..parsing import finite_number, reader, reals

_step = reader(
    "a length greater than zero, or inf",
    lambda text: math.inf if text.strip().lower() == "inf" else finite_number(text),
    lambda length: length > 0.0,
)


def path(
    model: opt.ModelFile,
    *,
    input_: Annotated[str, option("--input FILE", "Waypoints: a CSV file with columns x,y.")],
    columns: opt.Columns = None,
    output: opt.Output = None,
    start: Annotated[Any, option("--from Q1,Q2", "Start near these joints.", reals)] = None,
    step: Annotated[Any, option("--step S", "Longest, or inf (default 1 % extent).", _step)] = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    """Joint values along straight lines through waypoints, on one branch where possible.

    Exit code 3 if the joints have to jump between branches or a point is out of reach.
    """
    import numpy as np

    from ..answers import Query, say_rows

    query = Query(model, degrees, "sensor", unit, (), input_, columns, output)
    asked, joints, positions = query.model, query.joints, query.positions
    batch = query.read(input_, asked.axes, columns)
    valid = np.flatnonzero(np.isfinite(batch.values).all(axis=1))
    longest = None if step is None else step / positions.typed
    found = asked.path(batch.values[valid], joints.one_each("--from", start), longest)
    out = ~found.reachable
    table: dict[str, Any] = {
        "waypoint": valid[found.waypoint] + 1,
        **dict(zip(asked.axes, found.target.T, strict=True)),
        **dict(zip(joints.names, (found.q * joints.typed).T, strict=True)),
        **fields(found, "distance expected_error model_error"),
        "reachable": found.reachable.astype(np.int64),
        "jump": np.isin(np.arange(len(found.q)), found.jumps).astype(np.int64),
    }
    say_rows(batch.invalid, len(batch.values), "not all numbers, left out of the path")
    for row in found.jumps.tolist():
        named = zip(asked.axes, (found.target[row] * positions.typed).tolist(), strict=True)
        where = ", ".join(f"{axis} = {value:.6g}" for axis, value in named)
        note(f"row {row + 1}: a jump cannot be avoided, the branch ends before {where}")
    if found.held.any():
        note(
            f"{int(found.held.sum())} of {len(out)} rows were left out, far beyond all that the "
            "arm reaches: the joints stay as they were"
        )
    if out.any():
        note(
            f"{int(out.sum())} of {len(out)} rows are out of reach, the furthest by "
            f"{positions.said(float(found.distance[out].max()))}: they hold attainable points "
            "close by"
        )
    return query.write(
        table,
        output,
        key="path",
        code=1 if batch.invalid else NO if len(found.jumps) or out.any() else 0,
        rows=len(found.q),
        invalid=batch.invalid,
        jumps=(found.jumps + 1).tolist(),
        left_out=(np.flatnonzero(found.held) + 1).tolist(),
        out_of_reach=(np.flatnonzero(out) + 1).tolist(),
        **query.meaning,
    )
