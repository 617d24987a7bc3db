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
"""Residual, as a share of a task's size, that is rounding alone."""


class Iterate(NamedTuple):
    """Joints on their way to targets, and their residuals."""

    x: Array  # (n, k), targets
    u: Array  # (n, dof), joints of the unit box
    residual: Array  # (n, m)
    slope: Array  # (n, m, dof), Jacobian
    distance: Array  # (n,), length of the residual

    def rows(self, index: Index) -> Iterate:
        """Some of the rows."""
        return Iterate(*[part.take(index, axis=0) for part in self])

    def put(self, index: Index, other: Iterate) -> None:
        """Replace some rows by others for the same targets."""
        self.u[index] = other.u
        self.residual[index] = other.residual
        self.slope[index] = other.slope
        self.distance[index] = other.distance


@dataclass(frozen=True)
class Newton:
    """Leads joints of the unit box from starts to a task."""

    task: Task
    scale: Scale  # range of the joints; knows which of them go round

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than the task has residuals."""
        return len(self.scale.span) > self.task.count

    def is_met(self, distance: Array) -> Mask:
        """Whether distances (n,) are as small as those of a solution."""
        return distance <= SOLVER.close * self.task.size

    def away(self, u: Array, v: Array) -> Array:
        """Distances (n,) between joints (n, dof), the short way round."""
        return row_lengths(self.scale.difference(u, v))

    def clip(self, u: Array) -> Array:
        """Joints (n, dof) within their limits; those of full turns go round."""
        inside = np.minimum(np.maximum(u, 0.0), 1.0)
        if not self.scale.goes_round:
            return inside
        return np.where(self.scale.periodic, u % 1.0, inside)

    def at(self, u: Array, x: Array) -> Iterate:
        """Residuals of targets `x` (n, k) at joints (n, dof)."""
        u = self.clip(u)
        residual, slope = self.task.residual(u, x)
        distance = row_lengths(residual)
        return Iterate(
            x,
            u,
            residual,
            slope,
            distance,
        )

    def refine(
        self,
        u: Array,
        x: Array,
        tolerance: float = ROUNDING,
        steps: int = SOLVER.steps,
    ) -> Iterate:
        """Joints nearest to targets `x` (n, k) from starts `u` (n, dof).

        Damped Newton steps (Levenberg-Marquardt).  A target counts as met within a share
        `tolerance` of the task's size.
        """
        iterate = self.at(u, x)
        everywhere = np.ones(len(u), dtype=bool)
        self.descend(
            iterate,
            everywhere,
            tolerance,
            steps,
        )
        return iterate

    def descend(
        self,
        iterate: Iterate,
        which: Mask,
        tolerance: float = ROUNDING,
        steps: int = SOLVER.steps,
    ) -> None:
        """Refine some rows (n,) of an iterate in place, see `refine`."""
        enough = tolerance * self.task.size
        going = which & (iterate.distance > enough)
        rows = going.nonzero()[0]
        if not len(rows):
            return
        here = iterate.rows(rows)
        damping = np.full(len(rows), SOLVER.easy)
        for _ in range(steps):
            move = self.move(here, damping)
            step = limit_joints(move, SOLVER.longest)
            u = here.u + step
            least = self.residual_bound(here, step)
            if least.max() <= enough and u.min() >= 0.0 and u.max() <= 1.0:
                # saves an evaluation, which is noticed in single queries
                here = here._replace(u=u, distance=least)
                break
            trial = self.at(u, here.x)
            ratio = trial.distance / here.distance
            if ratio.max() <= 1.0 - SOLVER.slow:
                here = trial
                damping = _eased(damping)
                ended = here.distance < enough
            else:
                damping, ended = self._keep_better(here, trial, damping)
                ended |= here.distance < enough
            if ended.any():
                if ended.all():
                    break
                iterate.put(rows, here)
                others = np.flatnonzero(~ended)
                rows = rows[others]
                here = here.rows(others)
                damping = damping[others]
        iterate.put(rows, here)

    def _keep_better(
        self, here: Iterate, trial: Iterate, damping: Array
    ) -> tuple[Array, Mask]:
        """Keep the better of two iterates in `here`.

        Returns the damping (n,) of the next step, and whether there is none, (n,).
        """
        ratio = trial.distance / here.distance
        better = ratio < 1.0
        slow = ratio > 1.0 - SOLVER.slow
        final = better | (here.distance < 1e-12 * self.task.size)
        nearer = np.flatnonzero(better)
        here.put(nearer, trial.rows(nearer))
        harder = np.maximum(damping * SOLVER.easier, SOLVER.hard)
        damping = np.where(better, _eased(damping), harder)
        ended = (slow & final) | (damping > SOLVER.hardest)
        return damping, ended

    def residual_bound(self, iterate: Iterate, step: Array) -> Array:
        """Upper bounds (n,) on the residuals after steps (n, dof).

        An arm whose joints turn by an angle in sum is off the straight line by at most half its
        square, times the arm's reach.
        """
        closed = (iterate.slope @ step[:, :, None])[:, :, 0]
        angle = np.abs(step) @ self.scale.span
        bent = 0.5 * self.task.size * angle * angle
        return bent + row_lengths(iterate.residual - closed)

    def closest(self, u: Array, x: Array) -> Iterate:
        """Joints (n, dof) whose tip comes nearest to positions `x` (n, m) that nothing reaches.

        Far targets are approached in their direction, at most one workspace ahead of where the tip
        is: steps to what is much further away than joints reach go nowhere.
        """
        iterate = self.at(u, x)
        here = iterate
        rows = np.arange(len(x))
        for _ in range(SOLVER.steps):
            position = here.x - here.residual
            ahead = position + limit_length(here.residual, self.task.size)
            nearer = self.refine(here.u, ahead)
            moved = (nearer.u != here.u).any(axis=1)
            if not moved.any():
                break
            rows = rows[moved]
            here = self.at(nearer.u[moved], here.x[moved])
            iterate.put(rows, here)
        return iterate

    def tangent(self, iterate: Iterate, preferred_move: Array) -> Array:
        """The move (n, dof) nearest to a preferred one that leaves residuals as they are."""
        still = iterate._replace(residual=np.zeros(iterate.residual.shape))
        damping = np.full(len(preferred_move), SOLVER.easiest)
        return self.move(still, damping, preferred_move)

    def move(
        self,
        iterate: Iterate,
        damping: Array,
        preferred_move: Array | None = None,
    ) -> Array:
        """The move (n, dof) nearest to a preferred one, or the shortest, that closes residuals.

        Joints at a limit that a move would push further stay, and the others take over.
        """
        slope = iterate.slope
        slack = 0.0 if preferred_move is None else SOLVER.slack
        room = 1.0 - slack
        for _ in range(iterate.u.shape[1]):
            move = _nearest_move(
                slope,
                iterate.residual,
                damping,
                preferred_move,
            )
            ahead = iterate.u + move
            if ahead.min(initial=1.0) > slack and ahead.max(initial=0.0) < room:
                break
            stuck = (iterate.u <= slack) & (move < 0.0)
            stuck |= (iterate.u >= room) & (move > 0.0)
            stuck &= ~self.scale.periodic
            if not stuck.any():
                break
            slope = np.where(stuck[:, None], 0.0, slope)
            if preferred_move is not None:
                preferred_move = np.where(stuck, 0.0, preferred_move)
        return move


def _nearest_move(
    slope: Array, residual: Array, damping: Array, preferred_move: Array | None
) -> Array:
    """The moves (n, dof) nearest to preferred ones p, or the shortest, that close residuals.

    ``p + J' (J J' + damping)^-1 (residual - J p)``, of Jacobians J (n, m, dof), damping (n,).
    """
    across = slope.swapaxes(1, 2)
    power = slope @ across
    n, count, _ = power.shape
    diagonal = power.reshape(n, count * count)[:, :: count + 1]
    trace = diagonal.sum(axis=1)
    added = np.maximum(damping * trace, 1e-200)
    diagonal += added[:, None]
    rest = residual[..., None]
    if preferred_move is not None:
        rest = rest - slope @ preferred_move[..., None]
    force = np.linalg.solve(power, rest)
    move = (across @ force)[..., 0]
    return move if preferred_move is None else preferred_move + move


def _eased(damping: Array) -> Array:
    """Damping (n,) after a step that came nearer."""
    return np.maximum(damping / SOLVER.easier, SOLVER.easiest)


def limit_length(moves: Array, longest: float) -> Array:
    """Moves (n, d), shortened where they are longer than `longest`."""
    return _limit(moves, row_lengths(moves), longest)


def limit_joints(moves: Array, longest: float) -> Array:
    """Moves (n, d), shortened where a joint goes further than `longest`."""
    size = np.abs(moves)
    if size.max(initial=0.0) <= longest:
        return moves
    return _limit(moves, size.max(axis=1), longest)


def _limit(moves: Array, size: Array, longest: float) -> Array:
    """Moves (n, d), shortened where their sizes (n,) exceed `longest`."""
    if size.max(initial=0.0) <= longest:
        return moves
    share = np.minimum(1.0, longest / np.maximum(size, 1e-300))
    return moves * share[:, None]
