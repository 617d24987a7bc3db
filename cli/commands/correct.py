"""The command `calib correct`: correct joint values so that the real arm goes where they lead."""

from __future__ import annotations

from typing import Annotated, Any

from calib.common.wording import for_people

from .. import options as opt
from ..options import Text, option
from ..output import NO, Outcome, fields, number, say
from ..parsing import above_zero
from ..units import units_of


def correct(
    model: opt.ModelFile,
    *,
    input_: Annotated[str, option("--input FILE", "Joints for the nominal arm: CSV (- stdin).")],
    columns: opt.Columns = None,
    output: Annotated[Text, option("--output FILE", "The corrected joints, as CSV.")] = None,
    limit: Annotated[Any, option("--limit L", "Largest change (3 x usual).", above_zero)] = None,
    view: opt.LogView = "auto",
    cause: opt.FrameOrJoints = "sensor",
    degrees: opt.Degrees = False,
) -> Outcome:
    """Correct joint values so that the real arm reaches where the nominal arm would be.

    Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
    more than the limit; the other rows are written.
    """
    import numpy as np

    from calib.use.correct import correct as correction

    from ..answers import Query, over_all_rows, say_rows

    query = Query(model, degrees, "sensor", None, (), input_, columns, output)
    loaded, joints = query.model, query.joints
    batch = query.read(input_, joints.names, columns)
    n, factors = len(batch.values), np.array(joints.typed)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    rows = np.flatnonzero(valid) + 1
    known: dict[str, Any] = {
        "limit": None if limit is None else limit / factors,
        "view": view,
        "cause": cause,
    }
    found = correction(loaded, batch.values[valid] / factors, **known)
    say(found.notes)
    commanded = np.where(found.exceeded[:, None], np.nan, found.q)
    table = dict(zip(joints.names, (commanded * factors).T, strict=True))
    table |= dict(zip(loaded.axes, found.target.T, strict=True))
    table |= fields(found, "distance expected_error reachable")
    in_space = fields(found, "angle placement_error")
    table |= {name: column for name, column in in_space.items() if column is not None}
    say(batch.notes(list(table)))
    beyond, missed = rows[found.exceeded].tolist(), rows[~found.reachable].tolist()
    say_rows(batch.invalid, n, "not all values are numbers, no answer")
    say_rows(missed, n, "out of reach for the real arm, no answer")
    if beyond:
        # the row and the joint whose change is largest, measured by its limit
        share = np.nan_to_num(np.abs(found.change) / found.limit)
        row, worst = map(int, np.unravel_index(int(np.argmax(share)), share.shape))
        say_rows(
            beyond,
            n,
            f"a joint would change by more than the limit (row {rows[row]}: "
            f"{joints.change(worst, found.change[row, worst])}, limit "
            f"{joints.change(worst, found.limit[worst])}); no answer; if the change is right, "
            "give a larger --limit",
        )
    changes, told = dict[str, Any](), []
    if len(size := np.abs(found.change[found.reachable])):
        each = zip(size.mean(axis=0), size.max(axis=0), found.limit, strict=True)
        for name, kind, row_ in zip(joints.names, loaded.about.units_of_joints, each, strict=True):
            changes[name] = dict(zip(("mean", "max", "limit"), row_, strict=True))
            factor, unit = for_people(kind)
            mean, largest = (number(factor * value) for value in row_[:2])
            told.append(f"{name} {mean} (largest {largest}) {unit}")
    answered = bool((found.reachable & ~found.exceeded).any())
    return query.write(
        batch.answered(over_all_rows(valid, table)) if answered or not beyond else None,
        output,
        code=1 if batch.invalid and not beyond else NO if missed or beyond else 0,
        lines=[f"mean change: {', '.join(told)}"] if told else [],
        rows=n,
        invalid=batch.invalid,
        out_of_reach=missed,
        beyond_limit=beyond,
        change=changes or None,
        unit=loaded.about.unit,
        units=units_of(loaded.about),
    )
