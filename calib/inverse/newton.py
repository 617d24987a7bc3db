"""Newton: damped steps of the joints towards any task, inside of their limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale

CLOSE = 1e-9
"""Share of the extent below which joints may slide along a self-motion."""

_ROUNDING = 1e-15  # of the extent: a target is met as well as numbers allow
_STEPS = 40  # most iterations
_CALM = 1e-3  # damping of a single step, as a share of the Jacobian's power
_CHUNK = 4096  # rows at once: what is held of them fits into the cache
_SLIDES = 25  # most slides towards the joints that are wished for
_SETTLED = 1e-6  # of the joints' range: a slide that is shorter is the last
_SLACK = 2e-6  # of the joints' range: a slide that has come so close to a limit is there
_LONGEST = 0.25  # of the joints' range: no step and no slide is longer

# the nearest point out of reach, shares of the joints' range: step of second derivatives, longest
# and last step; share of the largest curvature that every direction has at least
_PROBE, _FAR, _STILL, _FLAT = 1e-4, 0.2, 1e-10, 1e-6


class Task(Protocol):
    """What engines know of a question: targets are rows (n, k), residuals have m numbers."""

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """What is reached (n, k), and how residuals shrink with unit coordinates (n, m, dof)."""
        ...

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m) between targets and what is reached."""
        ...


@dataclass(frozen=True)
class Positions:
    """Positions (n, m) by a forward map that knows its Jacobian."""

    value_and_slope: Callable[[Array], tuple[Array, Array]]

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m)."""
        return target - value


@dataclass(frozen=True)
class Newton:
    """Solves a task from a start, in the unit box."""

    task: Task
    scale: Scale  # range of the joints; knows which of them go round
    extent: float  # of what can be reached, such as the diagonal of the workspace [unit]

    def refine(
        self, u: Array, x: Array, tolerance: float = _ROUNDING, steps: int = _STEPS
    ) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to targets `x` (n, k) from starts `u`, and what is left (n,).

        Damped Newton steps (Levenberg-Marquardt) in the unit box. A joint at a limit that a step
        would push further is left out of that step, so that the others take over. A target counts
        as met within a share `tolerance` of the extent.
        """
        if not len(u):
            return u, np.zeros(0)
        if len(u) > _CHUNK:
            chunks = (slice(i, i + _CHUNK) for i in range(0, len(u), _CHUNK))
            parts = [self.refine(u[rows], x[rows], tolerance, steps) for rows in chunks]
            return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
        # coordinates come first here, so that every operation runs along the rows
        met, rounding = tolerance * self.extent, max(tolerance, 1e-12) * self.extent
        found, rows = self._clip(u.T.copy()), np.arange(len(u))
        u, (gap, slope) = found.copy(), self._left(found, x)
        distance = _length(gap)
        left, going = distance.copy(), distance > met
        # nearly Gauss-Newton at first: a start is within a node's spacing of its answer
        damping = np.full(len(rows), 1e-9)
        for _ in range(steps):
            if not going.all():
                rows, damping = rows[going], damping[going]
                u, gap, distance, slope = (part[..., going] for part in (u, gap, distance, slope))
            if not len(rows):
                break
            trial = self._clip(u + self._step(u, slope, gap, damping))
            new_gap, new_slope = self._left(trial, x[rows])
            now = _length(new_gap)
            moved = np.abs(trial - u).max(axis=0)
            better = now < distance
            stalled = (distance - now < 1e-9 * distance) & (better | (distance < rounding))
            if better.all():  # most steps are: nothing has to be chosen row by row
                u, gap, distance, slope = trial, new_gap, now, new_slope
                damping = np.maximum(damping / 30, 1e-12)
            else:
                u, gap = np.where(better, trial, u), np.where(better, new_gap, gap)
                distance, slope = np.minimum(now, distance), np.where(better, new_slope, slope)
                damping = np.where(better, damping / 30, np.maximum(damping * 30, 1e-6))
                damping = np.maximum(damping, 1e-12)
            found[:, rows], left[rows] = u, distance
            going = ~(stalled | (distance < met) | (moved < 1e-15) | (damping > 1e3))
        return found.T, left

    def _step(self, u: Array, slope: Array, gap: Array, damping: Array) -> Array:
        """J' (J J' + damping)^-1 gap, with the joints that may move, (dof, n)."""
        stuck = self._outward(u, np.einsum("dmn,mn->dn", slope, gap))
        free = np.where(stuck[:, None], 0.0, slope) if stuck.any() else slope
        step = damped_solution(free, gap, damping)
        longest = np.maximum(np.abs(step).max(axis=0), 1e-300)
        return np.asarray(step * np.minimum(1.0, _LONGEST / longest))

    def settle(
        self, u: Array, x: Array, near: Array, longest: float = _LONGEST
    ) -> tuple[Array, Array]:
        """Joints (n, dof) on targets `x` (n, k) near to `near`, and distances (n,) left.

        Redundant joints slide from `u` along their self-motion. The null space of the Jacobian is
        left free by the target; each move within it, at most `longest` (a share of the range), is
        followed by :meth:`refine`, and kept if it is closer. The length of a move follows from the
        last one (Barzilai and Borwein 1988), because the self-motion is curved.
        """
        if self.task.gap(x[:1], x[:1]).shape[1] >= u.shape[1]:
            return self.refine(u, x)
        u, distance = self.refine(u, x, CLOSE)
        u = u.copy()
        rows = np.flatnonzero(distance <= CLOSE * self.extent)
        at, share = u[rows], np.ones(len(rows))
        pull = self.tangent(at, self.scale.difference(near[rows], at))
        for _ in range(_SLIDES):
            going = np.linalg.norm(share[:, None] * pull, axis=1) > _SETTLED
            if not going.all():
                u[rows[~going]] = at[~going]
                rows, at, share, pull = rows[going], at[going], share[going], pull[going]
            if not len(rows):
                break
            move = shortened(share[:, None] * pull, longest)
            trial, after = self.refine(at + move, x[rows], CLOSE)
            wish = self.scale.difference(near[rows], at)
            wish_now = self.scale.difference(near[rows], trial)
            closer = np.linalg.norm(wish_now, axis=1) < np.linalg.norm(wish, axis=1)
            good = (after <= CLOSE * self.extent) & closer
            pull_now = self.tangent(trial, wish_now)
            moved = self.scale.difference(trial, at)
            turned = np.einsum("nd,nd->n", moved, pull - pull_now)
            fit = np.einsum("nd,nd->n", moved, moved) / np.where(turned > 0, turned, np.inf)
            share = np.where(good, np.clip(np.where(turned > 0, fit, 1.5), 0.1, 3.0), share / 4)
            at = np.where(good[:, None], trial, at)
            pull = np.where(good[:, None], pull_now, pull)
        u[rows] = at
        return self.refine(u, x)

    def rate(self, u: Array, gap: Array) -> Array:
        """A damped move (n, dof) of the joints `u` that carries the tip along `gap` (n, m)."""
        slope = _transposed(self.task.value_and_slope(u)[1])
        return np.asarray(self._step(u.T, slope, gap.T, np.full(len(u), _CALM)).T)

    def towards(self, u: Array, x: Array, damping: float) -> Array:
        """One step (n, dof) of the joints `u` towards targets `x` (n, k)."""
        gap, slope = self._left(u.T, x)
        return np.asarray(self._step(u.T, slope, gap, np.full(len(u), damping)).T)

    def tangent(self, u: Array, wish: Array) -> Array:
        """What of a wished move (n, dof) leaves the position as it is, limits kept."""
        slope = _transposed(self.task.value_and_slope(u)[1])
        place, move = u.T, wish.T
        blocked = np.zeros(place.shape, dtype=bool)
        for _ in range(u.shape[1]):
            free = np.where(blocked[:, None], 0.0, slope)
            wanted = np.where(blocked, 0.0, wish.T)
            along = np.einsum("dmn,dn->mn", free, wanted)
            move = wanted - damped_solution(free, along, np.full(len(u), 1e-12))
            more = ~blocked & self._outward(place, move, _SLACK)
            if not more.any():
                break
            blocked |= more
        return np.asarray(move.T)

    def closest(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Joints (n, dof) that come nearest to targets `x` (n, m) of positions, what is left (n,).

        Newton steps on the distance from `u`, with second derivatives: the edge of the workspace is
        curved, of which the Jacobian alone knows nothing. A far target counts as one workspace
        away: the nearest point is the same for all targets along one normal of its edge.
        """
        u, rows, share = u.copy(), np.arange(len(u)), np.ones(len(u))
        position, slope = self.task.value_and_slope(u)
        distance = np.linalg.norm(x - position, axis=1)
        for _ in range(_STEPS):
            if not len(rows):
                break
            gap = shortened(x[rows] - position[rows], self.extent)
            step = self._curved_step(u[rows], slope[rows], gap) * share[rows, None]
            trial = self.clip(u[rows] + step)
            there, tilt = self.task.value_and_slope(trial)
            # compared with what is pulled close: far targets have no digits left to compare
            now = np.linalg.norm(position[rows] + gap - there, axis=1)
            better = now < np.linalg.norm(gap, axis=1)
            moved = np.abs(self.scale.difference(trial, u[rows])).max(axis=1)
            taken = rows[better]
            u[taken], position[taken], slope[taken] = trial[better], there[better], tilt[better]
            distance[taken] = np.linalg.norm(x[taken] - position[taken], axis=1)
            share[rows] = np.where(better, np.minimum(1.0, 2 * share[rows]), share[rows] / 4)
            rows = rows[(moved > _STILL) & (share[rows] > 1e-6)]
        return u, distance

    def _curved_step(self, u: Array, slope: Array, gap: Array) -> Array:
        """Newton step (n, dof) of half the squared distance, with the joints that may move."""
        push = np.einsum("noi,no->ni", slope, gap)
        held = self._outward(u.T, push.T).T
        curvature = np.einsum("noi,noj->nij", slope, slope)
        for k, probe in enumerate(_PROBE * np.eye(u.shape[1])):
            ahead, behind = (self.task.value_and_slope(u + way)[1] for way in (probe, -probe))
            curvature[:, k] -= np.einsum("noi,no->ni", ahead - behind, gap) / (2 * _PROBE)
        curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
        curvature[held[:, :, None] | held[:, None, :]] = 0.0
        size, axes = np.linalg.eigh(curvature)
        size = np.abs(size)
        size = np.maximum(size, _FLAT * np.maximum(size.max(axis=1, keepdims=True), 1e-300))
        push = np.where(held, 0.0, push)
        step = np.einsum("nij,nj->ni", axes, np.einsum("nji,nj->ni", axes, push) / size)
        return shortened(np.where(held, 0.0, step), _FAR)

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        return self._clip(u.T.copy()).T

    def _clip(self, u: Array) -> Array:
        inside = np.minimum(np.maximum(u, 0.0), 1.0)
        for k in np.flatnonzero(self.scale.periodic):
            inside[k] = u[k] % 1.0
        return inside

    def _outward(self, u: Array, push: Array, slack: float = 0.0) -> NDArray[np.bool_]:
        """Which joints stand at a limit and are pushed over it, (dof, n)."""
        stuck = (u <= slack) & (push < 0.0) | (u >= 1.0 - slack) & (push > 0.0)
        return np.asarray(stuck & ~self.scale.periodic[:, None])

    def _left(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Residuals (m, n) and Jacobian (dof, m, n) at the points `u` (dof, n)."""
        value, slope = self.task.value_and_slope(u.T)
        return self.task.gap(x, value).T, _transposed(slope)

    def take_better(
        self, u: Array, left: Array, near: Array, owner: Index, found: Array, now: Array
    ) -> None:
        """Replace answers (n, dof) to targets, and what is left (n,), by better ones, in place.

        `found` (k, dof) leave `now` (k,) of the targets `owner` (k,).  A target that is met goes
        before one that is missed, then joints close to `near` (n, dof).
        """
        owner = np.concatenate([np.arange(len(u)), owner])
        every, left_over = np.concatenate([u, found]), np.concatenate([left, now])
        met = left_over <= CLOSE * self.extent
        away = np.linalg.norm(self.scale.difference(every, near[owner]), axis=1)
        order = np.lexsort((np.where(met, away, left_over), ~met, owner))
        best = order[np.searchsorted(owner[order], np.arange(len(u)))]
        u[:], left[:] = every[best], left_over[best]


def damped_solution(slope: Array, gap: Array, damping: Array) -> Array:
    """J' (J J' + damping)^-1 gap, (dof, n), of Jacobians (dof, m, n), gap (m, n), damping (n,)."""
    power = np.einsum("din,djn->ijn", slope, slope)
    diagonal = np.einsum("iin->in", power)
    diagonal += np.maximum(damping * diagonal.sum(axis=0), 1e-300)
    if len(gap) == 2:
        # the inverse of a 2x2 matrix in place of LAPACK, whose calls cost more than the numbers
        (aa, ab), (_, bb) = power
        det = np.maximum(aa * bb - ab * ab, 1e-300)
        first, second = (bb * gap[0] - ab * gap[1]) / det, (aa * gap[1] - ab * gap[0]) / det
        return np.asarray(slope[:, 0] * first + slope[:, 1] * second)
    force = np.linalg.solve(power.transpose(2, 0, 1), gap.T[..., None])[..., 0]
    return np.asarray(np.einsum("dmn,nm->dn", slope, force))


def shortened(moves: Array, longest: float) -> Array:
    """Moves (n, d) of at most that length."""
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    return np.asarray(moves * np.minimum(1.0, longest / np.maximum(length, 1e-300)))


def _transposed(slope: Array) -> Array:
    """Jacobians (dof, m, n), rows of memory along n: einsum is ten times slower on a view."""
    return np.ascontiguousarray(slope.transpose(2, 1, 0))


def _length(gap: Array) -> Array:
    """Length of each column of `gap` (m, n)."""
    return np.asarray(np.sqrt(np.einsum("mn,mn->n", gap, gap)))
