"""Paths: joint values along straight lines of the tip, in a sensor's frame or the base frame."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index, Mask
from ..common.choices import FRAMES, check_choice
from ..common.inputs import query_rows
from ..common.rows import row_lengths
from ..errors import QueryError
from ..inverse.newton import Iterate, Newton
from ..inverse.settings import SOLVER
from ..inverse.solver import Solver
from ..maps.map import Map
from .answers import (
    Answer,
    describe_joints,
    limited_targets,
    near_in_box,
    rows_for,
)
from .parts import ModelParts
from .reach import Reach
from .space import REACHED, Space
from .turns import unwound


@dataclass(frozen=True)
class PathSettings:
    """How a path is divided and followed, and which of its rows turn fast."""

    # of the workspace's extent, where no step is given
    step: float = 0.01
    most_rows: int = 1_000_000
    # of the arm's length: targets of the base frame that are further away are not followed
    furthest: float = 1.1
    # a joint turns fast by more than `turn` [rad] from one row to the next, if that is more than
    # `faster` [rad] for each extent of the workspace that the tip moves: usual rows have 0.03 and
    # 3, those beside the first axis 0.7 and 70
    turn: float = 0.2
    faster: float = 20.0
    # How joints follow a target.
    # of the ranges: joints that move further are looked at closely
    smooth: float = 0.05
    # share of a step: joints that do not follow a smaller one leave their branch
    least: float = 1e-3
    # of the workspace, and of its nodes' spacing: targets further away from all nodes are
    # not followed
    outside: float = 0.1
    spacings: float = 1.5
    front: int = 8  # solutions of redundant joints that set out together
    # iterations of a small step: a target that takes more is out of reach
    few: int = 20
    # of the way to the middle: so far redundant joints drift there
    drift: float = 0.02


PATH = PathSettings()


@dataclass(frozen=True, eq=False)
class Path:
    """Joints along straight lines through waypoints, without times; one row for each target."""

    # (k, m) [unit, m in the base frame], points on the lines between the waypoints
    target: Array
    # see `Answer`; joints stay on one branch between jumps
    q: Array
    position: Array
    distance: Array
    expected_error: Array
    model_error: Array
    reachable: Mask
    # (k,), index of the waypoint that each row leads to; the last such row is on it
    waypoint: Index
    # (j,), rows whose joints do not follow from those of the row before: the branch ends there,
    # whichever way the path is followed from its start, or a joint has to turn round at its limit
    jumps: Index
    # (k,), rows that are left out: a tenth of the workspace and more beyond all that the arm
    # reaches; joints stay as they were
    left_out: Mask
    # (j,), rows to which the joints turn far while the tip moves little: near an axis, or where
    # the elbow is stretched
    fast_turns: Index

    def __repr__(self) -> str:
        """Summarise in a line how many rows there are, what is out of reach, and where it jumps."""
        unreachable = int(np.sum(~self.reachable))
        return (
            f"Path of {len(self.q)} rows: {unreachable} out of reach, "
            f"{len(self.jumps)} jumps"
        )


@dataclass(frozen=True)
class PathTask:
    """Following a path in the frame of a sensor, or in the base frame."""

    axes: tuple[str, ...]
    solver: Solver
    extent: float  # of the workspace [unit, m in the base frame]
    # whether targets (n, m) are close enough to what the arm reaches to be followed, (n,)
    is_close: Callable[[Array], Mask]
    # describes joints (n, dof) of the unit box that answer targets (n, m)
    describe: Callable[[Array, Array], Answer]

    @staticmethod
    def of(model: ModelParts, frame: str) -> PathTask:
        """The task of a model in the frame "sensor" or "base"."""
        if frame == "base":
            space = Space.of(model)
            return PathTask(
                ("x", "y", "z"),
                Reach.of(space, posed=False).solver,
                2 * space.length,
                lambda x: row_lengths(x) <= PATH.furthest * space.length,
                partial(_in_base, space),
            )
        return PathTask(
            model.axes,
            model.solver,
            model.solver.extent,
            partial(close_to_map, model.sensory),
            partial(describe_joints, model),
        )


def follow_path(
    model: ModelParts,
    waypoints: ArrayLike,
    start: ArrayLike | None,
    step: float | None,
    frame: str,
) -> Path:
    """Follow waypoints; see :meth:`calib.Model.path`."""
    check_choice("frame", frame, FRAMES, QueryError)
    task = PathTask.of(model, frame)
    corners, single = query_rows(waypoints, task.axes, "waypoints")
    if single or len(corners) < 2:
        raise QueryError(
            f"a path needs 2 waypoints or more, got {len(corners)}: add rows, or ask for the "
            "inverse of a single one"
        )
    if step is None:
        step = PATH.step * task.extent
    if not step > 0:
        raise QueryError(
            f"step {step!r}: expected a length greater than zero, such as 0.005"
        )
    x, waypoint = _lines(corners, float(step))
    targets = limited_targets(model, x)
    close = task.is_close(targets)
    first = None if start is None else near_in_box(model, start, 1)[0]
    u, jumps = follow_targets(task.solver, targets, close, first)
    answers = task.describe(u, x)
    begin = answers.q[0]
    if start is not None:
        begin = rows_for(start, model.about.joint_names, "start", 1)[0]
    q, turned = unwound(model, answers.q, begin)
    answers = answers._replace(q=q)
    jumps = np.union1d(jumps, turned)
    way = row_lengths(np.diff(x, axis=0)) / task.extent
    fast_turns = np.setdiff1d(
        _fast_turns(q[:, model.about.revolute], way), jumps
    )
    return Path(x, *answers[:6], waypoint, jumps, ~close, fast_turns)


def _fast_turns(angles: Array, way: Array) -> Index:
    """Rows to which a joint turns far while the tip moves little.

    angles : (n, joints) [rad], of those that turn
    way : (n - 1,), from each row to the next, in extents of the workspace
    """
    turn = np.abs(np.diff(angles, axis=0)).max(axis=1, initial=0.0)
    fast = turn > np.maximum(PATH.turn, PATH.faster * way)
    return np.flatnonzero(fast) + 1


def _in_base(space: Space, u: Array, x: Array) -> Answer:
    """Describe joints `u` (n, dof) of the unit box that answer targets (n, 3) of the base frame."""
    q = space.model.motor.scale.from_unit(u)
    position = space.evaluate(q)[0]
    distance = row_lengths(position - x)
    bound = space.bound(q)
    reachable = distance <= REACHED * space.length
    return Answer(
        q, position, distance, bound, bound, reachable, np.arange(len(q))
    )


def _lines(corners: Array, step: float) -> tuple[Array, Index]:
    """Points at most `step` apart on the lines between corners, and where each leads to."""
    with np.errstate(over="ignore"):
        length = row_lengths(np.diff(corners, axis=0))
        total = float(length.sum())
    few = total / step + len(corners) <= PATH.most_rows
    if not few or not math.isfinite(total):
        raise QueryError(
            f"step {step:g} makes more than {PATH.most_rows:,} rows of a path {total:.4g} long: "
            "give a longer one"
        )
    # rounding of the length must not add a row
    counts = np.maximum(1, np.ceil(length / step - 1e-9)).astype(np.intp)
    points = [corners[:1]]
    for before, after, count in zip(corners, corners[1:], counts, strict=False):
        points.append(np.linspace(before, after, count + 1)[1:])
    waypoint = np.repeat(np.arange(len(corners)), np.append(1, counts))
    return np.concatenate(points), waypoint


def follow_targets(
    solver: Solver, x: Array, close: Mask, start: Array | None
) -> tuple[Array, Index]:
    """Joints (k, dof) that follow targets `x` (k, m) in their order, with as few jumps as possible.

    Also the rows that joints reach only by leaving their branch.  `close` (k,) are the targets
    that are close enough to what the arm reaches to be followed.

    Every solution of the first target sets out, of redundant joints those nearest to their middle,
    or the one nearest to `start` (dof,); the one that gets furthest is taken, of several the one
    that moves least.  Where it ends the solutions of the next target set out, and so on.  Out of
    reach joints stay as close as they can, which is no jump; far beyond they wait.
    """
    near = np.flatnonzero(close)
    if not len(near):
        # the first alone: nothing more is learned from the others
        near = np.array([0])
        if start is None:
            start = np.full(solver.newton.scale.span.shape, 0.5)
    targets = x[near]
    if start is None:
        front = _front(solver, targets[0])
    else:
        front, _ = solver.solve(targets[:1], start[None])
    rows = _furthest(solver, targets, front)
    jumps: list[int] = []
    while len(rows) < len(targets):
        rest = targets[len(rows) :]
        jumps.append(len(rows))
        front = _front(solver, rest[0])
        # of branches that are as good the closest one: the first counts
        gap = solver.newton.away(front, rows[-1])
        order = np.argsort(gap, kind="stable")
        followed = _furthest(solver, rest, front[order])
        rows = np.concatenate([rows, followed])
    # where joints wait: at the last target that is close
    places = np.arange(len(x))
    latest = np.searchsorted(near, places, side="right") - 1
    joints = rows[np.maximum(latest, 0)]
    return joints, near[np.array(jumps, dtype=np.intp)]


def close_to_map(sensory: Map, x: Array) -> Mask:
    """Whether targets (k, m) are close enough to nodes of the map to be followed."""
    place = sensory.scale.to_unit(x)
    away, _ = sensory.nearest(place)
    spacings = PATH.spacings * sensory.spacing
    furthest = max(PATH.outside, spacings)
    return away[:, 0] <= furthest


def _front(solver: Solver, x: Array) -> Array:
    """Solutions of one target, of redundant joints some of each family, (n, dof)."""
    families = solver.solve_all(x[None]).u
    if not solver.redundant:
        return families
    others = solver.every(x[None]).u
    front = np.concatenate([families, others])
    return front[: PATH.front]


def _furthest(solver: Solver, x: Array, front: Array) -> Array:
    """Rows of the joints (n, dof) that follow targets (k, m) furthest, (at most k, dof)."""
    history = [front]
    length = np.zeros(len(front))
    alive = np.arange(len(front))
    for before, target in itertools.pairwise(x):
        rows = history[-1].copy()
        u = rows[alive]
        moved, going = _advance(solver, u, before, target)
        if not going.any():
            break
        rows[alive] = moved
        length[alive] += solver.newton.away(moved, u)
        alive = alive[going]
        history.append(rows)
    lengths = length[alive].round(6)
    shortest = np.argmin(lengths)
    best = alive[shortest]
    return np.stack(history)[:, best]


def _advance(
    solver: Solver, start: Array, begin: Array, end: Array
) -> tuple[Array, Mask]:
    """Joints (n, dof) moved along a line, in pieces if far, and whether they kept to it."""
    newton = solver.newton
    line = end - begin
    u = start.copy()
    share = np.zeros(len(u))  # of the line that joints have followed
    piece = np.ones(len(u))
    rows = np.arange(len(u))
    is_whole = True  # whether the whole line is tried
    while len(rows):
        ahead = np.minimum(share[rows] + piece[rows], 1.0)
        targets = begin + ahead[:, None] * line
        iterate = _step(newton, u[rows], targets)
        shift = newton.away(iterate.u, u[rows])
        smooth = shift <= PATH.smooth
        met = newton.is_met(iterate.distance)
        smooth &= met | (ahead < 1.0)
        if is_whole and not smooth.all() and not _reaches(solver, end):
            smooth[:] = True  # joints are as close as they can be
        is_whole = False
        moved = rows[smooth]
        u[moved] = iterate.u[smooth]
        share[moved] = ahead[smooth]
        piece[rows] *= np.where(smooth, 2.0, 0.5)
        going = share < 1.0
        going &= piece >= PATH.least
        rows = np.flatnonzero(going)
    return u, share == 1.0


def _step(newton: Newton, u: Array, targets: Array) -> Iterate:
    """Joints (n, dof) of the next targets (n, m); spare ones drift to their middle."""
    if newton.redundant:
        middle = np.full(u.shape, 0.5)
        to_middle = newton.scale.difference(middle, u)
        here = newton.at(u, targets)
        drift = newton.tangent(here, PATH.drift * to_middle)
        u = u + drift
    return newton.refine(u, targets, SOLVER.close, PATH.few)


def _reaches(solver: Solver, x: Array) -> bool:
    """Whether the links lead to joints that meet a target (m,)."""
    newton = solver.newton
    targets = x[None]
    owner, start = solver.starts.of(targets)
    iterate = newton.refine(start, targets[owner], SOLVER.close)
    met = newton.is_met(iterate.distance)
    return bool(met.any())
