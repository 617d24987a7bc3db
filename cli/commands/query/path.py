"""The command `calib query path`."""

from __future__ import annotations

import math
from typing import Annotated, Any

from typer import Option

from ... import options as opt
from ...asking import Asking
from ...output import Outcome, fields
from ...parsing import finite_number, parser, reals

_step = parser(
    "a length greater than zero, or inf",
    lambda text: math.inf if text.strip().lower() == "inf" else finite_number(text),
    lambda length: length > 0.0,
)


def path(
    model: opt.ModelFile,
    start: Annotated[
        Any,
        Option(
            "--from", metavar="Q1,Q2", parser=reals, help="Start near these joints."
        ),
    ] = None,
    step: Annotated[
        Any,
        Option(
            "--step",
            metavar="S",
            parser=_step,
            help="Longest, or inf (default 1 % extent).",
        ),
    ] = None,
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Joint values along straight lines through waypoints, on one branch where possible.

    Exit code 3 if the joints have to jump between branches or a point is out of reach.
    """
    asking = Asking(
        input_=input_, columns=columns, output=output, unit=unit, degrees=degrees
    )
    import numpy as np

    from ...answers import Query

    query = Query(model, asking)
    arm_model = query.model
    joints = query.joints
    positions = query.positions
    batch, rows = query.read(arm_model.axes)
    valid = np.flatnonzero(rows)
    longest = None if step is None else step / positions.typed
    way = arm_model.path(batch.values[valid], joints.one_each("--from", start), longest)
    table: dict[str, Any] = {
        "waypoint": valid[way.waypoint] + 1,
        **dict(zip(arm_model.axes, way.target.T, strict=True)),
        **dict(zip(joints.names, (way.q * joints.typed).T, strict=True)),
        **fields(way, "distance expected_error model_error"),
        "reachable": way.reachable.astype(np.int64),
        "jump": np.isin(np.arange(len(way.q)), way.jumps).astype(np.int64),
    }
    out = np.flatnonzero(~way.reachable) + 1
    stopped = np.flatnonzero(way.held) + 1
    furthest = positions.said(float(way.distance[out - 1].max(initial=0.0)))
    failures = {
        "jumps": (way.jumps + 1, "a jump cannot be avoided, the branch ends before"),
        "left_out": (
            stopped,
            "left out, far beyond all that the arm reaches: the joints stay",
        ),
        "out_of_reach": (
            out,
            f"out of reach, by {furthest} at most: attainable points close by",
        ),
    }
    failures = {name: (rows.tolist(), why) for name, (rows, why) in failures.items()}
    return query.answer(batch, table, failures, n=len(way.q), key="path")
