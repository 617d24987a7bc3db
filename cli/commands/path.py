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
    start: Annotated[Any, option("--from Q1,Q2", "Start near these joints.", reals)] = None,
    step: Annotated[Any, option("--step S", "Longest, or inf (default 1 % extent).", _step)] = None,
    asking: opt.Asking,
) -> Outcome:
    """Joint values along straight lines through waypoints, on one branch where possible.

    Exit code 3 if the joints have to jump between branches or a point is out of reach.
    """
    import numpy as np

    from ..answers import Query, say_rows

    query = Query(model, asking)
    asked, joints, positions = query.model, query.joints, query.positions
    batch = query.read(asked.axes)
    valid = np.flatnonzero(np.isfinite(batch.values).all(axis=1))
    longest = None if step is None else step / positions.typed
    found = asked.path(batch.values[valid], joints.one_each("--from", start), longest)
    table: dict[str, Any] = {
        "waypoint": valid[found.waypoint] + 1,
        **dict(zip(asked.axes, found.target.T, strict=True)),
        **dict(zip(joints.names, (found.q * joints.typed).T, strict=True)),
        **fields(found, "distance expected_error model_error"),
        "reachable": found.reachable.astype(np.int64),
        "jump": np.isin(np.arange(len(found.q)), found.jumps).astype(np.int64),
    }
    n, out, held = len(found.q), *(np.flatnonzero(x) for x in (~found.reachable, found.held))
    say_rows(batch.invalid, len(batch.values), "not all numbers, left out of the path")
    jumps, left_out = (found.jumps + 1).tolist(), (held + 1).tolist()
    say_rows(jumps, n, "a jump cannot be avoided, the branch ends before")
    say_rows(left_out, n, "left out, far beyond all that the arm reaches: the joints stay")
    if len(out):
        note(
            f"{len(out)} of {n} rows are out of reach, the furthest by "
            f"{positions.said(float(found.distance[out].max()))}: they hold attainable points "
            "close by"
        )
    return query.write(
        table,
        key="path",
        code=1 if batch.invalid else NO if jumps or len(out) else 0,
        rows=n,
        invalid=batch.invalid,
        jumps=jumps,
        left_out=left_out,
        out_of_reach=(out + 1).tolist(),
        **query.meaning,
    )
