"""Paths: joint trajectories through waypoints."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..common.rows import checked_rows
from ..errors import QueryError
from ..inverse.tracking import follow_targets
from . import answers
from .parts import Parts

_STEP = 0.01  # of the workspace's extent, where no step is given
_MOST = 1_000_000  # rows of a path


@dataclass(frozen=True, eq=False)
class Path:
    """Joints along straight lines through waypoints, without times; one row for each target."""

    target: Array  # (k, m) [unit], points on the lines between the waypoints
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
    # whichever way the path is followed from its start
    jumps: NDArray[np.intp]
    # (k,), rows that were left out: a tenth of the workspace and more beyond all that the arm
    # reaches; joints stay as they were
    held: NDArray[np.bool_]


def follow_path(
    model: Parts, waypoints: ArrayLike, start: ArrayLike | None, step: float | None
) -> Path:
    """Follow waypoints; see :meth:`calib.Model.path`."""
    corners, single = checked_rows(waypoints, model.axes, "waypoints")
    if single or len(corners) < 2:
        raise QueryError(
            f"a path needs 2 waypoints or more, got {len(corners)}: add rows, or ask for the "
            "inverse of a single one"
        )
    if step is None:
        step = _STEP * model.solver.extent
    if not step > 0:
        raise QueryError(f"step {step!r}: expected a length greater than zero, such as 0.005")
    x, waypoint = _lines(corners, float(step))
    first = None if start is None else answers.anchor(model, start, 1)[0]
    track = follow_targets(model.solver, answers.in_sight(model, x), first)
    answered = answers.answer(model, track.u, x)
    jumps = np.array(track.jumps, dtype=np.intp)
    return Path(x, *answered, waypoint, jumps, track.held)


def _lines(corners: Array, step: float) -> tuple[Array, NDArray[np.intp]]:
    """Points at most `step` apart on the lines between corners, and where each leads to."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        total = float(length.sum())
    if not math.isfinite(total):
        raise QueryError("the waypoints are too far apart to draw lines between them")
    if total / step + len(corners) > _MOST:
        raise QueryError(
            f"step {step:g} makes more than {_MOST:,} rows of a path {total:.4g} long: "
            "give a longer one"
        )
    points, leads = [corners[:1]], [np.zeros(1, dtype=np.intp)]
    for k, (a, b) in enumerate(itertools.pairwise(corners)):
        # rounding of the length must not add a row
        parts = max(1, math.ceil(float(length[k]) / step - 1e-9))
        share = np.arange(1, parts + 1)[:, None] / parts
        points.append(a + (b - a) * share)
        points[-1][-1] = b
        leads.append(np.full(parts, k + 1, dtype=np.intp))
    return np.concatenate(points), np.concatenate(leads)
