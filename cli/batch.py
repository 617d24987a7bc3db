"""Batches: many queries in one table, their answers in another, row by row.

This file is imported only for a batch: it needs NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import QueryError
from calib.model.answers import forward_bounds
from calib.samples.joint_values import check_joint_values
from calib.samples.tables import Batch, read_batch, write_table

from .output import Notes, note, show_json
from .units import JointFormat, meaning

if TYPE_CHECKING:
    from calib import Model

Array = NDArray[np.float64]

_TOLD = 10  # so many rows are named at most


@dataclass(frozen=True)
class Streams:
    """Where the queries of a batch come from and how their answers go.

    Attributes
    ----------
    source : str
        Table of queries; `-` is standard input.
    target : str or None
        Table of answers; `-` is standard output. None prints them there too, or puts
        them into the JSON document.
    as_json : bool
        Whether to print a JSON document.
    """

    source: str
    target: str | None
    as_json: bool


def forward_batch(
    model: Model,
    joints: JointFormat,
    streams: Streams,
    readout: str | None,
    frame: str = "sensor",
) -> int:
    """Answer a table of joint values with positions; return the exit code.

    Parameters
    ----------
    model : Model
    joints : JointFormat
        Unit of the joint values in both tables.
    streams : Streams
        The tables.
    readout : str or None
        Passed on to `Model.forward`.
    frame : {"sensor", "base"}
        Of the positions.
    """
    batch = read_batch(streams.source, joints.names)
    typed = batch.values
    valid = np.isfinite(typed).all(axis=1)
    check_joints(model, typed / joints.typed, joints)
    x, bounds = np.full((len(typed), len(model.axes)), np.nan), np.full((2, len(typed)), np.nan)
    if valid.any():
        q = typed[valid] / joints.typed
        x[valid] = model.forward(q, readout)
        bounds[:, valid] = forward_bounds(model, q, x[valid], readout)
    columns = {axis: x[:, k] for k, axis in enumerate(model.axes)}
    more: dict[str, Array] = {}
    if len(model.axes) == 3 or frame == "base":
        from .space import seen_forward

        rows = np.tile(model.about.lower, (len(typed), 1))
        rows[valid] = typed[valid] / joints.typed
        added = seen_forward(model, rows, frame)
        more = {name: np.where(valid, column, np.nan) for name, column in added.items()}
    columns = {**columns, **more}
    for name, bound in zip(("expected_error", "model_error"), bounds, strict=True):
        columns[name] = columns.pop(name, bound)
    outside = np.flatnonzero(valid & np.isnan(x[:, 0])) + 1
    why = "outside of what was learned"
    return _finish(model, joints, columns, streams, batch, outside.tolist(), why, frame)


def inverse_batch(
    model: Model,
    joints: JointFormat,
    streams: Streams,
    readout: str | None,
    near: Sequence[float] | None,
) -> int:
    """Answer a table of positions with joint values; return the exit code.

    A target out of reach has no joint values, but its distance from the nearest
    attainable point.

    Parameters
    ----------
    model : Model
    joints : JointFormat
        Unit of the joint values in the table of answers.
    streams : Streams
        The tables.
    readout, near
        Passed on to `Model.solve`.
    """
    batch = read_batch(streams.source, model.axes)
    target = batch.values
    valid = np.isfinite(target).all(axis=1)
    n = len(target)
    q = np.full((n, len(joints.names)), np.nan)
    distance, bounds = np.full(n, np.nan), np.full((2, n), np.nan)
    reachable = np.zeros(n, dtype=np.int64)
    if valid.any():
        answer = model.solve(target[valid], near, readout)
        q[valid] = np.where(answer.reachable[:, None], answer.q * joints.typed, np.nan)
        distance[valid], reachable[valid] = answer.distance, answer.reachable
        bounds[:, valid] = answer.expected_error, answer.model_error
    columns: dict[str, NDArray[Any]] = {name: q[:, k] for k, name in enumerate(joints.names)}
    columns |= {"distance": distance, "expected_error": bounds[0], "model_error": bounds[1]}
    columns["reachable"] = reachable
    missed = np.flatnonzero(valid & (reachable == 0)) + 1
    return _finish(model, joints, columns, streams, batch, missed.tolist(), "out of reach")


def _finish(
    model: Model,
    joints: JointFormat,
    added: Mapping[str, NDArray[Any]],
    streams: Streams,
    batch: Batch,
    refused: Sequence[int],
    why: str,
    frame: str = "sensor",
) -> int:
    """Write the answers, say which rows have none, and return the exit code."""
    columns, invalid, n = batch.answered(added), batch.invalid, len(batch.values)
    if streams.target is not None or not streams.as_json:
        write_table("-" if streams.target is None else streams.target, columns)
    if streams.as_json:
        document: dict[str, Any] = {
            "output": streams.target,
            "rows": n,
            "invalid": invalid,
            "out_of_reach": refused,
            **meaning(model.about, frame),
        }
        if streams.target is None:
            document["answers"] = joints.in_si(columns)
        show_json(document)
    Notes().say(batch.notes(list(added)))
    for rows, what in ((invalid, "not all values are numbers, no answer"), (refused, why)):
        if rows:
            note(f"{numbered(rows)} of {n}: {what}")
    return 1 if invalid else 3 if refused else 0


def check_joints(model: Model, q: Array, joints: JointFormat) -> None:
    """Refuse joint values (n, dof) [rad or m] that can only be of another unit."""
    about = model.about
    check_joint_values(
        q,
        about.joint_names,
        about.lower,
        about.upper,
        about.revolute,
        degrees=joints.degrees,
        error=QueryError,
    )


def numbered(numbers: Sequence[int]) -> str:
    """Name rows by their numbers, the first few of them."""
    shown = ", ".join(map(str, numbers[:_TOLD]))
    more = f" and {len(numbers) - _TOLD} more" if len(numbers) > _TOLD else ""
    return f"row{'s' if len(numbers) > 1 else ''} {shown}{more}"
