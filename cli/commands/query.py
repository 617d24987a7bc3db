"""The commands `calib query forward`, `calib query path` and `calib correct`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from .. import options as opt
from ..options import option
from ..output import NO, Outcome, TextTable, fields, fixed, note, say, sized
from ..parsing import above_zero, finite_number, reader, reals

if TYPE_CHECKING:
    from calib.common.arrays import Array

    from ..answers import Query

_step = reader(
    "a length greater than zero, or inf",
    lambda text: math.inf if text.strip().lower() == "inf" else finite_number(text),
    lambda length: length > 0.0,
)


def forward(
    model: opt.ModelFile,
    values: Annotated[list[float] | None, Argument(metavar="Q1 Q2", help="Joint values.")] = None,
    *,
    readout: opt.ReadoutKind = None,
    frame: opt.InFrame = "sensor",
    asking: opt.Asking,
) -> Outcome:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    import numpy as np

    from ..answers import TURN, Query, beside, say_size

    query = Query(model, asking, frame, values or ())
    joints, about = query.joints, query.model.about
    if asking.input_ is not None:
        from calib.errors import QueryError
        from calib.samples.joint_values import check_joint_values

        batch, valid = query.read(joints.names)
        q = batch.values / np.array(joints.typed)
        ranges = (about.joint_names, about.lower, about.upper, about.revolute)
        check_joint_values(q, *ranges, degrees=asking.degrees, error=QueryError)
        answers = beside(batch, valid, _told(query, q[valid], readout))
        unknown = np.flatnonzero(valid & np.isnan(answers["x"])) + 1
        failures = {"out_of_reach": (unknown.tolist(), "outside of what was learned")}
        return query.answer(batch, answers, failures)
    one = joints.one_each("Q1 Q2", values or ()) or []
    told: dict[str, Any] = {
        name: column[0].item() for name, column in _told(query, np.array([one]), readout).items()
    }
    parts = {"position": query.axes, "quaternion": TURN if "qw" in told else ()}
    quantities = {name: [told.pop(axis) for axis in axes] for name, axes in parts.items() if axes}
    document = query.document(one, **quantities, **told) | query.meaning
    if (outside := query.model.outside(one)) is not None:
        note(f"no answer: {joints.beyond(query.model, one) or outside}")
        return Outcome(document, code=NO)
    lines: list[str | TextTable] = [query.table([document], query.bounds)]
    if "quaternion" in document:
        lines.append("quaternion " + " ".join(fixed(v, 6) for v in document["quaternion"]))
    say_size(told)
    alone = " ".join(fixed(v * query.positions.factor, 4) for v in document["position"])
    return Outcome(document, lines, result=[alone])


def _told(query: Query, q: Array, readout: str | None) -> dict[str, Array]:
    """Return what is told of joints (n, dof), by column of a table."""
    import numpy as np

    from calib.model.prediction import predict
    from calib.samples.motion import Motion

    from ..answers import BOUNDS, TURN, up_to_scale

    model = query.model
    if query.frame == "base":
        from calib.model.space import Space

        space = Space.of(model)
        position, turns = space.forward(q)
        bound = space.bound(q)
        bounds = {**up_to_scale(model, q), **dict.fromkeys(BOUNDS, bound)}
        known = np.isfinite(position[:, 0])
        told = dict(zip("xyz", position.T, strict=True)) | dict(zip(TURN, turns.T, strict=True))
        return told | {name: np.where(known, value, np.nan) for name, value in bounds.items()}
    x = model.forward(q, readout)
    told = dict(zip(model.axes, x.T, strict=True))
    if len(model.axes) == 3:
        from calib.body.belief import knows_orientation

        if knows_orientation(model.body):
            told |= dict(zip(TURN, model.pose(q)[1].T, strict=True))
    prediction = predict(model, Motion(q))
    apart = prediction.apart(readout or model.default_readout)
    with_distance = (prediction.bound + apart, prediction.true_bound + apart)
    return told | dict(zip(BOUNDS, with_distance, strict=True))


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

    from ..answers import Query

    query = Query(model, asking)
    asked, joints, positions = query.model, query.joints, query.positions
    batch, rows = query.read(asked.axes)
    valid = np.flatnonzero(rows)
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
    out, held = (np.flatnonzero(which) + 1 for which in (~found.reachable, found.held))
    furthest = positions.said(float(found.distance[out - 1].max(initial=0.0)))
    failures = {
        "jumps": (found.jumps + 1, "a jump cannot be avoided, the branch ends before"),
        "left_out": (held, "left out, far beyond all that the arm reaches: the joints stay"),
        "out_of_reach": (out, f"out of reach, by {furthest} at most: attainable points close by"),
    }
    failures = {name: (rows.tolist(), why) for name, (rows, why) in failures.items()}
    return query.answer(batch, table, failures, n=len(found.q), key="path")


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

    from ..answers import Query, beside

    query = Query(model, asking)
    loaded, joints = query.model, query.joints
    batch, valid = query.read(joints.names)
    factors = np.array(joints.typed)
    most: Any = None if limit is None else limit / factors
    found = calib.correct(loaded, batch.values[valid] / factors, limit=most, view=view, cause=cause)
    say(found.notes)
    table = dict(zip(joints.names, (found.q * factors).T, strict=True))
    for column in table.values():
        column[found.exceeded] = np.nan
    table |= dict(zip(loaded.axes, found.target.T, strict=True))
    told = fields(found, "distance expected_error reachable angle placement_error")
    table |= {name: column for name, column in told.items() if column is not None}  # in space
    rows = np.flatnonzero(valid) + 1
    limits = ", ".join(joints.change(k, most) for k, most in enumerate(found.limit))
    beyond = (
        f"a joint would change by more than the limit ({limits}), no answer; if the change is "
        "right, give a larger --limit"
    )
    failures = {
        "out_of_reach": (rows[~found.reachable].tolist(), "out of reach for the real arm"),
        "beyond_limit": (rows[found.exceeded].tolist(), beyond),
    }
    changes, lines = dict[str, Any](), []
    if len(size := np.abs(found.change[found.reachable])):
        each = zip(size.mean(axis=0), size.max(axis=0), found.limit, strict=True)
        parts = zip(joints.names, loaded.about.units_of_joints, each, strict=True)
        for name, kind, values in parts:
            changes[name] = dict(zip(("mean", "max", "limit"), values, strict=True))
            lines.append(f"{name} {sized(values[0], kind)} (largest {sized(values[1], kind)})")
    answered = (found.reachable & ~found.exceeded).any() or not found.exceeded.any()
    written = beside(batch, valid, table) if answered else None
    line = [f"mean change: {', '.join(lines)}"] if lines else []
    return query.answer(batch, written, failures, lines=line, change=changes or None)
