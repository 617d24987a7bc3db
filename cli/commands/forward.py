"""The command `calib query forward`: the position of the tip for joint values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from ..options import takes
from ..output import NO, fixed, note, show_json
from ..units import JointFormat, meaning
from ..usage import argument, check_count, check_streams, typed_numbers

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calib import Model
    from calib.common.arrays import Array


@takes(values=argument("Q1 Q2", "Joint values, base to tip [rad or m]."))
def forward(
    model: str,
    values: list[str] | None = None,
    readout: str | None = None,
    input_: str | None = None,
    output: str | None = None,
    frame: str = "sensor",
    degrees: bool = False,
    as_json: bool = False,
) -> None:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    import calib

    from ..answers import BOUNDS, UP_TO_SCALE, answers, bounds_shown, show_answers

    typed = typed_numbers(values)
    check_streams(typed, input_, output, as_json)
    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    if input_ is not None:
        raise typer.Exit(_batch(loaded, joints, input_, readout, (output, as_json), frame))
    check_count(typed, joints.names, "joint value")
    q = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    told = {name: float(value) for name, value in _told_at(loaded, q, readout, frame).items()}
    axes = "xyz" if frame == "base" else loaded.axes
    quantities: dict[str, Any] = {"position": [told[axis] for axis in axes]}
    if "qw" in told:
        quantities["quaternion"] = [told[name] for name in ("qx", "qy", "qz", "qw")]
    quantities |= {name: told[name] for name in (*BOUNDS, UP_TO_SCALE) if name in told}
    (answer,) = answers(joints, [q], **{name: [value] for name, value in quantities.items()})
    if as_json:
        show_json({**answer, **meaning(loaded.about, frame)})
    if (outside := loaded.outside(q)) is not None:
        note(f"no answer: {joints.beyond(loaded, q) or outside}")
        raise typer.Exit(NO)
    if as_json:
        return
    unit = "m" if frame == "base" else loaded.about.unit
    show_answers(joints, [answer], unit, axes, bounds_shown(loaded, frame))
    if "quaternion" in answer:
        print("quaternion " + " ".join(fixed(value, 6) for value in answer["quaternion"]))
    if UP_TO_SCALE in told:
        from ..space import say_size

        say_size(told[UP_TO_SCALE])


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
    source: str,
    readout: str | None,
    streams: tuple[str | None, bool],
    frame: str,
) -> int:
    """Answer a table of joint values with positions in a frame; return the exit code."""
    import numpy as np

    from calib.errors import QueryError
    from calib.samples.joint_values import check_joint_values
    from calib.samples.tables import read_batch

    from ..answers import over_all_rows, write_batch

    batch, about = read_batch(source, joints.names), model.about
    q = batch.values / np.array(joints.typed)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(q, *ranges, degrees=joints.degrees, error=QueryError)
    valid = np.isfinite(q).all(axis=1)
    columns = over_all_rows(valid, _told_at(model, q[valid], readout, frame))
    outside = (np.flatnonzero(valid & np.isnan(columns["x"])) + 1).tolist()
    why = "outside of what was learned"
    return write_batch(model, joints, batch, columns, outside, why, streams, frame)
