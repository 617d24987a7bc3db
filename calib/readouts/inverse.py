"""Inverse: from a position to joints, through the links and the learned forward map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..maps.map import Map
from .linked import Association
from .predictor import Predictor

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_SENSORY = 3  # sensory nodes whose partners are looked at
_REACH = 2.0  # a start's first step is at most so many node spacings long
_CELL = 1.5  # starts closer than so many node spacings count as one
_STEPS = 40  # most iterations
_TOLERANCE = 1e-12  # of the extent, below which a target is met
_MET = 1e-9  # of the extent, below which redundant joints may slide
_SLIDES = 12  # most slides towards the joints that are wished for
_SETTLED = 1e-6  # of the joints' range, below which a slide is the last


@dataclass(frozen=True)
class Solver:
    """Solves forward(q) = x inside of the joints' range.

    Attributes
    ----------
    association : Association
        Its links propose where to start: every motor node that was ever active with the
        target, so every branch is among them.
    predictor : Predictor
        The learned forward map, whose own Jacobian is used.
    """

    association: Association
    predictor: Predictor

    @cached_property
    def extent(self) -> float:
        """Diagonal of the workspace [unit]."""
        return float(np.linalg.norm(self.association.sensory.scale.span))

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Position (nodes, 2) and damped inverse Jacobian (nodes, dof, 2) of each node."""
        value, slope = self.predictor.value_and_slope(np.clip(self._motor.units, 0.0, 1.0))
        return value, _damped_inverse(slope, 1e-4 * _power(slope))

    @property
    def _motor(self) -> Map:
        return self.association.motor

    def starts(self, x: Array) -> tuple[Index, Array, Array]:
        """Where to start for the targets `x` (n, 2).

        Returns
        -------
        target : (m,) int array
            Which target each start belongs to, ascending.
        u : (m, dof) array
            Joints in the unit box, one node's linear step towards the target.
        close : (m,) bool array
            Whether that step stays in the node's own neighbourhood: a likely solution.
        """
        motor, sensory = self.association.motor, self.association.sensory
        partners = self.association.partners
        seen = sensory.nearest(sensory.scale.to_unit(x), min(_SENSORY, sensory.size))[1]
        counts = np.diff(partners.indptr)[seen]
        flat = np.repeat(np.cumsum(counts) - counts.ravel(), counts.ravel())
        place = np.arange(len(flat)) - flat + np.repeat(partners.indptr[seen], counts.ravel())
        target = np.repeat(np.arange(len(x)), counts.sum(axis=1))
        pair = np.unique(target * motor.size + partners.indices[place])
        target, node = np.divmod(pair, motor.size)

        value, inverse = self._nodes
        gap = x[target] - value[node]
        step = np.einsum("nij,nj->ni", inverse[node], gap)
        length = np.linalg.norm(step, axis=1) / motor.spacing
        u = self.clip(motor.units[node] + step / np.maximum(length / _REACH, 1.0)[:, None])
        close = length <= _REACH
        # one start per cell: the one with the shortest step
        cell = np.floor(u / (_CELL * motor.spacing)).astype(np.int64)
        bits = [cell[:, k] for k in range(cell.shape[1])]
        order = np.lexsort((length, *bits, target))
        key = np.column_stack([target, cell])[order]
        first = np.append(True, np.any(key[1:] != key[:-1], axis=1))
        keep = order[first]
        # where no start is likely (a target out of reach, a singular pose) the best three
        rank = np.lexsort((np.linalg.norm(gap[keep], axis=1), ~close[keep], target[keep]))
        keep = keep[rank]
        owner = target[keep]
        place_in_row = np.arange(len(keep)) - np.searchsorted(owner, owner)
        likely = np.bincount(owner, close[keep], minlength=len(x))[owner] > 0
        keep = keep[close[keep] | (~likely & (place_in_row < 3))]
        return target[keep], u[keep], close[keep]

    def refine(self, u: Array, x: Array) -> tuple[Array, Array]:
        """Damped Newton steps (Levenberg-Marquardt) inside of the box.

        Parameters
        ----------
        u, x : (n, dof), (n, 2) array
            Starts in the unit box and their targets.

        Returns
        -------
        u : (n, dof) array
            The nearest attainable point that was found from each start.
        distance : (n,) array
            What is left between its position and the target.
        """
        u = self.clip(u.copy())
        value, slope = self.predictor.value_and_slope(u)
        gap = x - value
        left = np.linalg.norm(gap, axis=1)
        damping = np.full(len(u), 1e-9)
        active = np.flatnonzero(left > _TOLERANCE * self.extent)
        slopes, gaps = slope[active], gap[active]
        for _ in range(_STEPS):
            if not len(active):
                break
            free = self._free(u[active], slopes, gaps)
            masked = slopes * free[:, None, :]
            power = _power(slopes)
            inverse = _damped_inverse(masked, damping[active] * power)
            step = np.einsum("nij,nj->ni", inverse, gaps)
            trial = self.clip(u[active] + step)
            value, slope = self.predictor.value_and_slope(trial)
            gap = x[active] - value
            now = np.linalg.norm(gap, axis=1)
            better = now < left[active]
            moved = np.abs(trial - u[active]).max(axis=1)
            rows = active[better]
            gain = (left[rows] - now[better]) / np.maximum(left[rows], 1e-300)
            u[rows], left[rows] = trial[better], now[better]
            slopes[better], gaps[better] = slope[better], gap[better]
            damping[active] = np.where(
                better,
                np.maximum(damping[active] / 30, 1e-12),
                np.maximum(damping[active] * 30, 1e-6),
            )
            done = (moved < 1e-13) | (damping[active] > 1e3)
            done |= left[active] < _TOLERANCE * self.extent
            stalled = np.zeros(len(active), dtype=bool)
            stalled[better] = gain < 1e-9
            keep = ~(done | stalled)
            active, slopes, gaps = active[keep], slopes[keep], gaps[keep]
        return u, left

    def settle(self, u: Array, x: Array, near: Array) -> tuple[Array, Array]:
        """Slide redundant joints along their self-motion towards `near`, on target.

        The null space of the Jacobian is left free by the target; each move within it is
        followed by :meth:`refine`, and kept if it is closer and still on target.
        """
        u, left = self.refine(u, x)
        if u.shape[1] <= 2:
            return u, left
        scale = self._motor.scale
        away = np.linalg.norm(scale.difference(near, u), axis=1)
        share = np.ones(len(u))
        active = np.flatnonzero(left <= _MET * self.extent)
        for _ in range(_SLIDES):
            if not len(active):
                break
            at = u[active]
            slope = self.predictor.value_and_slope(at)[1]
            pull = scale.difference(near[active], at)
            pull *= self._free(at, slope, np.zeros((len(at), 2)), pull)
            inverse = _damped_inverse(slope, 1e-9 * _power(slope))
            pull -= np.einsum("nij,njk,nk->ni", inverse, slope, pull)
            trial, after = self.refine(at + share[active, None] * pull, x[active])
            now = np.linalg.norm(scale.difference(near[active], trial), axis=1)
            gain = away[active] - now
            good = (gain > 0) & (after <= np.maximum(left[active], _MET * self.extent))
            rows = active[good]
            u[rows], left[rows], away[rows] = trial[good], after[good], now[good]
            share[active] = np.where(good, np.minimum(1.0, 2 * share[active]), share[active] / 4)
            active = active[(share[active] > 0.02) & ~(good & (gain < _SETTLED))]
        return u, left

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        periodic = self._motor.scale.periodic
        if periodic.any():
            return np.where(periodic, u % 1.0, np.clip(u, 0.0, 1.0))
        return np.clip(u, 0.0, 1.0)

    def _free(
        self, u: Array, slope: Array, gap: Array, pull: Array | None = None
    ) -> NDArray[np.bool_]:
        """Joints that may move: not those at a limit that the step would push further."""
        push = np.einsum("noi,no->ni", slope, gap) if pull is None else pull
        stuck = ((u <= 0.0) & (push < 0)) | ((u >= 1.0) & (push > 0))
        return np.asarray(~(stuck & ~self._motor.scale.periodic))


def _power(slope: Array) -> Array:
    """Sum of squares of each Jacobian (n,), the scale of its damping."""
    total: Array = np.einsum("noi,noi->n", slope, slope)
    return total


def _damped_inverse(slope: Array, damping: Array) -> Array:
    """J' (J J' + damping)^-1 of Jacobians (n, 2, dof), (n, dof, 2)."""
    a, b = slope[:, 0], slope[:, 1]
    aa = np.einsum("ni,ni->n", a, a) + damping
    bb = np.einsum("ni,ni->n", b, b) + damping
    ab = np.einsum("ni,ni->n", a, b)
    det = np.maximum(aa * bb - ab * ab, 1e-300)
    first = (a * bb[:, None] - b * ab[:, None]) / det[:, None]
    second = (b * aa[:, None] - a * ab[:, None]) / det[:, None]
    return np.stack([first, second], axis=2)
