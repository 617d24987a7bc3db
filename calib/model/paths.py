"""Paths: joint values along straight lines of the tip, in a sensor's frame or the base frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..common.choices import FRAMES, check_choice
from ..common.inputs import query_rows
from ..errors import QueryError
from ..inverse.tracking import close_to_map, follow_targets
from .answers import Answer, anchor, answer, in_sight, rows_for
from .parts import Parts
from .reach import Reach
from .space import REACHED, Space
from .turns import unwound


@dataclass(frozen=True)
class PathSettings:
    """How a path is divided, and which of its rows turn fast."""

    # of the workspace's extent, where no step is given
    step: float = 0.01
    most_rows: int = 1_000_000
    # of the arm's length: targets of the base frame that are further away are not followed
    furthest: float = 1.1
    # a joint turns fast by more than this [rad] from one row to the next, which is so much for each
    # extent of the workspace [rad] that the tip moves: usual rows have 0.03 and 3, those beside the
    # first axis 0.7 and 70
    turn: float = 0.2
    faster: float = 20.0


PATHS = PathSettings()


@dataclass(frozen=True, eq=False)
class Path:
    """Joints along straight lines through waypoints, without times; one row for each target."""

    # (k, m) [unit, m in the base frame], points on the lines between the waypoints
    target: Array
    # as of `Answer`; joints stay on one branch between jumps
    q: Array
    position: Array
    distance: Array
    expected_error: Array
    model_error: Array
    reachable: NDArray[np.bool_]
    # (k,), index of the waypoint that each row leads to; the last such row stands on it
    waypoint: NDArray[np.intp]
    # (j,), rows whose joints do not follow from those of the row before: the branch ends there,
    # whichever way the path is followed from its start, or a joint has to turn round at its limit
    jumps: NDArray[np.intp]
    # (k,), rows that are left out: a tenth of the workspace and more beyond all that the arm
    # reaches; joints stay as they were
    left_out: NDArray[np.bool_]
    # (j,), rows to which the joints turn far while the tip moves little: beside an axis, or where
    # the elbow is stretched
    fast_turns: NDArray[np.intp]

    def __repr__(self) -> str:
        """Say in a line how many rows there are, what is out of reach, and where it jumps."""
        unreachable = int(np.sum(~self.reachable))
        return (
            f"Path of {len(self.q)} rows: {unreachable} out of reach, "
            f"{len(self.jumps)} jumps"
        )


def follow_path(
    model: Parts,
    waypoints: ArrayLike,
    start: ArrayLike | None,
    step: float | None,
    frame: str,
) -> Path:
    """Follow waypoints; see :meth:`calib.Model.path`."""
    check_choice("frame", frame, FRAMES, QueryError)
    space = Space.of(model) if frame == "base" else None
    axes = model.axes if space is None else ("x", "y", "z")
    corners, single = query_rows(waypoints, axes, "waypoints")
    if single or len(corners) < 2:
        raise QueryError(
            f"a path needs 2 waypoints or more, got {len(corners)}: add rows, or ask for the "
            "inverse of a single one"
        )
    search = model.solver
    extent = search.extent
    if space is not None:
        search = Reach.of(space, posed=False).search
        extent = 2 * space.length
    if step is None:
        step = PATHS.step * extent
    if not step > 0:
        raise QueryError(
            f"step {step!r}: expected a length greater than zero, such as 0.005"
        )
    x, waypoint = _lines(corners, float(step))
    targets = in_sight(model, x)
    if space is None:
        close = close_to_map(model.sensory, targets)
    else:
        away = np.linalg.norm(targets, axis=1)
        close = away <= PATHS.furthest * space.length
    first = None if start is None else anchor(model, start, 1)[0]
    u, jumps = follow_targets(search, targets, close, first)
    answers = answer(model, u, x) if space is None else _in_base(space, u, x)
    begin = answers.q[0]
    if start is not None:
        begin = rows_for(start, model.about.joint_names, "start", 1)[0]
    q, turned = unwound(model, answers.q, begin)
    answers = answers._replace(q=q)
    jumps = np.union1d(jumps, turned)
    turn = np.abs(np.diff(q, axis=0))[:, model.about.revolute].max(
        1, initial=0.0
    )
    way = np.linalg.norm(np.diff(x, axis=0), axis=1) / extent
    fast = turn > np.maximum(PATHS.turn, PATHS.faster * way)
    fast_turns = np.setdiff1d(np.flatnonzero(fast) + 1, jumps)
    return Path(x, *answers[:6], waypoint, jumps, ~close, fast_turns)


def _in_base(space: Space, u: Array, x: Array) -> Answer:
    """Describe joints `u` (n, dof) of the unit box that answer targets (n, 3) of the base frame."""
    q = space.model.motor.scale.from_unit(u)
    position = space.evaluate(q)[0]
    distance = np.linalg.norm(position - x, axis=1)
    bound = space.bound(q)
    reachable = distance <= REACHED * space.length
    return Answer(
        q, position, distance, bound, bound, reachable, np.arange(len(q))
    )


def _lines(corners: Array, step: float) -> tuple[Array, NDArray[np.intp]]:
    """Points at most `step` apart on the lines between corners, and where each leads to."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        total = float(length.sum())
    few = total / step + len(corners) <= PATHS.most_rows
    if not few or not math.isfinite(total):
        raise QueryError(
            f"step {step:g} makes more than {PATHS.most_rows:,} rows of a path {total:.4g} long: "
            "give a longer one"
        )
    # rounding of the length must not add a row
    counts = np.maximum(1, np.ceil(length / step - 1e-9)).astype(np.intp)
    points = [corners[:1]]
    for before, after, count in zip(corners, corners[1:], counts, strict=False):
        points.append(np.linspace(before, after, count + 1)[1:])
    waypoint = np.repeat(np.arange(len(corners)), np.append(1, counts))
    return np.concatenate(points), waypoint
