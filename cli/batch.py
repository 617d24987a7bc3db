"""Batches: many queries in one table, their answers in another, row by row.

This file is imported only for a batch: it needs NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.common.arrays import Array
from calib.errors import QueryError
from calib.model.answers import forward_bounds
from calib.samples.joint_values import check_joint_values
from calib.samples.roles import QUATERNION
from calib.samples.tables import Batch, read_batch, write_table

from .output import NO, Notes, note, show_json
from .units import JointFormat, meaning
from .usage import BadOption

if TYPE_CHECKING:
    from calib import Model

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""

_TOLD = 10  # so many rows are named at most


@dataclass(frozen=True)
class Streams:
    """Where the queries of a batch come from and how their answers go."""

    source: str  # table of queries; `-` is standard input
    # table of answers; `-` is standard output. None prints them there too, or puts them into the
    # JSON document.
    target: str | None
    as_json: bool  # whether to print a JSON document

    def answer(
        self,
        columns: Mapping[str, Any] | None,
        joints: JointFormat,
        key: str = "answers",
        **told: Any,
    ) -> None:
        """Write the answers, None for no table, and print what is told with them as a document.

        The document holds the answers in SI units by a key, where no file does.
        """
        if columns is not None and (self.target is not None or not self.as_json):
            write_table("-" if self.target is None else self.target, columns)
        if self.as_json:
            inside = {}
            if columns is not None and self.target is None:
                inside = {key: joints.in_si(columns)}
            show_json({"output": columns and self.target, **told, **inside})


def told_at(model: Model, q: ArrayLike, readout: str | None, frame: str) -> dict[str, Array]:
    """Return what is told of joints (n, dof) or (dof,) in a frame, by column of a table."""
    x = model.forward(q, readout)
    columns = dict(zip(model.axes, x.T, strict=True))
    bounds = zip(BOUNDS, forward_bounds(model, q, x, readout), strict=True)
    if len(model.axes) == 2 and frame != "base":
        return columns | dict(bounds)
    from .space import seen_forward

    seen = seen_forward(model, np.atleast_2d(q), frame)
    columns |= {name: np.reshape(column, x.shape[:-1]) for name, column in seen.items()}
    return columns | {name: columns.pop(name, bound) for name, bound in bounds}


def forward_batch(
    model: Model, joints: JointFormat, streams: Streams, readout: str | None, frame: str = "sensor"
) -> int:
    """Answer a table of joint values with positions in a frame; return the exit code."""
    batch = read_batch(streams.source, joints.names)
    q: Array = batch.values / np.array(joints.typed)
    valid = np.asarray(np.isfinite(q).all(axis=1))
    check_joints(model, q, joints)
    # rows that are no numbers are asked at the ranges' lower ends: one call answers all
    told = told_at(model, np.where(valid[:, None], q, model.about.lower), readout, frame)
    columns = {name: np.where(valid, column, np.nan) for name, column in told.items()}
    outside = (np.flatnonzero(valid & np.isnan(columns["x"])) + 1).tolist()
    why = "outside of what was learned"
    return _finish(model, joints, columns, streams, batch, outside, why, frame)


def inverse_batch(
    model: Model,
    joints: JointFormat,
    streams: Streams,
    readout: str | None,
    near: Sequence[float] | None,
    frame: str = "sensor",
    *,
    every: bool = False,
) -> int:
    """Answer a table of positions or poses with joint values; return the exit code.

    A target out of reach has no joint values, but its distance from the nearest
    attainable point.

    joints : unit of the joint values in both tables
    streams : the tables.  Columns near_JOINT, one for each, choose the branch row by row; of an arm
        in space with six joints, qx, qy, qz, qw ask for an orientation too.
    readout, near : passed on to `Model.solve`
    frame : {"sensor", "base"}, of the positions
    every : whether to write all branches of each pose, a row each
    """
    base, beside = frame == "base", [f"near_{name}" for name in joints.names]
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    turns = QUATERNION if len(joints.names) >= 6 and (base or len(model.axes) == 3) else ()
    batch = read_batch(streams.source, "xyz" if base else model.axes, (beside, turns))
    posed = bool(turns) and "qw" in batch.names
    if every and not posed:
        raise BadOption("--all of many targets is for poses: expected columns qx, qy, qz, qw")
    if (posed or base) and readout is not None:
        raise BadOption("--readout is for positions in the sensor's frame alone")
    valid = np.asarray(np.isfinite(batch.values).all(axis=1))
    asked, n = batch.values[valid], len(batch.values)
    given = dict(zip(batch.names, asked.T, strict=True))
    x = asked[:, : 3 if base else len(model.axes)]
    anchor: ArrayLike | None = near
    if beside[0] in batch.names:
        anchor = np.stack([given[name] for name in beside], axis=1) / joints.typed
    rows = np.flatnonzero(valid)
    names = ("distance", *(["turned"] if posed else []), *BOUNDS)
    answered: dict[str, NDArray[Any]] = {}
    missed: list[int] = []
    if len(x):
        found: Any
        if posed or base:
            from calib.model.poses import solve_poses

            turn = np.stack([given[name] for name in QUATERNION], axis=1) if posed else None
            found = solve_poses(model, x, turn, anchor, frame=frame, every=every)
            rows = rows[found.target]  # with every branch a target has several answers
        else:
            found = model.solve(x, anchor, readout)
        q = np.where(found.reachable[:, None], found.q * joints.typed, np.nan)
        answered = dict(zip(joints.names, q.T, strict=True))
        answered |= {name: getattr(found, name) for name in (*names, "reachable")}
        if base:
            from calib.model.space import Space

            from .space import up_to_scale

            answered |= up_to_scale(Space.of(model), found.q)
        missed = (rows[~found.reachable] + 1).tolist()
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    place = valid[index]
    numbers: dict[str, NDArray[Any]] = {"row": index + 1} if every else {}
    numbers |= {name: np.full(len(index), np.nan) for name in (*joints.names, *names, *answered)}
    numbers["reachable"] = np.zeros(len(index), dtype=np.int64)
    for name, column in answered.items():
        numbers[name][place] = column
    told = batch.take(index) if every else batch
    return _finish(model, joints, numbers, streams, told, missed, "out of reach", frame, n)


def _finish(
    model: Model,
    joints: JointFormat,
    added: Mapping[str, NDArray[Any]],
    streams: Streams,
    batch: Batch,
    refused: Sequence[int],
    why: str,
    frame: str = "sensor",
    n: int | None = None,
) -> int:
    """Write the answers, say which rows have none, and return the exit code."""
    columns, invalid = batch.answered(added), batch.invalid
    n = len(batch.values) if n is None else n
    units = meaning(model.about, frame)
    streams.answer(columns, joints, rows=n, invalid=invalid, out_of_reach=refused, **units)
    Notes().say(batch.notes(list(added)))
    say_rows(invalid, n, "not all values are numbers, no answer")
    say_rows(refused, n, why)
    return 1 if invalid else NO if refused else 0


def check_joints(model: Model, q: Array, joints: JointFormat) -> None:
    """Refuse joint values (n, dof) [rad or m] that can only be of another unit."""
    about = model.about
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(q, *ranges, degrees=joints.degrees, error=QueryError)


def numbered(numbers: Sequence[int]) -> str:
    """Name rows by their numbers, the first few of them."""
    shown = ", ".join(map(str, numbers[:_TOLD]))
    more = f" and {len(numbers) - _TOLD} more" if len(numbers) > _TOLD else ""
    return f"row{'s' if len(numbers) > 1 else ''} {shown}{more}"


def say_rows(numbers: Sequence[int], of: int, what: str) -> None:
    """Say what is the matter with some rows, if there are any."""
    if numbers:
        note(f"{numbered(numbers)} of {of}: {what}")
