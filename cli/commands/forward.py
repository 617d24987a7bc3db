"""The command `calib query forward`: the position of the tip for joint values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from .. import options as opt
from ..output import NO, Outcome, TextTable, fixed, note
from ..parsing import any_number, check_count

if TYPE_CHECKING:
    from calib.common.arrays import Array

    from ..answers import Query

_TURN = ("qx", "qy", "qz", "qw")


def forward(
    model: opt.ModelFile,
    values: Annotated[
        list[float] | None,
        Argument(metavar="Q1 Q2", parser=any_number, help="Joint values, base to tip [rad or m]."),
    ] = None,
    *,
    readout: opt.ReadoutKind = None,
    input_: opt.Input = None,
    columns: opt.Columns = None,
    output: opt.Output = None,
    frame: opt.InFrame = "sensor",
    unit: opt.PositionUnit = None,
    degrees: opt.Degrees = False,
) -> Outcome:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    import numpy as np

    from ..answers import BOUNDS, UP_TO_SCALE, Query, over_all_rows, say_size

    typed = values or []
    query = Query(model, degrees, frame, unit, typed, input_, columns, output)
    joints, asked = query.joints, query.model
    if input_ is not None:
        from calib.errors import QueryError
        from calib.samples.joint_values import check_joint_values

        batch = query.read(input_, joints.names, columns)
        q, about = batch.values / np.array(joints.typed), asked.about
        ranges = (about.joint_names, about.lower, about.upper, about.revolute)
        check_joint_values(q, *ranges, degrees=degrees, error=QueryError)
        valid = np.isfinite(q).all(axis=1)
        answers = over_all_rows(valid, _told(query, q[valid], readout))
        unknown = (np.flatnonzero(valid & np.isnan(answers["x"])) + 1).tolist()
        return query.answer(batch, answers, unknown, "outside of what was learned", output)
    check_count(typed, joints.names, "joint value")
    one = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    told = {name: np.ravel(value)[0].item() for name, value in _told(query, one, readout).items()}
    axes = "xyz" if frame == "base" else asked.axes
    quantities: dict[str, Any] = {"position": [told[axis] for axis in axes]}
    if "qw" in told:
        quantities["quaternion"] = [told[name] for name in _TURN]
    quantities |= {name: told[name] for name in (*BOUNDS, UP_TO_SCALE) if name in told}
    (answer,) = query.documents([one], **{name: [value] for name, value in quantities.items()})
    document = answer | query.meaning
    if (outside := asked.outside(one)) is not None:
        note(f"no answer: {joints.beyond(asked, one) or outside}")
        return Outcome(document, code=NO)
    lines: list[str | TextTable] = [query.table([answer], axes, query.bounds)]
    if "quaternion" in answer:
        lines.append("quaternion " + " ".join(fixed(value, 6) for value in answer["quaternion"]))
    say_size(told.get(UP_TO_SCALE))
    alone = " ".join(fixed(told[axis] * query.positions.factor, 4) for axis in axes)
    return Outcome(document, lines, result=[alone])


def _told(query: Query, q: Any, readout: str | None) -> dict[str, Array]:
    """Return what is told of joints (n, dof) or (dof,), by column of a table."""
    import numpy as np

    from calib.model.answers import forward_bounds

    from ..answers import BOUNDS, up_to_scale

    model, rows = query.model, np.atleast_2d(q)
    if query.frame == "base":
        from calib.model.space import Space

        space = Space.of(model)
        position, turns = space.forward(rows)
        bound = space.bound(rows)
        bounds = {**up_to_scale(model, rows), "expected_error": bound, "model_error": bound}
        known = np.isfinite(position[:, 0])
        told = dict(zip("xyz", position.T, strict=True)) | dict(zip(_TURN, turns.T, strict=True))
        return told | {name: np.where(known, value, np.nan) for name, value in bounds.items()}
    x = model.forward(q, readout)
    told = dict(zip(model.axes, x.T, strict=True))
    if len(model.axes) == 3:
        from calib.body.belief import knows_orientation

        if knows_orientation(model.body):
            turns = model.pose(rows)[1].reshape(*x.shape[:-1], 4)
            told |= dict(zip(_TURN, np.moveaxis(turns, -1, 0), strict=True))
    return told | dict(zip(BOUNDS, forward_bounds(model, q, x, readout), strict=True))
