"""Slides: redundant joints move along their self-motion towards the joints of `near`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths
from .newton import Iterate, Newton, limit_length
from .settings import SOLVER


def solve_near(
    newton: Newton,
    u: Array,
    x: Array,
    near: Array,
    longest: float = SOLVER.longest,
) -> Iterate:
    """Joints on targets `x` (n, k) from starts `u` (n, dof), near to `near` (n, dof).

    Redundant joints that Newton has led close slide on, each slide at most `longest`.  Others are
    where Newton leads them.
    """
    if not newton.redundant:
        return newton.refine(u, x)
    iterate = newton.refine(u, x, SOLVER.rough)
    slides = Slides.of(newton, near)
    rows = np.flatnonzero(slides.close_to(iterate))
    for _ in range(SOLVER.slides):
        rows = slides.next(iterate, rows, longest)
        if not len(rows):
            break
    iterate = newton.refine(iterate.u, x)
    # joints that slid into a corner of their limits are led again, without slides
    met = newton.is_met(iterate.distance)
    lost = np.flatnonzero(~met)
    if len(lost):
        others = newton.refine(u[lost], x[lost])
        better = np.flatnonzero(others.distance < iterate.distance[lost])
        iterate.put(lost[better], others.rows(better))
    return iterate


@dataclass(frozen=True)
class Slides:
    """Slides of n rows of joints towards those of `near`; its arrays are changed in place.

    The self-motion is curved: the length of a slide follows from the last one (Barzilai and Borwein
    1988).
    """

    newton: Newton
    near: Array  # (n, dof)
    share: Array  # (n,), of the pull that a slide goes
    pull: Array  # (n, dof), at the last slide
    shift: Array  # (n, dof), the last slide, zero if it was undone

    @staticmethod
    def of(newton: Newton, near: Array) -> Slides:
        """Slides towards joints (n, dof), before the first."""
        still = np.zeros_like(near)
        return Slides(
            newton,
            near,
            np.ones(len(near)),
            still,
            still.copy(),
        )

    def next(self, iterate: Iterate, rows: Index, longest: float) -> Index:
        """Slide some rows of an iterate once, and return those that have not settled.

        A slide that leaves the target, or on target comes no nearer, is undone.
        """
        newton = self.newton
        here = iterate.rows(rows)
        preferred_move = newton.scale.difference(self.near[rows], here.u)
        pull = newton.tangent(here, preferred_move)
        self._adapt_share(rows, pull)
        unsettled = row_lengths(pull) > SOLVER.settled
        unsettled |= ~newton.is_met(here.distance)
        going = unsettled & (self.share[rows] > SOLVER.stuck)
        rows = rows[going]
        if len(rows):
            self._slide(iterate, rows, pull[going], longest)
        return rows

    def _slide(
        self, iterate: Iterate, rows: Index, pull: Array, longest: float
    ) -> None:
        """Slide rows (k,) by their shares of pulls (k, dof)."""
        newton = self.newton
        here = iterate.rows(rows)
        near = self.near[rows]
        step = newton.move(here, np.full(len(rows), SOLVER.easy))
        step += self.share[rows, None] * pull
        step = limit_length(step, longest)
        step = self._within_limits(here.u, step)
        trial = newton.at(here.u + step, here.x)
        closer = newton.away(trial.u, near) < newton.away(here.u, near)
        good = self.close_to(trial) & (closer | ~newton.is_met(here.distance))
        better = np.flatnonzero(good)
        iterate.put(rows[better], trial.rows(better))
        shift = newton.scale.difference(trial.u, here.u)
        shift[~good] = 0.0
        self.pull[rows] = pull
        self.shift[rows] = shift
        self.share[rows[~good]] /= 4

    def close_to(self, iterate: Iterate) -> Mask:
        """Whether joints (n,) are so close to their targets that they slide."""
        rough = SOLVER.rough * self.newton.task.size
        return iterate.distance <= rough

    def _adapt_share(self, rows: Index, pull: Array) -> None:
        """Set the share of a pull (k, dof) by how it turned on the last slide.

        After a shift s that changed the pull by -y it is ``s.s / s.y``, one over the curvature.
        """
        shift = self.shift[rows]
        turned = self.pull[rows] - pull
        along = (shift * turned).sum(axis=1)
        square = (shift * shift).sum(axis=1)
        bent = along > 0.0
        share = square / np.where(bent, along, np.inf)
        share = np.where(bent, share, 1.5)
        share = np.clip(share, 0.1, 3.0)
        moved = square > 0.0
        self.share[rows[moved]] = share[moved]

    def _within_limits(self, u: Array, move: Array) -> Array:
        """Moves (n, dof) from joints (n, dof), ended where the first joint reaches its limit."""
        room = np.where(move > 0.0, 1.0 - u, u)
        size = np.abs(move)
        free = self.newton.scale.periodic | (size < 1e-12)
        # limits hold the joints at them
        free |= room <= SOLVER.slack
        size = np.where(free, 1.0, size)
        room = np.where(free, np.inf, room)
        share = np.minimum(1.0, (room / size).min(axis=1))
        return np.asarray(share[:, None] * move)
