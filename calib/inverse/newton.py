"""Newton: damped steps of the joints towards a task, inside of their limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths
from ..common.scale import Scale
from .settings import SOLVER
from .task import Task

ROUNDING = 3e-13
"""Share of a task's size to which a target is met as well as numbers allow."""


class Stand(NamedTuple):
    """Current joints, and their residuals."""

    x: Array  # (n, k), targets
    u: Array  # (n, dof), joints of the unit box
    gap: Array  # (n, m)
    slope: Array  # (n, m, dof)
    miss: Array  # (n,), length of the gap

    def rows(self, index: Index) -> Stand:
        """Some of the rows."""
        return Stand(*[part.take(index, axis=0) for part in self])

    def put(self, index: Index, other: Stand) -> None:
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

    def is_met(self, miss: Array) -> Mask:
        """Whether misses (n,) are as small as a solution's."""
        return miss <= SOLVER.close * self.task.size

    def away(self, u: Array, v: Array) -> Array:
        """Distances (n,) between joints (n, dof), the short way round."""
        return row_lengths(self.scale.difference(u, v))

    def clip(self, u: Array) -> Array:
        """Joints (n, dof) within their limits; those of full turns go round."""
        inside = np.minimum(np.maximum(u, 0.0), 1.0)
        if not self.scale.goes_round:
            return inside
        return np.where(self.scale.periodic, u % 1.0, inside)

    def at(self, u: Array, x: Array) -> Stand:
        """What is missing to targets `x` (n, k) at joints (n, dof)."""
        u = self.clip(u)
        gap, slope = self.task.residual(u, x)
        miss = row_lengths(gap)
        return Stand(
            x,
            u,
            gap,
            slope,
            miss,
        )

    def refine(
        self,
        u: Array,
        x: Array,
        tolerance: float = ROUNDING,
        steps: int = SOLVER.steps,
    ) -> Stand:
        """Joints nearest to targets `x` (n, k) from starts `u` (n, dof).

        Damped Newton steps (Levenberg-Marquardt).  A target counts as met within a share
        `tolerance` of the task's size.
        """
        stand = self.at(u, x)
        everywhere = np.ones(len(u), dtype=bool)
        self.descend(
            stand,
            everywhere,
            tolerance,
            steps,
        )
        return stand

    def descend(
        self,
        stand: Stand,
        which: Mask,
        tolerance: float = ROUNDING,
        steps: int = SOLVER.steps,
    ) -> None:
        """Refine some rows (n,) of a stand in place, see `refine`."""
        enough = tolerance * self.task.size
        rounding = 1e-12 * self.task.size
        going = which & (stand.miss > enough)
        rows = going.nonzero()[0]
        if not len(rows):
            return
        here = stand.rows(rows)
        damping = np.full(len(rows), SOLVER.easy)
        for _ in range(steps):
            move = self.move(here, damping)
            step = limit_joints(move, SOLVER.longest)
            u = here.u + step
            rest = self.most_left(here, step)
            if rest.max() <= enough and u.min() >= 0.0 and u.max() <= 1.0:
                # a look less, which counts of a single target
                here = here._replace(u=u, miss=rest)
                break
            trial = self.at(u, here.x)
            ratio = trial.miss / here.miss
            eased = np.maximum(damping / SOLVER.easier, SOLVER.easiest)
            if ratio.max() <= 1.0 - SOLVER.slow:
                here = trial
                damping = eased
                ended = here.miss < enough
            else:
                better = ratio < 1.0
                slow = ratio > 1.0 - SOLVER.slow
                final = better | (here.miss < rounding)
                nearer = np.flatnonzero(better)
                here.put(nearer, trial.rows(nearer))
                harder = np.maximum(damping * SOLVER.easier, SOLVER.hard)
                damping = np.where(better, eased, harder)
                ended = slow & final
                ended |= damping > SOLVER.hardest
                ended |= here.miss < enough
            if ended.any():
                if ended.all():
                    break
                stand.put(rows, here)
                others = np.flatnonzero(~ended)
                rows = rows[others]
                here = here.rows(others)
                damping = damping[others]
        stand.put(rows, here)

    def most_left(self, stand: Stand, step: Array) -> Array:
        """What steps (n, dof) leave of gaps at most, (n,).

        An arm that turns by an angle in all leaves the straight line by half its square at most,
        times the arm's reach.
        """
        closed = (stand.slope @ step[:, :, None])[:, :, 0]
        angle = np.abs(step) @ self.scale.span
        bent = 0.5 * self.task.size * angle * angle
        return bent + row_lengths(stand.gap - closed)

    def closest(self, u: Array, x: Array) -> Stand:
        """Joints (n, dof) whose tip comes nearest to positions `x` (n, m) that nothing reaches.

        Far targets are approached in their direction, at most one workspace ahead of where the tip
        is: steps to what is much further away than joints reach go nowhere.
        """
        stand = self.at(u, x)
        here = stand
        rows = np.arange(len(x))
        for _ in range(SOLVER.steps):
            position = here.x - here.gap
            ahead = position + limit_length(here.gap, self.task.size)
            nearer = self.refine(here.u, ahead)
            moved = (nearer.u != here.u).any(axis=1)
            if not moved.any():
                break
            rows = rows[moved]
            here = self.at(nearer.u[moved], here.x[moved])
            stand.put(rows, here)
        return stand

    def tangent(self, stand: Stand, wish: Array) -> Array:
        """The move (n, dof) nearest to a wish (n, dof) that leaves gaps as they are."""
        still = stand._replace(gap=np.zeros(stand.gap.shape))
        damping = np.full(len(wish), SOLVER.easiest)
        return self.move(still, damping, wish)

    def move(
        self, stand: Stand, damping: Array, wish: Array | None = None
    ) -> Array:
        """Of all moves (n, dof) that close gaps the one nearest to a wish, or the shortest.

        Joints at a limit that a move would push further stay, and the others take over.
        """
        slope = stand.slope
        slack = 0.0 if wish is None else SOLVER.slack
        room = 1.0 - slack
        for _ in range(stand.u.shape[1]):
            move = _nearest_move(
                slope,
                stand.gap,
                damping,
                wish,
            )
            ahead = stand.u + move
            if ahead.min(initial=1.0) > slack and ahead.max(initial=0.0) < room:
                break
            stuck = (stand.u <= slack) & (move < 0.0)
            stuck |= (stand.u >= room) & (move > 0.0)
            stuck &= ~self.scale.periodic
            if not stuck.any():
                break
            slope = np.where(stuck[:, None], 0.0, slope)
            if wish is not None:
                wish = np.where(stuck, 0.0, wish)
        return move


def _nearest_move(
    slope: Array, gap: Array, damping: Array, wish: Array | None
) -> Array:
    """Of moves (n, dof) that close gaps (n, m) the one nearest to a wish (n, dof), if there is one.

    ``wish + J' (J J' + damping)^-1 (gap - J wish)``, of Jacobians (n, m, dof), damping (n,).
    """
    across = slope.swapaxes(1, 2)
    power = slope @ across
    n, count, _ = power.shape
    diagonal = power.reshape(n, count * count)[:, :: count + 1]
    trace = diagonal.sum(axis=1)
    added = np.maximum(damping * trace, 1e-200)
    diagonal += added[:, None]
    rest = gap[..., None]
    if wish is not None:
        rest = rest - slope @ wish[..., None]
    force = np.linalg.solve(power, rest)
    move = np.asarray((across @ force)[..., 0])
    return move if wish is None else wish + move


def limit_length(moves: Array, longest: float) -> Array:
    """Moves (n, d) of at most that length, shortened where they are longer."""
    return _limit(moves, row_lengths(moves), longest)


def limit_joints(moves: Array, longest: float) -> Array:
    """Moves (n, d) shortened so that no joint goes further than that."""
    size = np.abs(moves)
    if size.max(initial=0.0) <= longest:
        return moves
    return _limit(moves, size.max(axis=1), longest)


def _limit(moves: Array, size: Array, longest: float) -> Array:
    """Moves (n, d) scaled down where their sizes (n,) are larger than that."""
    if size.max(initial=0.0) <= longest:
        return moves
    share = np.minimum(1.0, longest / np.maximum(size, 1e-300))
    return moves * share[:, None]
