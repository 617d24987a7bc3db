"""The command `calib query path`: find joint values along straight lines through waypoints."""

from __future__ import annotations

import math
from typing import Any

import typer

from calib.common.wording import for_people

from ..options import takes
from ..output import NO, fields, note
from ..parsing import expects, finite_number, reals, require
from ..units import JointFormat, meaning
from ..usage import one_document, option


@expects("a length greater than zero, or inf")
def _step(text: str) -> float:
    value = math.inf if text.strip().lower() == "inf" else finite_number(text)
    require(value > 0.0)
    return value


@takes(
    input_=option("--input FILE", "Waypoints: a CSV file with columns x,y."),
    start=option(
        "--from Q1,Q2",
        "Start near these joint values; without it on the branch that goes furthest.",
        reals,
    ),
    step=option(
        "--step S",
        "Longest way of the tip between two rows [m, or the sensor's unit]; inf for the "
        "waypoints alone; 1 % of the workspace's extent if not given.",
        _step,
    ),
)
def path(
    model: str,
    input_: str,
    output: str | None = None,
    start: tuple[float, ...] | None = None,
    step: float | None = None,
    degrees: bool = False,
    as_json: bool = False,
) -> None:
    """Joint values along straight lines through waypoints, on one branch where possible.

    Exit code 3 if the joints have to jump between branches or a point is out of reach.
    """
    one_document(output, as_json)
    import numpy as np

    import calib
    from calib.samples.tables import read_batch

    from ..answers import say_rows, write_answers

    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    first = joints.one_each("--from", start)
    batch = read_batch(input_, loaded.axes)
    valid = np.flatnonzero(np.isfinite(batch.values).all(axis=1))
    found = loaded.path(batch.values[valid], first, step)
    columns: dict[str, Any] = {
        "waypoint": valid[found.waypoint] + 1,
        **dict(zip(loaded.axes, found.target.T, strict=True)),
        **dict(zip(joints.names, (found.q * joints.typed).T, strict=True)),
        **fields(found, "distance expected_error model_error"),
        "reachable": found.reachable.astype(np.int64),
        "jump": np.isin(np.arange(len(found.q)), found.jumps).astype(np.int64),
    }
    write_answers(
        columns,
        output,
        as_json,
        joints,
        "path",
        rows=len(found.q),
        invalid=batch.invalid,
        jumps=(found.jumps + 1).tolist(),
        out_of_reach=(np.flatnonzero(~found.reachable) + 1).tolist(),
        **meaning(loaded.about),
    )
    say_rows(batch.invalid, len(batch.values), "not all numbers, left out of the path")
    for row in found.jumps.tolist():
        named = zip(loaded.axes, found.target[row].tolist(), strict=True)
        where = ", ".join(f"{axis} = {value:.6g}" for axis, value in named)
        note(f"row {row + 1}: a jump cannot be avoided, the branch ends before {where}")
    out = ~found.reachable
    if out.any():
        factor, name = for_people(loaded.about.unit)
        furthest = float(found.distance[out].max()) * factor
        note(
            f"{int(out.sum())} of {len(out)} rows are out of reach, the furthest by "
            f"{furthest:.4g} {name}: they hold attainable points close by"
        )
    if batch.invalid:
        raise typer.Exit(1)
    if len(found.jumps) or out.any():
        raise typer.Exit(NO)
