"""The command `calib correct`: correct joint values so that the real arm goes where they lead."""

from __future__ import annotations

from typing import Annotated, Any

from calib.common.wording import for_people

from .. import options as opt
from ..options import option
from ..output import NO, Outcome, fields, number, say
from ..parsing import above_zero


def correct(
    model: opt.ModelFile,
    *,
    limit: Annotated[Any, option("--limit L", "Largest change (3 x usual).", above_zero)] = None,
    view: opt.LogView = "auto",
    cause: opt.FrameOrJoints = "sensor",
    asking: opt.Asking,
) -> Outcome:
    """Correct joint values so that the real arm reaches where the nominal arm would be.

    Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
    more than the limit; the other rows are written.
    """
    import numpy as np

    import calib

    from ..answers import Query, over_all_rows, say_rows

    query = Query(model, asking)
    loaded, joints = query.model, query.joints
    batch = query.read(joints.names)
    n, factors = len(batch.values), np.array(joints.typed)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    most: Any = None if limit is None else limit / factors
    found = calib.correct(loaded, batch.values[valid] / factors, limit=most, view=view, cause=cause)
    say(found.notes)
    table = dict(zip(joints.names, (found.q * factors).T, strict=True))
    for column in table.values():
        column[found.exceeded] = np.nan
    table |= dict(zip(loaded.axes, found.target.T, strict=True))
    told = fields(found, "distance expected_error reachable angle placement_error")
    table |= {name: column for name, column in told.items() if column is not None}  # in space
    say(batch.notes(list(table)))
    rows = np.flatnonzero(valid) + 1
    beyond, missed = rows[found.exceeded].tolist(), rows[~found.reachable].tolist()
    say_rows(batch.invalid, n, "not all values are numbers, no answer")
    say_rows(missed, n, "out of reach for the real arm, no answer")
    limits = ", ".join(joints.change(k, most) for k, most in enumerate(found.limit))
    say_rows(
        beyond,
        n,
        f"a joint would change by more than the limit ({limits}), no answer; if the change is "
        "right, give a larger --limit",
    )
    changes, lines = dict[str, Any](), []
    if len(size := np.abs(found.change[found.reachable])):
        each = zip(size.mean(axis=0), size.max(axis=0), found.limit, strict=True)
        for name, kind, values in zip(
            joints.names, loaded.about.units_of_joints, each, strict=True
        ):
            changes[name] = dict(zip(("mean", "max", "limit"), values, strict=True))
            factor, unit = for_people(kind)
            mean, largest = (number(factor * value) for value in values[:2])
            lines.append(f"{name} {mean} (largest {largest}) {unit}")
    answered = bool((found.reachable & ~found.exceeded).any())
    return query.write(
        batch.answered(over_all_rows(valid, table)) if answered or not beyond else None,
        code=1 if batch.invalid and not beyond else NO if missed or beyond else 0,
        lines=[f"mean change: {', '.join(lines)}"] if lines else [],
        rows=n,
        invalid=batch.invalid,
        out_of_reach=missed,
        beyond_limit=beyond,
        change=changes or None,
        unit=query.meaning["unit"],
        units=query.meaning["units"],
    )
