"""Newton: damped steps of the joints towards a task, inside of their limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import Scale
from .settings import SEARCH
from .task import Task

ROUNDING = 1e-13
"""Share of a task's size to which a target is met as well as numbers allow."""


@dataclass(frozen=True)
class Stand:
    """Where joints stand, and what is missing there."""

    x: Array  # (n, k), targets
    u: Array  # (n, dof), joints of the unit box
    gap: Array  # (n, m)
    slope: Array  # (n, m, dof)
    miss: Array  # (n,), length of the gap

    def rows(self, index: Index | Mask) -> Stand:
        """Some of the rows."""
        return Stand(*(part[index] for part in vars(self).values()))

    def put(self, index: Index | Mask, other: Stand) -> None:
        """Put other joints in the place of some, for the same targets."""
        self.u[index] = other.u
        self.gap[index] = other.gap
        self.slope[index] = other.slope
        self.miss[index] = other.miss


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
        if not self.scale.periodic.any():
            return inside
        return np.where(self.scale.periodic, u % 1.0, inside)

    def at(self, u: Array, x: Array) -> Stand:
        """What is missing to targets `x` (n, k) at joints (n, dof)."""
        u = self.clip(u)
        gap, slope = self.task.residual(u, x)
        return Stand(x, u, gap, slope, lengths(gap))

    def refine(
        self,
        u: Array,
        x: Array,
        tolerance: float = ROUNDING,
        steps: int = SEARCH.steps,
    ) -> Stand:
        """Joints nearest to targets `x` (n, k) from starts `u` (n, dof).

        Damped Newton steps (Levenberg-Marquardt).  A target counts as met within a share
        `tolerance` of the task's size.
        """
        enough = tolerance * self.task.size
        rounding = max(tolerance, 1e-12) * self.task.size
        stand = self.at(u, x)
        rows = np.flatnonzero(stand.miss > enough)
        here = stand.rows(rows)
        damping = np.full(len(rows), SEARCH.easy)
        for _ in range(steps):
            if not len(rows):
                break
            step = self.move(here, damping)
            trial = self.at(here.u + capped(step, SEARCH.longest), here.x)
            gain = here.miss - trial.miss
            better = gain > 0.0
            ends = gain < SEARCH.slow * here.miss
            ends &= better | (here.miss < rounding)
            ends |= np.abs(step).max(axis=1) < 1e-15
            eased = np.maximum(damping / SEARCH.easier, SEARCH.easiest)
            harder = np.maximum(damping * SEARCH.easier, SEARCH.hard)
            damping = np.where(better, eased, harder)
            if better.all():
                here = trial
            else:
                here.put(better, trial.rows(better))
            stand.put(rows, here)
            going = ~(ends | (damping > SEARCH.hardest) | (here.miss < enough))
            if not going.all():
                rows = rows[going]
                here = here.rows(going)
                damping = damping[going]
        return stand

    def settle(
        self, u: Array, x: Array, near: Array, longest: float = SEARCH.longest
    ) -> Stand:
        """Joints on targets `x` (n, k) from starts `u` (n, dof), near to `near` (n, dof).

        Redundant joints that Newton has led close slide on along their self-motion, each slide at
        most `longest`, a step that comes no nearer undone.  The length of a slide follows from the
        last one (Barzilai and Borwein 1988): the self-motion is curved.
        """
        if not self.redundant:
            return self.refine(u, x)
        rough = SEARCH.rough * self.task.size
        stand = self.refine(u, x, SEARCH.rough)
        rows = np.flatnonzero(stand.miss <= rough)
        share = np.ones(len(u))
        before = np.zeros(u.shape)
        slid = np.zeros(u.shape)
        for _ in range(SEARCH.slides):
            here = stand.rows(rows)
            wish = self.scale.difference(near[rows], here.u)
            pull = self.tangent(here, wish)
            moved = slid[rows].any(axis=1)
            fit = _slide_share(slid[rows], before[rows] - pull)
            share[rows] = np.where(moved, fit, share[rows])
            going = (lengths(pull) > SEARCH.settled) | ~self.met(here.miss)
            going &= share[rows] > SEARCH.stuck
            rows = rows[going]
            if not len(rows):
                break
            here = here.rows(going)
            before[rows] = pull[going]
            step = self.move(here, np.full(len(rows), SEARCH.easy))
            step += share[rows, None] * pull[going]
            step = shortened(capped(step, SEARCH.longest), longest)
            part = np.minimum(1.0, self._room(here.u, step))
            trial = self.at(here.u + part[:, None] * step, here.x)
            left = self.away(trial.u, near[rows])
            closer = left < self.away(here.u, near[rows])
            good = (trial.miss <= rough) & (closer | ~self.met(here.miss))
            share[rows[~good]] /= 4
            shift = self.scale.difference(trial.u, here.u)
            slid[rows] = np.where(good[:, None], shift, 0.0)
            stand.put(rows[good], trial.rows(good))
        stand = self.refine(stand.u, x)
        # joints that slid into a corner of their limits: where they were led without
        lost = np.flatnonzero(~self.met(stand.miss))
        if len(lost):
            others = self.refine(u[lost], x[lost])
            better = others.miss < stand.miss[lost]
            stand.put(lost[better], others.rows(better))
        return stand

    def _room(self, u: Array, move: Array) -> Array:
        """Share (n,) of moves (n, dof) at which the first joint reaches its limit."""
        room = np.where(move > 0.0, 1.0 - u, u)
        free = self.scale.periodic | (np.abs(move) < 1e-12)
        free |= room <= SEARCH.slack  # the limit holds them
        share = np.where(free, np.inf, room) / np.where(free, 1.0, np.abs(move))
        return np.asarray(share.min(axis=1))

    def tangent(self, stand: Stand, wish: Array) -> Array:
        """What of a wished move (n, dof) leaves residuals as they are."""
        damping = np.full(len(wish), SEARCH.easiest)
        still = replace(stand, gap=np.zeros(stand.gap.shape))
        return self.move(still, damping, wish)

    def move(
        self, stand: Stand, damping: Array, wish: Array | None = None
    ) -> Array:
        """The move (n, dof) that closes gaps, of all that do the nearest to a wish.

        A joint at a limit that the move would push further stays, and the others take over.
        """
        u = stand.u
        slope = stand.slope
        slack = 0.0 if wish is None else SEARCH.slack
        goal = np.zeros(u.shape) if wish is None else wish
        lowest = (u <= slack) & ~self.scale.periodic
        highest = (u >= 1.0 - slack) & ~self.scale.periodic
        limited = bool(lowest.any() or highest.any())
        for _ in range(u.shape[1]):
            rest = stand.gap
            if wish is not None:
                rest = rest - (slope @ goal[..., None])[..., 0]
            move = goal + _damped_solution(slope, rest, damping)
            if not limited:
                break
            stuck = (lowest & (move < 0.0)) | (highest & (move > 0.0))
            if not stuck.any():
                break
            goal = np.where(stuck, 0.0, goal)
            slope = np.where(stuck[:, None], 0.0, slope)
        return move


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
    return _scaled(moves, lengths(moves), longest)


def capped(moves: Array, longest: float) -> Array:
    """Moves (n, d) of which no joint goes further than that."""
    return _scaled(moves, np.abs(moves).max(axis=1), longest)


def _scaled(moves: Array, size: Array, longest: float) -> Array:
    share = np.minimum(1.0, longest / np.maximum(size, 1e-300))
    return np.asarray(moves * share[:, None])


def _slide_share(moved: Array, turned: Array) -> Array:
    """Share (n,) of the pull that the next slide goes, by how the pull turned on the last one."""
    along = (moved * turned).sum(axis=1)
    straight = along <= 0
    fit = (moved * moved).sum(axis=1) / np.where(straight, np.inf, along)
    return np.clip(np.where(straight, 1.5, fit), 0.1, 3.0)
