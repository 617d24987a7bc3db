"""Inverse: from a position to joints, through the links and the learned forward map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.predictor import Predictor
from .newton import Newton, shortened
from .settings import SEARCH
from .starts import Starts, distinct, drawn, rank_within, twins
from .task import Positions

_SHORT = 0.03  # of the joints' range: after a first step so short the start is the joints given
_ALIKE = 4.0  # node spacings: solutions of redundant joints that are about as close
# spare joints of which no lattice holds all families: starts are drawn
_MANY = 3
_DRAWN = 128
# joints from which what was missed is tried again; what is drawn so far beyond a limit is at it
_AGAIN = 32
_BEYOND = 0.2
_WIDE = 8  # sensory nodes whose partners are tried where others have failed

_STEP = 0.03  # of the joints' range: length of a step along a self-motion
_WALK = 60  # most steps from one solution to another
_STUCK = 0.05  # share of the way ahead that a step has to be able to go
_ROUNDS = (
    7  # attempts to join what is still apart, each of twice as many pairs of a group
)
_NEAREST = 31  # solutions of the same target that one may be joined with


@dataclass(frozen=True)
class Solver:
    """Solves forward(q) = x inside of the joints' range."""

    # its links propose where to start: every motor node that was ever active with the target, so
    # every branch is among them
    association: Association
    predictor: Predictor  # the learned forward map, whose own Jacobian is used

    @cached_property
    def extent(self) -> float:
        """Diagonal of the workspace [unit]."""
        return float(np.linalg.norm(self.association.sensory.scale.span))

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than coordinates of a position."""
        pair = self.association
        return bool(pair.motor.units.shape[1] > pair.sensory.units.shape[1])

    @cached_property
    def newton(self) -> Newton:
        """Damped steps towards a target."""
        return Newton(
            Positions(self.predictor.value_and_slope), self.scale, self.extent
        )

    @cached_property
    def starts(self) -> Starts:
        """Where the links say that a solution may be."""
        return Starts(self.association, self.newton)

    @property
    def scale(self) -> Scale:
        """Range of the joints."""
        return self.association.motor.scale

    def solve(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) for targets `x` (n, m) nearest to `near` (n, dof), what is left (n,).

        Joints are in the unit box; out of reach they are those of the nearest attainable point.
        """
        u = self.clip(near)
        distance = np.full(len(x), np.inf)
        beside = np.arange(len(x))
        if not self.redundant:
            step = self.newton.towards(u, x, 1e-12)
            beside = np.flatnonzero(np.abs(step).max(axis=1) < _SHORT)
        if len(beside):
            u[beside], distance[beside] = self.newton.settle(
                u[beside], x[beside], near[beside]
            )
        away = np.linalg.norm(self.scale.difference(u, near), axis=1)
        alike = (
            _ALIKE * self.association.motor.spacing if self.redundant else SEARCH.beside
        )
        rows = np.flatnonzero((distance > SEARCH.close * self.extent) | (away > alike))
        if len(rows):  # where that misses or leads far away, from the links
            start, folded = self.starts.of(x[rows])
            away = np.linalg.norm(
                self.scale.difference(start, near[rows, None]), axis=2
            )
            away = np.where(np.isnan(away), np.inf, away)
            first = away.min(axis=1, keepdims=True)
            close = away <= (first + alike if self.redundant else np.inf)
            owner, column = np.nonzero(close & np.isfinite(away))
            self._try(u, distance, x, near, rows[owner], start[owner, column])
            if len(rows := rows[folded]):
                owner, across = twins(self.newton, u[rows])
                self._try(u, distance, x, near, rows[owner], across)
        missed = np.flatnonzero(distance > SEARCH.close * self.extent)
        if len(missed):  # and from more places
            owner, wider = self.starts.propose(x[missed], _WIDE)
            everywhere = np.tile(drawn(_AGAIN, u.shape[1], _BEYOND), (len(missed), 1))
            owner = np.append(missed[owner], np.repeat(missed, _AGAIN))
            self._try(u, distance, x, near, owner, np.concatenate([wider, everywhere]))
            missed = np.flatnonzero(distance > SEARCH.close * self.extent)
            u[missed], distance[missed] = self.newton.closest(u[missed], x[missed])
        return u, distance

    def _try(
        self, u: Array, left: Array, x: Array, near: Array, owner: Index, start: Array
    ) -> None:
        """Replace answers by better ones from starts (k, dof) for targets (k,), in place."""
        if not len(owner):
            return
        found = self.newton.settle(start, x[owner], near[owner])
        self.newton.take_better(u, left, near, owner, *found)

    def solve_all(self, x: Array) -> tuple[Index, Array, Array]:
        """Every distinct solution of targets (n, m): of which it is, joints (k, dof), distance.

        Sorted by target, the one nearest to the middle of the unit box first.  Of redundant joints
        each connected family has one; out of reach there is one, the nearest attainable point.
        """
        target, u, distance = self.solutions(x)
        if self.redundant and len(u):
            target, u = _representatives(self.newton, target, u, x)
            distance = np.linalg.norm(self.predictor.value(u) - x[target], axis=1)
        lost = np.setdiff1d(np.arange(len(x)), target)
        if len(lost):
            found, found_distance = self.solve(
                x[lost], np.full((len(lost), u.shape[1]), 0.5)
            )
            target = np.concatenate([target, lost])
            u = np.concatenate([u, found])
            distance = np.concatenate([distance, found_distance])
        return self._by_middle(target, u, distance)

    def solutions(self, x: Array) -> tuple[Index, Array, Array]:
        """Solutions of each target as `solve_all` finds them, many of each family."""
        start, _ = self.starts.of(x)
        target, column = np.nonzero(~np.isnan(start[..., 0]))
        u = start[target, column]
        if u.shape[1] >= x.shape[1] + _MANY:
            target = np.append(target, np.repeat(np.arange(len(x)), _DRAWN))
            u = np.concatenate([u, np.tile(drawn(_DRAWN, u.shape[1]), (len(x), 1))])
        u, distance = self.newton.refine(u, x[target])
        if (
            not self.redundant
        ):  # where branches meet they change much between neighbouring nodes
            row, across = twins(self.newton, u)
            folded = np.unique(target[row])
            owner, wide = self.starts.propose(x[folded], _WIDE)
            owner = np.append(target[row], folded[owner])
            more = np.concatenate([across, wide])
            more, left = self.newton.refine(more, x[owner])
            target = np.append(target, owner)
            u = np.concatenate([u, more])
            distance = np.append(distance, left)
        met = distance <= SEARCH.close * self.extent
        target, u, distance = self._by_middle(target[met], u[met], distance[met])
        keep = distinct(self.scale, target, u, SEARCH.same)
        return target[keep], u[keep], distance[keep]

    def _by_middle(
        self, target: Index, u: Array, distance: Array
    ) -> tuple[Index, Array, Array]:
        """Solutions sorted by target and distance to the middle of the ranges."""
        away = np.linalg.norm(self.scale.difference(u, np.full_like(u, 0.5)), axis=1)
        order = np.lexsort((away, target))
        return target[order], u[order], distance[order]

    def clip(self, u: Array) -> Array:
        """Points (n, dof) moved into the unit box; a periodic joint goes round instead."""
        return self.newton.clip(u)


def _representatives(
    newton: Newton, target: Index, u: Array, x: Array
) -> tuple[Index, Array]:
    """One solution of each connected family: the one closest to the middle of the ranges."""
    # two are of one family if small steps along the self-motion, on target and inside of the
    # limits, lead from one to the other: each group tries the nearest of others, more and more
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b, gap = _pairs(newton, target, u)
    label = np.arange(len(u))
    ways = np.zeros((2, 0), dtype=np.intp)
    for round_ in range(_ROUNDS):
        other = np.flatnonzero(label[a] != label[b])
        if not len(other):
            break
        # the shortest ways out of each group
        order = other[np.lexsort((gap[other], label[a[other]]))]
        first = order[rank_within(label[a[order]]) < 2**round_]
        met = first[_walk(newton, u[a[first]], u[b[first]], x[target[a[first]]])]
        ways = np.hstack([ways, np.array([a[met], b[met]])])
        graph = coo_array((np.ones(ways.shape[1]), tuple(ways)), shape=(len(u), len(u)))
        label = connected_components(graph.tocsr())[1].astype(np.intp)
        a = np.delete(a, first)
        b = np.delete(b, first)
        gap = np.delete(gap, first)
    middle = np.full_like(u, 0.5)
    away = np.linalg.norm(newton.scale.difference(u, middle), axis=1)
    order = np.lexsort((away, label))
    chosen = np.sort(order[np.append(True, np.diff(label[order]) > 0)])
    target = target[chosen]
    u = u[chosen]
    settled, distance = newton.settle(u, x[target], middle[chosen], longest=_STEP)
    return target, np.where(
        (distance <= SEARCH.close * newton.extent)[:, None], settled, u
    )


def _pairs(newton: Newton, target: Index, u: Array) -> tuple[Index, Index, Array]:
    """Pairs of solutions of the same target, each with those nearest to it, and their distances."""
    rows = [target[:0]]
    columns = [target[:0]]
    gaps = [np.zeros(0)]
    for own in np.split(np.arange(len(u)), np.flatnonzero(np.diff(target)) + 1):
        gap = np.linalg.norm(newton.scale.difference(u[own, None], u[own]), axis=2)
        near = np.argsort(gap, axis=1)[:, 1 : _NEAREST + 1]
        rows.append(np.repeat(own, near.shape[1]))
        columns.append(own[near].ravel())
        gaps.append(np.take_along_axis(gap, near, axis=1).ravel())
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(gaps)


def _walk(newton: Newton, start: Array, goal: Array, x: Array) -> NDArray[np.bool_]:
    """Whether steps along the self-motion lead from `start` to `goal`, (n,)."""
    arrived = np.zeros(len(start), dtype=bool)
    rows = np.arange(len(start))
    u = start
    for _ in range(_WALK):
        wish = newton.scale.difference(goal[rows], u)
        ahead = np.linalg.norm(wish, axis=1)
        near = ahead < 0.3 * _STEP
        arrived[rows[near]] = True
        rows = rows[~near]
        u = u[~near]
        wish = wish[~near]
        ahead = ahead[~near]
        if not len(rows):
            break
        move = newton.tangent(u, wish)
        length = np.linalg.norm(move, axis=1)
        trial, distance = newton.refine(
            u + shortened(move, _STEP), x[rows], SEARCH.close
        )
        moved = np.linalg.norm(newton.scale.difference(trial, u), axis=1)
        now = np.linalg.norm(newton.scale.difference(goal[rows], trial), axis=1)
        going = (length > _STUCK * ahead) & (distance <= SEARCH.close * newton.extent)
        going &= (moved < 2 * _STEP) & (now < ahead)
        rows = rows[going]
        u = trial[going]
    return arrived


def free_directions(jacobian: Array) -> Array:
    """Directions (k, dof) that leave what a Jacobian (m, dof) reaches, each with a joint at 1."""
    from scipy.linalg import qr

    _, size, vt = np.linalg.svd(jacobian)
    null = vt[int((size > 1e-6 * size[0]).sum()) :]
    if not len(null):
        return null
    own = np.sort(qr(null, mode="r", pivoting=True)[1][: len(null)])
    return np.asarray(np.linalg.solve(null[:, own], null))
