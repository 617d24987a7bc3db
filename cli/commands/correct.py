"""The command `calib correct`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from .. import options as opt
from ..asking import Asking
from ..output import Outcome, fields, say, sized
from ..parsing import above_zero

if TYPE_CHECKING:
    pass


def correct(
    model: opt.ModelFile,
    limit: Annotated[
        Any,
        Option(
            "--limit",
            metavar="L",
            parser=above_zero,
            help="Largest change (3 x usual).",
        ),
    ] = None,
    view: opt.LogView = "auto",
    orientation: Annotated[
        Literal["keep", "free"],
        Option("--orientation", help="Of six joints: the tool's turn."),
    ] = "keep",
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Correct joint values so that the real arm reaches where the nominal arm would be.

    Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
    more than the limit; the other rows are written.
    """
    asking = Asking(
        input_=input_, columns=columns, output=output, unit=unit, degrees=degrees
    )
    import numpy as np

    import calib

    from ..answers import Query, beside

    query = Query(model, asking)
    loaded = query.model
    joints = query.joints
    batch, valid = query.read(joints.names)
    factors = np.array(joints.typed)
    most: Any = None if limit is None else limit / factors
    how: dict[str, Any] = {"view": view, "orientation": orientation}
    found = calib.correct(loaded, batch.values[valid] / factors, limit=most, **how)
    say(found.notes)
    table = dict(zip(joints.names, (found.q * factors).T, strict=True))
    table |= dict(zip(loaded.axes, found.target.T, strict=True))
    told = fields(found, "distance expected_error reachable angle placement_error")
    table |= {
        name: column for name, column in told.items() if column is not None
    }  # in space
    rows = np.flatnonzero(valid) + 1
    limits = ", ".join(joints.change(k, most) for k, most in enumerate(found.limit))
    beyond = (
        f"a joint would change by more than the limit ({limits}), no answer; if the change is "
        "right, give a larger --limit"
    )
    failures = {
        "out_of_reach": (
            rows[~found.reachable].tolist(),
            "out of reach for the real arm",
        ),
        "beyond_limit": (rows[found.exceeded].tolist(), beyond),
    }
    changes = dict[str, Any]()
    lines = []
    if len(size := np.abs(found.change[found.reachable])):
        each = zip(size.mean(axis=0), size.max(axis=0), found.limit, strict=True)
        parts = zip(joints.names, loaded.about.units_of_joints, each, strict=True)
        for name, kind, values in parts:
            changes[name] = dict(zip(("mean", "max", "limit"), values, strict=True))
            lines.append(
                f"{name} {sized(values[0], kind)} (largest {sized(values[1], kind)})"
            )
    answered = (found.reachable & ~found.exceeded).any() or not found.exceeded.any()
    written = beside(batch, valid, table) if answered else None
    line = [f"mean change: {', '.join(lines)}"] if lines else []
    return query.answer(batch, written, failures, lines=line, change=changes or None)
