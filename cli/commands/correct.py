"""Correct joint values so that the real arm reaches where the nominal arm would be.

Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
more than the limit; the other rows are written.
"""

from typing import Annotated, Literal

from .. import options as opt
from ..output import Outcome, say, sized
from ..parsing import above_zero


def correct(
    model: opt.ModelFile,
    limit: Annotated[
        float | None,
        opt.value("--limit", "L", "Largest change (3 x usual).", above_zero),
    ] = None,
    orientation: Annotated[
        Literal["keep", "free"],
        opt.option("--orientation", "Of six joints: the tool's turn."),
    ] = "keep",
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    import numpy as np

    import calib

    from ..query import Query, beside

    query = Query(model, input_, columns, output, unit, degrees)
    joints = query.joints
    batch, valid = query.read(joints.names)
    factors = np.array(joints.typed)
    result = calib.correct(
        query.model,
        batch.values[valid] / factors,
        limit=None if limit is None else limit / factors,
        orientation=orientation,
    )
    say(result.notes)
    table = dict(zip(joints.names, (result.q * factors).T, strict=True))
    table |= dict(zip(query.model.axes, result.target.T, strict=True))
    table["distance"] = result.distance
    table["expected_error"] = result.expected_error
    table["reachable"] = result.reachable
    if result.angle is not None:  # in space
        table["angle"] = result.angle
    rows = np.flatnonzero(valid) + 1
    limits = ", ".join(
        joints.change(k, most) for k, most in enumerate(result.limit)
    )
    beyond = (
        f"a joint would change by more than the limit ({limits}), no answer; if the change is "
        "right, give a larger --limit"
    )
    failures = {
        "out_of_reach": (
            rows[~result.reachable].tolist(),
            "out of reach for the real arm",
        ),
        "beyond_limit": (rows[result.exceeded].tolist(), beyond),
    }
    about = query.model.about
    size = np.abs(result.change[result.reachable])
    change = {}
    sizes = []
    if len(size):
        for k, name in enumerate(joints.names):
            mean = float(size[:, k].mean())
            largest = float(size[:, k].max())
            most = float(result.limit[k])
            change[name] = {"mean": mean, "max": largest, "limit": most}
            unit = about.units_of_joints[k]
            sizes.append(
                f"{name} {sized(mean, unit)} (largest {sized(largest, unit)})"
            )
    lines = [f"mean change: {', '.join(sizes)}"] if sizes else []
    answered = (
        result.reachable & ~result.exceeded
    ).any() or not result.exceeded.any()
    return query.answer(
        batch,
        beside(batch, valid, table) if answered else None,
        failures,
        lines=lines,
        facts={"change": change or None},
    )
