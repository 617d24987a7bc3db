"""The command `calib query forward`: the position of the tip for joint values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from .. import options as opt
from ..output import NO, Outcome, TextTable, fixed, note
from ..parsing import TABLES, any_number, check_count, check_file, check_streams

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calib.common.arrays import Array

    from ..answers import Query


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
    from ..answers import BOUNDS, UP_TO_SCALE, Query

    typed = values or []
    check_streams(typed, input_, output, columns)
    check_file(output, TABLES, stream=True)
    query = Query(model, degrees, frame, unit)
    if input_ is not None:
        return _batch(query, input_, columns, readout, output)
    joints, asked = query.joints, query.model
    check_count(typed, joints.names, "joint value")
    q = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    told = {name: float(value) for name, value in _told_at(query, q, readout).items()}
    axes = "xyz" if frame == "base" else asked.axes
    quantities: dict[str, Any] = {"position": [told[axis] for axis in axes]}
    if "qw" in told:
        quantities["quaternion"] = [told[name] for name in ("qx", "qy", "qz", "qw")]
    quantities |= {name: told[name] for name in (*BOUNDS, UP_TO_SCALE) if name in told}
    (answer,) = query.documents([q], **{name: [value] for name, value in quantities.items()})
    document = answer | query.meaning
    if (outside := asked.outside(q)) is not None:
        note(f"no answer: {joints.beyond(asked, q) or outside}")
        return Outcome(document, code=NO)
    lines: list[str | TextTable] = [query.table([answer], axes, query.bounds)]
    if "quaternion" in answer:
        lines.append("quaternion " + " ".join(fixed(value, 6) for value in answer["quaternion"]))
    if UP_TO_SCALE in told:
        from ..space import say_size

        say_size(told[UP_TO_SCALE])
    alone = " ".join(fixed(told[axis] * query.positions.factor, 4) for axis in axes)
    return Outcome(document, lines, result=[alone])


def _told_at(query: Query, q: ArrayLike, readout: str | None) -> dict[str, Array]:
    """Return what is told of joints (n, dof) or (dof,), by column of a table."""
    import numpy as np

    from calib.model.answers import forward_bounds

    from ..answers import BOUNDS

    model = query.model
    x = model.forward(q, readout)
    columns = dict(zip(model.axes, x.T, strict=True))
    bounds = zip(BOUNDS, forward_bounds(model, q, x, readout), strict=True)
    if len(model.axes) == 2 and query.frame != "base":
        return columns | dict(bounds)
    from ..space import seen_forward

    seen = seen_forward(model, np.atleast_2d(q), query.frame)
    columns |= {name: np.reshape(column, x.shape[:-1]) for name, column in seen.items()}
    return columns | {name: columns.pop(name, bound) for name, bound in bounds}


def _batch(
    query: Query,
    source: str,
    called: Mapping[str, str] | None,
    readout: str | None,
    output: str | None,
) -> Outcome:
    """Answer a table of joint values with positions."""
    import numpy as np

    from calib.errors import QueryError
    from calib.samples.joint_values import check_joint_values

    from ..answers import over_all_rows

    batch, about, joints = (
        query.read(source, query.joints.names, called),
        query.model.about,
        query.joints,
    )
    q = batch.values / np.array(joints.typed)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(q, *ranges, degrees=joints.degrees, error=QueryError)
    valid = np.isfinite(q).all(axis=1)
    columns = over_all_rows(valid, _told_at(query, q[valid], readout))
    outside = (np.flatnonzero(valid & np.isnan(columns["x"])) + 1).tolist()
    return query.answer(batch, columns, outside, "outside of what was learned", output)
