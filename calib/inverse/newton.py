"""Newton: damped steps of the joints towards a task, inside of their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from .settings import SEARCH, STEPS
from .task import Task


@dataclass
class Rows:
    """Where the rows of a search stand; coordinates come first, so that operations run along rows.

    NumPy is quicker so: an einsum over the last axis takes a tenth of the time.
    """

    u: Array  # (dof, n), joints in the unit box
    gap: Array  # (m, n), residuals
    slope: Array  # (dof, m, n), how residuals shrink
    distance: Array  # (n,), length of the residuals
    damping: Array  # (n,)

    def of(self, rows: NDArray[np.bool_]) -> Rows:
        """Some of the rows."""
        parts = (self.u, self.gap, self.slope, self.distance, self.damping)
        return Rows(*(part[..., rows] for part in parts))

    def moved(self, trial: Rows, better: NDArray[np.bool_]) -> Rows:
        """The rows with those replaced that a trial made better; the damping follows."""
        if better.all():  # most steps are
            damping = np.maximum(self.damping / STEPS.easier, STEPS.least_damping)
            return Rows(trial.u, trial.gap, trial.slope, trial.distance, damping)
        raised = np.maximum(self.damping * STEPS.easier, STEPS.damping_after_failure)
        damping = np.where(better, self.damping / STEPS.easier, raised)
        return Rows(
            np.where(better, trial.u, self.u),
            np.where(better, trial.gap, self.gap),
            np.where(better, trial.slope, self.slope),
            np.minimum(trial.distance, self.distance),
            np.maximum(damping, STEPS.least_damping),
        )


@dataclass(frozen=True)
class Newton:
    """Solves a task from a start, in the unit box."""

    task: Task
    scale: Scale  # range of the joints; knows which of them go round
    extent: (
        float  # of what can be reached, such as the diagonal of the workspace [unit]
    )

    def refine(
        self,
        u: Array,
        x: Array,
        tolerance: float = STEPS.rounding,
        steps: int = STEPS.most,
    ) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to targets `x` (n, k) from starts `u`, and what is left (n,).

        Damped Newton steps (Levenberg-Marquardt) in the unit box.  A joint at a limit that a step
        would push further is left out of that step, so that the others take over.  A target counts
        as met within a share `tolerance` of the extent.
        """
        answers = np.empty_like(u)
        left = np.empty(len(u))
        for first in range(0, len(u), STEPS.chunk):
            rows = slice(first, first + STEPS.chunk)
            answers[rows], left[rows] = self._refine(u[rows], x[rows], tolerance, steps)
        return answers, left

    def _refine(
        self, start: Array, x: Array, tolerance: float, steps: int
    ) -> tuple[Array, Array]:
        met = tolerance * self.extent
        rounding = max(tolerance, 1e-12) * self.extent
        now = self._rows(self._clip(start.T.copy()), x, STEPS.first_damping)
        answers = now.u.copy()
        left = now.distance.copy()
        rows = np.arange(len(start))
        going = left > met
        for _ in range(steps):
            if not going.all():
                rows = rows[going]
                now = now.of(going)
            if not len(rows):
                break
            step = self._step(now.u, now.slope, now.gap, now.damping)
            trial = self._rows(self._clip(now.u + step), x[rows], now.damping)
            better = trial.distance < now.distance
            slow = now.distance - trial.distance < STEPS.slow * now.distance
            stalled = slow & (better | (now.distance < rounding))
            still = np.abs(trial.u - now.u).max(axis=0) < STEPS.rounding
            now = now.moved(trial, better)
            answers[:, rows] = now.u
            left[rows] = now.distance
            hopeless = now.damping > STEPS.most_damping
            going = ~(stalled | (now.distance < met) | still | hopeless)
        return answers.T, left

    def settle(
        self, u: Array, x: Array, near: Array, longest: float = SEARCH.longest
    ) -> tuple[Array, Array]:
        """Joints (n, dof) on targets `x` (n, k) near to `near`, and distances (n,) left.

        Redundant joints slide from `u` along their self-motion.  The null space of the Jacobian is
        left free by the target; each move within it, at most `longest` (a share of the range), is
        followed by :meth:`refine`, and kept if it is closer.  The length of a move follows from the
        last one (Barzilai and Borwein 1988), because the self-motion is curved.
        """
        if self.task.gap(x[:1], x[:1]).shape[1] >= u.shape[1]:
            return self.refine(u, x)
        met = SEARCH.close * self.extent
        u, distance = self.refine(u, x, SEARCH.close)
        rows = np.flatnonzero(distance <= met)
        at = u[rows]
        share = np.ones(len(rows))
        pull = self.tangent(at, self.scale.difference(near[rows], at))
        for _ in range(STEPS.slides):
            going = np.linalg.norm(share[:, None] * pull, axis=1) > STEPS.settled
            u[rows[~going]] = at[~going]
            rows = rows[going]
            at = at[going]
            share = share[going]
            pull = pull[going]
            if not len(rows):
                break
            trial, after = self.refine(
                at + shortened(share[:, None] * pull, longest), x[rows], SEARCH.close
            )
            wish = self.scale.difference(near[rows], at)
            wish_after = self.scale.difference(near[rows], trial)
            closer = np.linalg.norm(wish_after, axis=1) < np.linalg.norm(wish, axis=1)
            good = (after <= met) & closer
            pull_after = self.tangent(trial, wish_after)
            moved = self.scale.difference(trial, at)
            share = np.where(good, _slide_share(moved, pull - pull_after), share / 4)
            at = np.where(good[:, None], trial, at)
            pull = np.where(good[:, None], pull_after, pull)
        u[rows] = at
        return self.refine(u, x)

    def rate(self, u: Array, gap: Array) -> Array:
        """A damped move (n, dof) of the joints `u` that carries the tip along `gap` (n, m)."""
        slope = _rows_last(self.task.value_and_slope(u)[1])
        damping = np.full(len(u), STEPS.calm)
        return np.asarray(self._step(u.T, slope, gap.T, damping).T)

    def towards(self, u: Array, x: Array, damping: float) -> Array:
        """One step (n, dof) of the joints `u` towards targets `x` (n, k)."""
        rows = self._rows(u.T, x, damping)
        return np.asarray(self._step(rows.u, rows.slope, rows.gap, rows.damping).T)

    def tangent(self, u: Array, wish: Array) -> Array:
        """What of a wished move (n, dof) leaves the task as it is, limits kept."""
        slope = _rows_last(self.task.value_and_slope(u)[1])
        damping = np.full(len(u), STEPS.least_damping)
        blocked = np.zeros(u.T.shape, dtype=bool)
        move = wish.T
        for _ in range(u.shape[1]):
            free = np.where(blocked[:, None], 0.0, slope)
            wanted = np.where(blocked, 0.0, wish.T)
            along = np.einsum("dmn,dn->mn", free, wanted)
            move = wanted - damped_solution(free, along, damping)
            outward = ~blocked & self._outward(u.T, move, STEPS.slack)
            if not outward.any():
                break
            blocked |= outward
        return np.asarray(move.T)

    def closest(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Joints (n, dof) that come nearest to targets `x` (n, m) of positions, what is left (n,).

        Newton steps on the distance from `u`, with second derivatives: the edge of the workspace is
        curved, of which the Jacobian alone knows nothing.  A far target counts as one workspace
        away: the nearest point is the same for all targets along one normal of its edge.
        """
        u = u.copy()
        rows = np.arange(len(u))
        share = np.ones(len(u))
        position, slope = self.task.value_and_slope(u)
        distance = np.linalg.norm(x - position, axis=1)
        for _ in range(STEPS.most):
            if not len(rows):
                break
            gap = shortened(x[rows] - position[rows], self.extent)
            step = self._curved_step(u[rows], slope[rows], gap) * share[rows, None]
            trial = self.clip(u[rows] + step)
            there, tilt = self.task.value_and_slope(trial)
            # compared with what is pulled close: far targets have no digits left to compare
            after = np.linalg.norm(position[rows] + gap - there, axis=1)
            better = after < np.linalg.norm(gap, axis=1)
            moved = np.abs(self.scale.difference(trial, u[rows])).max(axis=1)
            nearer = rows[better]
            u[nearer] = trial[better]
            position[nearer] = there[better]
            slope[nearer] = tilt[better]
            distance[nearer] = np.linalg.norm(x[nearer] - position[nearer], axis=1)
            share[rows] = np.where(
                better, np.minimum(1.0, 2 * share[rows]), share[rows] / 4
            )
            rows = rows[(moved > STEPS.still) & (share[rows] > STEPS.least_share)]
        return u, distance

    def _curved_step(self, u: Array, slope: Array, gap: Array) -> Array:
        """Newton step (n, dof) of half the squared distance, with the joints that may move."""
        push = np.einsum("noi,no->ni", slope, gap)
        stuck = self._outward(u.T, push.T).T
        curvature = np.einsum("noi,noj->nij", slope, slope)
        for k, probe in enumerate(STEPS.probe * np.eye(u.shape[1])):
            ahead = self.task.value_and_slope(u + probe)[1]
            behind = self.task.value_and_slope(u - probe)[1]
            curvature[:, k] -= np.einsum("noi,no->ni", ahead - behind, gap) / (
                2 * STEPS.probe
            )
        curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
        curvature[stuck[:, :, None] | stuck[:, None, :]] = 0.0
        size, axes = np.linalg.eigh(curvature)
        size = np.abs(size)
        largest = np.maximum(size.max(axis=1, keepdims=True), 1e-300)
        size = np.maximum(size, STEPS.flat * largest)
        push = np.where(stuck, 0.0, push)
        step = np.einsum("nij,nj->ni", axes, np.einsum("nji,nj->ni", axes, push) / size)
        return shortened(np.where(stuck, 0.0, step), STEPS.far)

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        return self._clip(u.T.copy()).T

    def take_better(
        self,
        u: Array,
        left: Array,
        near: Array,
        owner: Index,
        others: Array,
        others_left: Array,
    ) -> None:
        """Replace answers (n, dof) to targets, and what is left (n,), by better ones, in place.

        `others` (k, dof) leave `others_left` (k,) of the targets `owner` (k,).  A target that is
        met goes before one that is missed, then joints close to `near` (n, dof).
        """
        owner = np.concatenate([np.arange(len(u)), owner])
        candidates = np.concatenate([u, others])
        residual = np.concatenate([left, others_left])
        missed = residual > SEARCH.close * self.extent
        away = np.linalg.norm(self.scale.difference(candidates, near[owner]), axis=1)
        order = np.lexsort((np.where(missed, residual, away), missed, owner))
        best = order[np.searchsorted(owner[order], np.arange(len(u)))]
        u[:] = candidates[best]
        left[:] = residual[best]

    def _rows(self, u: Array, x: Array, damping: Array | float) -> Rows:
        """Rows of a search at points `u` (dof, n)."""
        value, slope = self.task.value_and_slope(u.T)
        gap = self.task.gap(x, value).T
        distance = np.sqrt(np.einsum("mn,mn->n", gap, gap))
        return Rows(
            u,
            gap,
            _rows_last(slope),
            distance,
            np.broadcast_to(damping, distance.shape),
        )

    def _step(self, u: Array, slope: Array, gap: Array, damping: Array) -> Array:
        """J' (J J' + damping)^-1 gap, with the joints that may move, (dof, n)."""
        stuck = self._outward(u, np.einsum("dmn,mn->dn", slope, gap))
        free = np.where(stuck[:, None], 0.0, slope) if stuck.any() else slope
        step = damped_solution(free, gap, damping)
        longest = np.maximum(np.abs(step).max(axis=0), 1e-300)
        return np.asarray(step * np.minimum(1.0, SEARCH.longest / longest))

    def _clip(self, u: Array) -> Array:
        inside = np.minimum(np.maximum(u, 0.0), 1.0)
        for k in np.flatnonzero(self.scale.periodic):
            inside[k] = u[k] % 1.0
        return inside

    def _outward(self, u: Array, push: Array, slack: float = 0.0) -> NDArray[np.bool_]:
        """Which joints stand at a limit and are pushed over it, (dof, n)."""
        below = (u <= slack) & (push < 0.0)
        above = (u >= 1.0 - slack) & (push > 0.0)
        return np.asarray((below | above) & ~self.scale.periodic[:, None])


def damped_solution(slope: Array, gap: Array, damping: Array) -> Array:
    """J' (J J' + damping)^-1 gap, (dof, n), of Jacobians (dof, m, n), gap (m, n), damping (n,)."""
    power = np.einsum("din,djn->ijn", slope, slope)
    diagonal = np.einsum("iin->in", power)
    diagonal += np.maximum(damping * diagonal.sum(axis=0), 1e-300)
    if len(gap) == 2:
        # the inverse of a 2x2 matrix in place of LAPACK, whose calls cost more than the numbers
        (aa, ab), (_, bb) = power
        determinant = np.maximum(aa * bb - ab * ab, 1e-300)
        first = (bb * gap[0] - ab * gap[1]) / determinant
        second = (aa * gap[1] - ab * gap[0]) / determinant
        return np.asarray(slope[:, 0] * first + slope[:, 1] * second)
    force = np.linalg.solve(power.transpose(2, 0, 1), gap.T[..., None])[..., 0]
    return np.asarray(np.einsum("dmn,nm->dn", slope, force))


def shortened(moves: Array, longest: float) -> Array:
    """Moves (n, d) of at most that length."""
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    return np.asarray(moves * np.minimum(1.0, longest / np.maximum(length, 1e-300)))


def _slide_share(moved: Array, turned: Array) -> Array:
    """Share (n,) of the pull that the next slide goes, by how the pull turned on the last move."""
    along = np.einsum("nd,nd->n", moved, turned)
    fit = np.einsum("nd,nd->n", moved, moved) / np.where(along > 0, along, np.inf)
    return np.clip(np.where(along > 0, fit, 1.5), 0.1, 3.0)


def _rows_last(slope: Array) -> Array:
    """Jacobians (n, m, dof) as (dof, m, n)."""
    return np.ascontiguousarray(slope.transpose(2, 1, 0))
