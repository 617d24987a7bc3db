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

from .output import NO, Notes, note, show_json
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

    def write(self, columns: Mapping[str, Any]) -> None:
        """Write the answers, where they do not go into the document."""
        if self.target is not None or not self.as_json:
            write_table("-" if self.target is None else self.target, columns)

    def inside(self, key: str, joints: JointFormat, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Answers as the document holds them, in SI units; nothing where a file does."""
        return {} if self.target is not None else {key: joints.in_si(columns)}


def forward_batch(
    model: Model,
    joints: JointFormat,
    streams: Streams,
    readout: str | None,
    frame: str = "sensor",
) -> int:
    """Answer a table of joint values with positions in a frame; return the exit code."""
    batch = read_batch(streams.source, joints.names)
    q: Array = batch.values / np.array(joints.typed)
    valid = np.asarray(np.isfinite(batch.values).all(axis=1))
    check_joints(model, q, joints)
    x, bounds = np.full((len(q), len(model.axes)), np.nan), np.full((2, len(q)), np.nan)
    if valid.any():
        x[valid] = model.forward(q[valid], readout)
        bounds[:, valid] = forward_bounds(model, q[valid], x[valid], readout)
    columns = dict(zip(model.axes, x.T, strict=True))
    if len(model.axes) == 3 or frame == "base":
        from .space import seen_forward

        added = seen_forward(model, np.where(valid[:, None], q, model.about.lower), frame)
        columns |= {name: np.where(valid, column, np.nan) for name, column in added.items()}
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

    A target out of reach has no joint values, but its distance from the nearest attainable
    point.
    """
    batch = read_batch(streams.source, model.axes)
    n, valid = len(batch.values), np.isfinite(batch.values).all(axis=1)
    names = (*joints.names, "distance", "expected_error", "model_error", "reachable")
    columns: dict[str, NDArray[Any]] = {name: np.full(n, np.nan) for name in names}
    columns["reachable"] = np.zeros(n, dtype=np.int64)
    if valid.any():
        answer = model.solve(batch.values[valid], near, readout)
        q = np.where(answer.reachable[:, None], answer.q * joints.typed, np.nan)
        found = (*q.T, answer.distance, answer.expected_error, answer.model_error, answer.reachable)
        for name, part in zip(names, found, strict=True):
            columns[name][valid] = part
    missed = np.flatnonzero(valid & (columns["reachable"] == 0)) + 1
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
    streams.write(columns)
    if streams.as_json:
        show_json(
            {
                "output": streams.target,
                "rows": n,
                "invalid": invalid,
                "out_of_reach": refused,
                **meaning(model.about, frame),
                **streams.inside("answers", joints, columns),
            }
        )
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
