"""The command `calib query forward`: the position of the tip for joint values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from .. import options as opt
from ..output import NO, Outcome, TextTable, fixed, note
from ..parsing import TABLES, any_number, check_count, check_file, check_streams
from ..units import JointFormat, PositionFormat, meaning

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calib import Model
    from calib.common.arrays import Array


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
    import calib

    from ..answers import BOUNDS, UP_TO_SCALE, answer_table, bounds_shown, documents

    typed = values or []
    check_streams(typed, input_, output, columns)
    check_file(output, TABLES, stream=True)
    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    positions = PositionFormat(loaded.about, frame, unit)
    if input_ is not None:
        return _batch(loaded, joints, positions, input_, columns, readout, output, frame)
    check_count(typed, joints.names, "joint value")
    q = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    told = {name: float(value) for name, value in _told_at(loaded, q, readout, frame).items()}
    axes = "xyz" if frame == "base" else loaded.axes
    quantities: dict[str, Any] = {"position": [told[axis] for axis in axes]}
    if "qw" in told:
        quantities["quaternion"] = [told[name] for name in ("qx", "qy", "qz", "qw")]
    quantities |= {name: told[name] for name in (*BOUNDS, UP_TO_SCALE) if name in told}
    (answer,) = documents(joints, [q], **{name: [value] for name, value in quantities.items()})
    document = answer | meaning(loaded.about, frame)
    if (outside := loaded.outside(q)) is not None:
        note(f"no answer: {joints.beyond(loaded, q) or outside}")
        return Outcome(document, code=NO)
    table = answer_table(joints, [answer], positions, axes, bounds_shown(loaded, frame))
    alone = " ".join(fixed(told[axis] * positions.factor, 4) for axis in axes)
    lines: list[str | TextTable] = [table]
    if "quaternion" in answer:
        turned = " ".join(fixed(value, 6) for value in answer["quaternion"])
        lines.append(f"quaternion {turned}")
    if UP_TO_SCALE in told:
        from ..space import say_size

        say_size(told[UP_TO_SCALE])
    return Outcome(document, lines, result=[alone])


def _told_at(model: Model, q: ArrayLike, readout: str | None, frame: str) -> dict[str, Array]:
    """Return what is told of joints (n, dof) or (dof,) in a frame, by column of a table."""
    import numpy as np

    from calib.model.answers import forward_bounds

    from ..answers import BOUNDS

    x = model.forward(q, readout)
    columns = dict(zip(model.axes, x.T, strict=True))
    bounds = zip(BOUNDS, forward_bounds(model, q, x, readout), strict=True)
    if len(model.axes) == 2 and frame != "base":
        return columns | dict(bounds)
    from ..space import seen_forward

    seen = seen_forward(model, np.atleast_2d(q), frame)
    columns |= {name: np.reshape(column, x.shape[:-1]) for name, column in seen.items()}
    return columns | {name: columns.pop(name, bound) for name, bound in bounds}


def _batch(
    model: Model,
    joints: JointFormat,
    positions: PositionFormat,
    source: str,
    called: Mapping[str, str] | None,
    readout: str | None,
    output: str | None,
    frame: str,
) -> Outcome:
    """Answer a table of joint values with positions in a frame."""
    import numpy as np

    from calib.errors import QueryError
    from calib.samples.joint_values import check_joint_values

    from ..answers import batch_outcome, over_all_rows, read_table

    batch, about = read_table(source, joints.names, called), model.about
    q = batch.values / np.array(joints.typed)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(q, *ranges, degrees=joints.degrees, error=QueryError)
    valid = np.isfinite(q).all(axis=1)
    columns = over_all_rows(valid, _told_at(model, q[valid], readout, frame))
    outside = (np.flatnonzero(valid & np.isnan(columns["x"])) + 1).tolist()
    why = "outside of what was learned"
    told = meaning(about, frame)
    return batch_outcome(joints, positions, batch, columns, outside, why, output, **told)
