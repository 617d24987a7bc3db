"""Newton: damped steps of the joints towards a task, inside of their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..common.scale import Scale
from .settings import SEARCH
from .task import Task

ROUNDING = 1e-13
"""Share of a task's size to which a target is met as well as numbers allow."""


@dataclass(frozen=True)
class Newton:
    """Leads joints of the unit box from starts to a task."""

    task: Task
    scale: Scale  # range of the joints; knows which of them go round

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than the task has residuals."""
        return len(self.scale.span) > self.task.count

    def met(self, miss: Array) -> Mask:
        """Whether what is missing (n,) is as little as a solution's."""
        return np.asarray(miss <= SEARCH.close * self.task.size)

    def away(self, u: Array, v: Array) -> Array:
        """Distances (n,) between joints (n, dof), the short way round."""
        return lengths(self.scale.difference(u, v))

    def clip(self, u: Array) -> Array:
        """Joints (n, dof) within their limits; those of full turns go round."""
        inside = np.minimum(np.maximum(u, 0.0), 1.0)
        return np.where(self.scale.periodic, u % 1.0, inside)

    def refine(
        self,
        u: Array,
        x: Array,
        tolerance: float = ROUNDING,
        steps: int = SEARCH.steps,
    ) -> tuple[Array, Array]:
        """Joints (n, dof) nearest to targets `x` (n, k) from starts `u`, and what is missing (n,).

        Damped Newton steps (Levenberg-Marquardt).  A target counts as met within a share
        `tolerance` of the task's size.
        """
        enough = tolerance * self.task.size
        rounding = max(tolerance, 1e-12) * self.task.size
        u = self.clip(u)
        gap, slope = self.task.residual(u, x)
        miss = lengths(gap)
        damping = np.full(len(u), SEARCH.easy)
        rows = np.flatnonzero(miss > enough)
        for _ in range(steps):
            if not len(rows):
                break
            step = self.move(u[rows], gap[rows], slope[rows], damping[rows])
            trial = self.clip(u[rows] + capped(step, SEARCH.longest))
            trial_gap, trial_slope = self.task.residual(trial, x[rows])
            after = lengths(trial_gap)
            before = miss[rows]
            better = after < before
            slow = before - after < SEARCH.slow * before
            still = np.abs(trial - u[rows]).max(axis=1) < 1e-15
            moved = rows[better]
            u[moved] = trial[better]
            gap[moved] = trial_gap[better]
            slope[moved] = trial_slope[better]
            miss[moved] = after[better]
            failed = rows[~better]
            damping[moved] = np.maximum(
                damping[moved] / SEARCH.easier, SEARCH.easiest
            )
            damping[failed] = np.maximum(
                damping[failed] * SEARCH.easier, SEARCH.hard
            )
            stalled = slow & (better | (before < rounding))
            hopeless = damping[rows] > SEARCH.hardest
            rows = rows[~(stalled | still | hopeless | (miss[rows] < enough))]
        return u, miss

    def settle(
        self, u: Array, x: Array, near: Array, longest: float = SEARCH.longest
    ) -> tuple[Array, Array]:
        """Joints (n, dof) on targets `x` (n, k) near to `near`, and what is missing (n,).

        Redundant joints that Newton has led close slide on along their self-motion, each slide at
        most `longest`, a step that comes no nearer undone.  The length of a slide follows from the
        last one (Barzilai and Borwein 1988): the self-motion is curved.
        """
        if not self.redundant:
            return self.refine(u, x)
        rough = SEARCH.rough * self.task.size
        u, miss = self.refine(u, x, SEARCH.rough)
        rows = np.flatnonzero(miss <= rough)
        gap, slope = self.task.residual(u, x)
        share = np.ones(len(u))
        before = np.zeros(u.shape)
        slid = np.zeros(u.shape)
        for _ in range(SEARCH.slides):
            wish = self.scale.difference(near[rows], u[rows])
            pull = self.tangent(u[rows], slope[rows], wish)
            turned = before[rows] - pull
            moved = slid[rows].any(axis=1)
            fit = _slide_share(slid[rows], turned)
            share[rows[moved]] = fit[moved]
            going = lengths(pull) > SEARCH.settled
            going |= ~self.met(miss[rows])
            going &= share[rows] > SEARCH.stuck
            rows = rows[going]
            if not len(rows):
                break
            before[rows] = pull[going]
            calm = np.full(len(rows), SEARCH.easy)
            step = self.move(u[rows], gap[rows], slope[rows], calm)
            step += share[rows, None] * pull[going]
            step = shortened(capped(step, SEARCH.longest), longest)
            part = np.minimum(1.0, self._room(u[rows], step))
            trial = self.clip(u[rows] + part[:, None] * step)
            trial_gap, trial_slope = self.task.residual(trial, x[rows])
            after = lengths(trial_gap)
            closer = self.away(trial, near[rows]) < self.away(
                u[rows], near[rows]
            )
            good = (after <= rough) & (closer | ~self.met(miss[rows]))
            share[rows[~good]] /= 4
            slid[rows] = np.where(
                good[:, None], self.scale.difference(trial, u[rows]), 0.0
            )
            better = rows[good]
            u[better] = trial[good]
            gap[better] = trial_gap[good]
            slope[better] = trial_slope[good]
            miss[better] = after[good]
        return self.refine(u, x)

    def _room(self, u: Array, move: Array) -> Array:
        """Share (n,) of moves (n, dof) at which the first joint reaches its limit."""
        room = np.where(move > 0.0, 1.0 - u, u)
        free = self.scale.periodic | (np.abs(move) < 1e-12)
        free |= room <= SEARCH.slack  # the limit holds them
        share = np.where(free, np.inf, room) / np.where(free, 1.0, np.abs(move))
        return np.asarray(share.min(axis=1))

    def tangent(self, u: Array, slope: Array, wish: Array) -> Array:
        """What of a wished move (n, dof) leaves residuals of Jacobians (n, m, dof) as they are."""
        damping = np.full(len(u), SEARCH.easiest)
        return self.move(u, np.zeros(slope.shape[:2]), slope, damping, wish)

    def move(
        self,
        u: Array,
        gap: Array,
        slope: Array,
        damping: Array,
        wish: Array | None = None,
    ) -> Array:
        """The move (n, dof) that closes gaps (n, m), of all that do the nearest to a wish.

        A joint at a limit that the move would push further stays, and the others take over.
        """
        slack = 0.0 if wish is None else SEARCH.slack
        goal = np.zeros(u.shape) if wish is None else wish
        for _ in range(u.shape[1]):
            rest = gap - _applied(slope, goal)
            move = goal + _damped_solution(slope, rest, damping)
            below = (u <= slack) & (move < 0.0)
            above = (u >= 1.0 - slack) & (move > 0.0)
            stuck = (below | above) & ~self.scale.periodic
            if not stuck.any():
                break
            goal = np.where(stuck, 0.0, goal)
            slope = np.where(stuck[:, None], 0.0, slope)
        return move


def _applied(slope: Array, move: Array) -> Array:
    """What moves (n, dof) do by Jacobians (n, m, dof), (n, m)."""
    return np.asarray((slope @ move[..., None])[..., 0])


def _damped_solution(slope: Array, gap: Array, damping: Array) -> Array:
    """J' (J J' + damping)^-1 gap, (n, dof), of Jacobians (n, m, dof), gaps (n, m), damping (n,)."""
    across = np.swapaxes(slope, 1, 2)
    power = slope @ across
    diagonal = np.einsum("nii->ni", power)
    diagonal += np.maximum(damping * diagonal.sum(axis=1), 1e-200)[:, None]
    force = np.linalg.solve(power, gap[..., None])
    return np.asarray((across @ force)[..., 0])


def lengths(vectors: Array) -> Array:
    """Lengths (...,) of vectors (..., d), quicker than NumPy's norm for a few."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def shortened(moves: Array, longest: float) -> Array:
    """Moves (n, d) of at most that length."""
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    return np.asarray(
        moves * np.minimum(1.0, longest / np.maximum(length, 1e-300))
    )


def capped(moves: Array, longest: float) -> Array:
    """Moves (n, d) of which no joint goes further than that."""
    largest = np.abs(moves).max(axis=1, keepdims=True)
    return np.asarray(
        moves * np.minimum(1.0, longest / np.maximum(largest, 1e-300))
    )


def _slide_share(moved: Array, turned: Array) -> Array:
    """Share (n,) of the pull that the next slide goes, by how the pull turned on the last one."""
    along = (moved * turned).sum(axis=1)
    straight = along <= 0
    fit = (moved * moved).sum(axis=1) / np.where(straight, np.inf, along)
    return np.clip(np.where(straight, 1.5, fit), 0.1, 3.0)
