"""Starts: joints from which every branch of a target is reached, as the links propose them.

Folds, where two branches meet because the arm is stretched or folded, get starts of their own.
"""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index
from ..maps.association import Association
from ..maps.map import search_tree
from .newton import CLOSE, Newton

_SENSORY = 3  # sensory nodes whose partners are looked at
_REACH = 2.0  # a node's first step is at most so many node spacings long
_MOST = 60  # proposals of a target
_CELL = 1.5  # proposals closer than so many node spacings count as one
_APART = 0.3  # refined starts of two joints closer than so many spacings are one
_MISSED = 2.0  # a start may miss its sensory node by so many of its spacings
_WIDTH = {1: 8, 2: 8}  # most starts of a sensory node
_WIDEST = 32  # the same, of redundant arms
_RANKS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144)  # nodes that are tried, nearest first
_CORNERED = 4  # most joints whose corners are tried as well
_AHEAD = 48  # sensory nodes that a single query makes known
_CHUNK = 512  # sensory nodes at once

FOLDED = 0.05
"""Share of the Jacobian's sum of squares below which that of its least direction tells a fold."""

_PROBE = 1e-4  # of the joints' range: step of the derivative of the least singular value
_FAR = 0.3  # of the joints' range: a twin is not looked for further away


class Starts:
    """For each sensory node the joints that lead there: one start per branch.

    Every motor node that was ever active with a sensory node is linked to it, so every
    branch is among them.  They are refined and merged when a sensory node is first asked
    for, and kept: many targets share them.

    association : the maps and their links
    newton : refines what the links propose
    """

    def __init__(self, association: Association, newton: Newton) -> None:
        self.association, self.newton = association, newton
        nodes, dof = association.sensory.size, association.motor.units.shape[1]
        outputs, width = association.sensory.units.shape[1], _WIDTH.get(dof, _WIDEST)
        self._known = np.zeros(nodes, dtype=bool)
        self._u = np.full((nodes, width, dof), np.nan)
        self._value = np.full((nodes, width, outputs), np.nan)
        self._inverse = np.zeros((nodes, width, dof, outputs))
        self._folded = np.zeros(nodes, dtype=bool)

    def of(self, x: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Starts (n, k, dof) for targets `x` (n, m) in the unit box; NaN beyond the last.

        Each is one linear step towards the target from a start, `step` (n, k) node spacings long.
        Whether two branches may meet near the target is told by `folded` (n,).
        """
        motor, sensory = self.association.motor, self.association.sensory
        node = sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]
        self._ask(node)
        inverse = self._inverse[node]
        gap = (x[:, None] - self._value[node])[..., None, :]
        move = inverse[..., 0] * gap[..., 0] + inverse[..., 1] * gap[..., 1]
        if gap.shape[-1] > 2:
            move += inverse[..., 2] * gap[..., 2]
        length = np.sqrt((move * move).sum(axis=2)) * (1.0 / motor.spacing)
        long = length > _REACH
        if long.any():
            move *= np.where(long, _REACH / np.where(long, length, 1.0), 1.0)[..., None]
        u = self._u[node] + move
        u = self.newton.clip(u.reshape(-1, u.shape[2])).reshape(u.shape)
        return u, length, self._folded[node]

    def _ask(self, nodes: Index) -> None:
        """Make sure that the starts of these sensory nodes are known."""
        missing = np.unique(nodes[~self._known[nodes]])
        if 0 < len(missing) < _AHEAD:
            # single queries follow each other: their neighbours in one go, for later
            sensory = self.association.sensory
            around = sensory.nearest(sensory.units[missing], min(_AHEAD, sensory.size))[1]
            missing = np.unique(around[~self._known[around]])
        for first in range(0, len(missing), _CHUNK):
            self._learn(missing[first : first + _CHUNK])
        self._known[missing] = True

    def _learn(self, nodes: Index) -> None:
        sensory = self.association.sensory
        x = sensory.scale.from_unit(sensory.units[nodes])
        target, u = self.propose(x)
        u, distance = self.newton.refine(u, x[target], CLOSE)
        order = np.lexsort((distance, target))
        target, u, distance = target[order], u[order], distance[order]
        place = _place(target)
        table = np.full((len(nodes), int(place.max()) + 1, u.shape[1]), np.nan)
        missed = np.full(table.shape[:2], np.inf)
        table[target, place], missed[target, place] = u, distance
        # the best of each node first, as many as there is room for
        row, column = np.nonzero(self._distinct(table, missed))
        place = _place(row)
        fits = place < self._u.shape[1]
        row, column, place = row[fits], column[fits], place[fits]
        u = table[row, column]
        value, slope = self.newton.task.value_and_slope(u)
        self._u[nodes[row], place], self._value[nodes[row], place] = u, value
        self._inverse[nodes[row], place] = damped_inverse(slope, 1e-4)
        if slope.shape[1] == slope.shape[2]:
            size = np.linalg.svd(slope, compute_uv=False)
            flat = size[:, -1] ** 2 <= FOLDED * (size * size).sum(axis=1)
            self._folded[nodes[row[flat]]] = True

    def _distinct(self, table: Array, missed: Array) -> NDArray[np.bool_]:
        """Which of the starts (n, k, dof), best first, are near their node and no repeats."""
        motor, sensory = self.association.motor, self.association.sensory
        kept = missed <= _MISSED * sensory.spacing * float(sensory.scale.span.mean())
        kept[:, :3] |= ~kept.any(axis=1, keepdims=True) & np.isfinite(missed[:, :3])
        hit = missed <= CLOSE * self.newton.extent
        redundant = table.shape[2] > sensory.units.shape[1]
        apart = np.where(hit, _CELL if redundant else _APART, 1.0) * motor.spacing
        for k in range(1, table.shape[1]):
            gap = np.abs(motor.scale.difference(table[:, :k], table[:, k, None])).max(axis=2)
            close = kept[:, :k] & (gap < np.minimum(apart[:, :k], apart[:, k, None]))
            kept[:, k] &= ~close.any(axis=1)
        return kept

    def propose(self, x: Array, sensory_nodes: int = _SENSORY) -> tuple[Index, Array]:
        """What the links say of targets `x` (n, m): joints (k, dof), and of which target (k,).

        Joints are in the unit box, one node's linear step towards the target, unrefined; targets
        ascend.
        """
        motor, sensory = self.association.motor, self.association.sensory
        seen = sensory.nearest(sensory.scale.to_unit(x), min(sensory_nodes, sensory.size))[1]
        found = self.association.partners.take(seen.ravel())
        pair = np.unique(found.rows // seen.shape[1] * motor.size + found.indices)
        target, node = np.divmod(pair, motor.size)
        value, inverse = self._nodes
        gap = x[target] - value[node]
        step = np.einsum("nij,nj->ni", inverse[node], gap)
        length = np.linalg.norm(step, axis=1) / motor.spacing
        u = self.newton.clip(motor.units[node] + step / np.maximum(length / _REACH, 1.0)[:, None])
        # one proposal per cell: the one with the shortest step
        cell = np.floor(u / (_CELL * motor.spacing)).astype(np.int64)
        order = np.lexsort((length, *cell.T, target))
        key = np.column_stack([target, cell])[order]
        keep = order[np.append(True, np.any(key[1:] != key[:-1], axis=1))]
        # where none is likely (a target out of reach, a singular pose) the best three
        close = length[keep] <= _REACH
        rank = np.lexsort((np.linalg.norm(gap[keep], axis=1), ~close, target[keep]))
        keep, close = keep[rank], close[rank]
        owner = target[keep]
        likely = np.bincount(owner, close, minlength=len(x))[owner] > 0
        keep = keep[np.where(likely, close, True) & (_place(owner) < np.where(likely, _MOST, 3))]
        return target[keep], u[keep]

    def around(self, x: Array) -> tuple[Index, Array]:
        """Some of the motor nodes whose own positions are near the targets, as `propose`.

        The nearest ones, and fewer and fewer of those further away: of two lobes of the
        workspace the nearer one can have the further nodes.
        """
        motor = self.association.motor
        ranks = np.array([k for k in _RANKS if k <= motor.size])
        tree = search_tree(self._nodes[0], self.association.sensory.scale)
        nodes = np.clip(motor.units[np.asarray(tree.query(x, k=ranks)[1])], 0.0, 1.0)
        # no node stands in a corner of the joints' range, where the workspace may end
        dof = nodes.shape[2]
        corners = list(itertools.product((0.0, 1.0), repeat=dof)) if dof <= _CORNERED else []
        corner = np.array(corners).reshape(1, -1, dof).repeat(len(x), axis=0)
        u = np.concatenate([nodes, corner], axis=1)
        return np.repeat(np.arange(len(x)), u.shape[1]), u.reshape(-1, dof)

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Position (nodes, m) and damped inverse Jacobian (nodes, dof, m) of each node."""
        units = np.clip(self.association.motor.units, 0.0, 1.0)
        value, slope = self.newton.task.value_and_slope(units)
        return value, damped_inverse(slope, 1e-4)


def _place(owner: Index) -> Index:
    """The how many-eth of its owner each row is, of owners (n,) that ascend."""
    return np.arange(len(owner)) - np.searchsorted(owner, owner)


def damped_inverse(slope: Array, share: float) -> Array:
    """J' (J J' + damping)^-1 of Jacobians (n, m, dof), (n, dof, m).

    The damping is a share of the sum of squares of each Jacobian.
    """
    power = np.einsum("nid,njd->nij", slope, slope)
    diagonal = np.einsum("nii->ni", power)
    diagonal += np.maximum(share * diagonal.sum(axis=1, keepdims=True), 1e-300)
    return np.asarray(np.einsum("nid,nij->ndj", slope, np.linalg.inv(power)))


def twins(newton: Newton, u: Array, share: float = FOLDED, far: Any = _FAR) -> tuple[Index, Array]:
    """Starts (m, dof) for the solutions across a nearby fold of `u` (n, dof), and of which rows.

    At a fold, where the Jacobian loses a direction, two solutions meet. Along the direction that
    hardly moves the tip its least singular value falls linearly to zero, and the other solution
    lies about as far beyond as this one lies before: no more than `far` (n,). Of as many joints as
    residuals.
    """
    slope = newton.task.value_and_slope(u)[1]
    sides, size, ways = np.linalg.svd(slope)
    rows = np.flatnonzero(size[:, -1] ** 2 <= share * (size * size).sum(axis=1))
    if not len(rows):
        return rows, u[:0]
    side, flat = sides[rows, :, -1], ways[rows, -1]
    ahead, behind = (
        np.einsum(
            "nm,nmd,nd->n", side, newton.task.value_and_slope(u[rows] + probe * flat)[1], flat
        )
        for probe in (_PROBE, -_PROBE)
    )
    rate = (ahead - behind) / (2 * _PROBE)
    reach = -2.0 * size[rows, -1] / np.where(rate == 0.0, np.inf, rate)
    near = (np.abs(reach) < np.broadcast_to(far, len(u))[rows]) & (reach != 0.0)
    return rows[near], newton.clip(u[rows[near]] + reach[near, None] * flat[near])
