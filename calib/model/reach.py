"""Reach: joints that bring the tip of an arm in space to places and poses of its base frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Index
from ..common.scale import TURN, Scale
from ..inverse.closed_form import ClosedForm
from ..inverse.newton import Newton
from ..inverse.settings import SOLVER
from ..inverse.slides import solve_near
from ..inverse.solutions import distinct, random_joints, rank_within, slices
from ..inverse.solver import Solver
from ..inverse.task import Evaluate, Poses, Positions, Task
from ..kernel.compiled import Flag, Library
from .compiled_queries import POSES, POSES_ALL, CompiledQuery, kernel_for
from .parts import remembered
from .space import REACHED, Space

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_ROWS = 2_000  # poses whose starts are held at a time, 20 MB
_LONG = 16  # times as many steps of Newton near a singularity
_OVERHANG = 0.1  # [rad] by which the drawing's joints may lie beyond the limits
_SAME = 1e-3  # of the joints' ranges: solutions that slide to one place are one
_FAMILIES = 4  # solutions of redundant joints for a pose that are answered


def _chunks(rows: Index) -> list[Index]:
    """Rows (n,) in parts whose starts fit into memory."""
    return np.split(rows, range(_ROWS, len(rows), _ROWS)) if len(rows) else []


@dataclass(frozen=True, eq=False)
class Reach:
    """A search for places (n, 3), or for poses (n, 12) of the base frame.

    Where none reaches a target, joints come near to it.
    """

    space: Space
    posed: bool
    # axis of the tip about which it may turn freely
    free_axis: int | None = None

    @staticmethod
    def of(space: Space, *, posed: bool, free_axis: int | None = None) -> Reach:
        """The search of a model, made once."""
        key = f"reach {posed} {free_axis}"
        return remembered(
            space.model, key, lambda: Reach(space, posed, free_axis)
        )

    @cached_property
    def solver(self) -> Solver:
        """The solver in NumPy."""
        newton = Newton(self._task, self._scale)
        return Solver(newton, self._starts)

    def lead(self, target: Array, near: Array) -> tuple[Array, Array]:
        """Lead joints `near` (n, dof) to targets: joints (n, dof), and their distances (n,) [m].

        Of a pose a radian of turn counts as the arm's length.
        """
        newton = self.solver.newton
        iterate = newton.refine(self._scale.to_unit(near), target)
        q = self._scale.from_unit(iterate.u)
        missing = iterate.distance
        # where two axes are nearly one, a small turn of the tool is a long way for the joints
        late = np.flatnonzero(missing > REACHED * self.space.length)
        if len(late):
            steps = _LONG * SOLVER.steps
            iterate = newton.refine(iterate.u[late], target[late], steps=steps)
            q[late] = self._scale.from_unit(iterate.u)
            missing[late] = iterate.distance
        return q, missing

    def nearest(self, target: Array, near: Array) -> Array:
        """Joints (n, dof) nearest to `near` (n, dof) for targets."""
        q = near.copy()
        rest = np.arange(len(q))
        kernel = self._kernel(POSES, len(q))
        if kernel is not None:
            question = self._question(target, alone=True)
            q, flags = kernel.rows(POSES.name, near, *question)
            unsure = np.flatnonzero(flags != Flag.CERTAIN)
            for rows in _chunks(unsure):
                question = self._question(target[rows])
                answered = kernel.rows(POSES.name, near[rows], *question)
                q[rows], flags[rows] = answered
            rest = np.flatnonzero(flags == Flag.NONE)
        if len(rest):
            near_u = self._unit(near[rest])
            iterate = self.solver.nearest(target[rest], near_u)
            q[rest] = self._scale.from_unit(iterate.u)
        return q

    def least_turn_joints(self, p: Array, near: Array) -> Array:
        """Joints (n, dof) for places (n, 3) that keep the orientation at `near` if they can."""
        space = self.space
        # positions weigh a thousand times as much as the turn
        task = Poses(
            space.evaluate, self._scale, 1e-3 * space.length, space.length
        )
        target = Poses.target(p, space.evaluate(near)[1])
        newton = Newton(task, self._scale)
        u = self._unit(near)
        kept_turn = newton.refine(u, target, steps=4 * SOLVER.steps).u
        return self._scale.from_unit(self.solver.nearest(p, kept_turn).u)

    def branches(self, target: Array, near: Array) -> list[Array]:
        """Joints (k, dof) of every solution of targets, nearest to `near` (n, dof) first.

        Redundant joints have infinitely many: these are some that are near.
        """
        kernel = None
        if not self.solver.redundant:
            kernel = self._kernel(POSES_ALL, len(target))
        if kernel is None:
            every = self.solver.every(target)
            rows = slices(every.target, len(target))
            solutions = [self._scale.from_unit(every.u[part]) for part in rows]
        else:
            solutions = self._solutions_by_kernel(kernel, target, near)
        near_u = self._unit(near)
        questions = zip(solutions, target, near_u, strict=True)
        return [self._ordered(*question) for question in questions]

    def _solutions_by_kernel(
        self, kernel: Library, target: Array, near: Array
    ) -> list[Array]:
        """Joints (k, dof) of solutions of targets, as compiled C finds them."""
        solutions: list[Array] = []
        for part in _chunks(np.arange(len(target))):
            question = self._question(target[part])
            q, count = kernel.rows(POSES_ALL.name, near[part], *question)
            counts = count.tolist()
            solutions += [rows[:k] for rows, k in zip(q, counts, strict=True)]
        return solutions

    def _ordered(self, q: Array, goal: Array, near_u: Array) -> Array:
        """Solutions (k, dof) of one goal, the nearest to `near_u` (dof,) in the unit box first.

        Where there is none, joints that come near to the goal.
        """
        newton = self.solver.newton
        if not len(q):
            iterate = self.solver.nearest(goal[None], near_u[None])
            return self._scale.from_unit(iterate.u)
        if not newton.redundant:
            away = newton.away(self._unit(q), near_u)
            return q[np.argsort(away, kind="stable")]
        size = len(q), 1
        iterate = solve_near(
            newton, self._unit(q), np.tile(goal, size), np.tile(near_u, size)
        )
        met = newton.is_met(iterate.distance)
        q[met] = self._scale.from_unit(iterate.u[met])
        u = self._unit(q)
        order = np.argsort(newton.away(u, near_u), kind="stable")
        owner = np.zeros(len(u), dtype=np.intp)
        single = distinct(self._scale, owner, u[order], _SAME)
        return q[order[single][:_FAMILIES]]

    @property
    def _task(self) -> Task:
        space = self.space
        length = space.length
        if not self.posed:
            return Positions.in_base(space.evaluate, self._scale, length)
        return Poses(
            space.evaluate, self._scale, length, length, self.free_axis
        )

    @cached_property
    def _starts(self) -> Postures | DrawnPostures:
        """Starts of the drawing's closed form where that answers, else a table's."""
        structure = self.space.structure
        closed = ClosedForm.of(structure.chain)
        columns = [0, 1, 2]
        if self.posed and self.free_axis is not None:
            columns += range(3 + self.free_axis, 12, 3)
        elif self.posed and closed is not None:
            beta = self.space.body.beta
            gain = beta[structure.groups["gain"]]
            offset = beta[structure.groups["offset"]]
            return DrawnPostures(closed, self._scale, gain, offset)
        elif self.posed:
            columns += range(3, 12)
        return Postures(
            self.space.evaluate, self._scale, self.space.length, tuple(columns)
        )

    def _kernel(self, query: CompiledQuery, rows: int) -> Library | None:
        """The compiled C, where it answers poses."""
        return kernel_for(self.space.model, query, rows) if self.posed else None

    def _question(self, target: Array, *, alone: bool = False) -> list[Array]:
        """The arguments of compiled C for poses, see ``c/many.h``.

        alone : whether the search starts at the joints of `near` alone
        """
        count = len(target)
        dof = len(self._scale.span)
        rotation = target[:, 3:].reshape(-1, 3, 3)
        place, orientation = self.space.to_sensor(target[:, :3], rotation)
        starts = np.zeros((count, 0, dof))
        if not alone:
            owner, u = self._starts.of(target)
            most = int(np.bincount(owner).max(initial=0))
            starts = np.full((count, most, dof), np.nan)  # where there are less
            starts[owner, rank_within(owner)] = self._scale.from_unit(u)
        axis = -1 if self.free_axis is None else self.free_axis
        choice = axis, self._starts.apart, starts.shape[1]
        return [
            place,
            quaternion_of(orientation),
            np.tile(choice, (count, 1)),
            starts.reshape(count, starts.shape[1] * dof),
        ]

    def _unit(self, q: Array) -> Array:
        return self.solver.newton.clip(self._scale.to_unit(q))

    @property
    def _scale(self) -> Scale:
        return self.space.model.motor.scale


@dataclass(frozen=True)
class Postures:
    """A table of postures all over the joints' ranges, those nearest to a pose first."""

    evaluate: Evaluate
    scale: Scale
    length: float  # [m], of the arm: a radian of turn counts as much
    columns: tuple[int, ...]  # of a pose (12,), those that a target needs
    apart: ClassVar[float] = SOLVER.start_spacing

    def of(self, x: Array) -> tuple[Index, Array]:
        """The postures nearest to places (n, 3) or poses (n, 12)."""
        features = self._features(x)
        _, rows = self._tree.query(features, SOLVER.nearest)
        targets = np.arange(len(x))
        owner = np.repeat(targets, SOLVER.nearest)
        return owner, self._u[rows.ravel()]

    @cached_property
    def _u(self) -> Array:
        """Joints (k, dof) of the unit box."""
        return random_joints(SOLVER.postures, len(self.scale.span))

    @cached_property
    def _tree(self) -> KDTree:
        from scipy.spatial import KDTree

        q = self.scale.from_unit(self._u)
        place, turn, _ = self.evaluate(q)
        numbers = turn.reshape(-1, 9)
        poses = np.concatenate([place, numbers], axis=1)
        return KDTree(self._features(poses))

    def _features(self, x: Array) -> Array:
        place = x[:, :3] / self.length
        # the distance of matrices is that of angles
        turn = x[:, 3:] / np.sqrt(2)
        features = np.concatenate([place, turn], axis=1)
        return features[:, self.columns]


@dataclass(frozen=True)
class DrawnPostures:
    """Postures by the closed form of the drawing, whose solutions are nearly those of the arm."""

    closed: ClosedForm
    scale: Scale
    # (6,) each: the drawing's joints are gain q + offset
    gain: Array
    offset: Array
    apart: ClassVar[float] = SOLVER.same

    def of(self, x: Array) -> tuple[Index, Array]:
        """Joints of every solution of poses (n, 12), without those beyond the limits."""
        place = x[:, :3]
        turn = x[:, 3:].reshape(-1, 3, 3)
        values = self.closed.joints(place, turn)
        q = (values - self.offset) / self.gain
        lower = self.scale.lower
        half = 0.5 * self.scale.span
        middle = lower + half
        turns = np.round((q - middle) / TURN)
        q = q - TURN * turns
        beyond = np.abs(q - middle) > half + _OVERHANG
        inside = ~beyond.any(axis=2)
        target, solution = np.nonzero(inside)
        u = (q[target, solution] - lower) / self.scale.span
        return target, np.clip(u, 0.0, 1.0)
