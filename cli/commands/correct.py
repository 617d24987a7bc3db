"""The command `calib correct`."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import options as o
from ..output import note, show_json
from ..units import JointFormat

NO = 3


def correct(
    model: o.ModelArgument,
    input_: Annotated[
        str,
        typer.Option(
            "--input",
            metavar="FILE",
            help="Joint values that are right for the nominal arm: a CSV file (- standard input).",
        ),
    ],
    output: Annotated[
        str | None,
        typer.Option("--output", metavar="FILE", help="Corrected joint values, as CSV."),
    ] = None,
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Joint values that bring the real arm to where the nominal one would be.

    Exit code 3 if the real arm cannot reach one of these places.
    """
    import numpy as np

    import calib
    from calib.samples.tables import read_table, write_table
    from calib.use.correct import correct as correction

    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    typed, invalid = read_table(input_, joints.names)
    valid = np.isfinite(typed).all(axis=1)
    n = len(typed)
    columns = {name: np.full(n, np.nan) for name in joints.names}
    columns |= {name: np.full(n, np.nan) for name in ("x", "y", "distance", "expected_error")}
    reachable = np.zeros(n, dtype=np.int64)
    if valid.any():
        found = correction(loaded, typed[valid] / joints.typed)
        for k, name in enumerate(joints.names):
            columns[name][valid] = found.q[:, k] * joints.typed[k]
        columns["x"][valid], columns["y"][valid] = found.target.T
        columns["distance"][valid] = found.distance
        columns["expected_error"][valid] = found.expected_error
        reachable[valid] = found.reachable
    table = {**columns, "reachable": reachable}
    if output is not None or not as_json:
        write_table("-" if output is None else output, table)
    missed = (np.flatnonzero(valid & (reachable == 0)) + 1).tolist()
    if as_json:
        show_json(
            {
                "output": output,
                "rows": n,
                "invalid": invalid,
                "out_of_reach": missed,
                "unit": loaded.about.unit,
                **({} if output is not None else {"answers": table}),
            }
        )
    for rows, what in ((invalid, "not all numbers"), (missed, "out of reach for the real arm")):
        if rows:
            shown = ", ".join(map(str, rows[:10])) + (", ..." if len(rows) > 10 else "")
            note(f"rows {shown} of {n}: {what}, left without an answer")
    if invalid:
        raise typer.Exit(1)
    if missed:
        raise typer.Exit(NO)
