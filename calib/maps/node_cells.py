"""Node cells: the nodes nearest to one point, found in microseconds.

A search tree answers thousands of points at once; for a single one its call costs more than
the answer.  Here a grid of cells over the unit box lists, for each cell, every node that can be
among the nearest of one of its points.  Answers are those of `node_bounds.blend_nodes`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import mul
from typing import Any

import numpy as np

from .local_models import blend_size
from .map import Map

_PER_NODE = 4.0  # cells for each node
_MOST_JOINTS = 3  # lists of more dimensions would hold most of the nodes

_Points = tuple[tuple[float, ...], ...]
_Near = tuple[list[int], list[float]]


@dataclass(frozen=True, eq=False)
class NodeCells:
    """The nodes of a map, listed by cells of the unit box."""

    side: int  # cells along each axis
    count: int  # nodes that speak for a point; one more limits their weights
    # for each cell the candidates: where they are, and their numbers
    cells: list[tuple[_Points, tuple[int, ...]]] = field(repr=False)

    @staticmethod
    def of(motor: Map, count: int | None = None) -> NodeCells | None:
        """The cells of a map; None where it has too many dimensions, or too few nodes.

        `count` nodes speak for a point, as many as `node_bounds.blend_nodes` has where not
        given; of 0 only the nearest is known.
        """
        units, dof = motor.units, motor.units.shape[1]
        if dof > _MOST_JOINTS:
            return None
        side = max(1, math.ceil((_PER_NODE * motor.size) ** (1 / dof)))
        axis = (np.arange(side) + 0.5) / side
        centers = np.stack(np.meshgrid(*[axis] * dof, indexing="ij"), axis=-1).reshape(-1, dof)
        count = min(blend_size(dof) if count is None else count, motor.size - 1)
        away = motor.nearest(centers, count + 1)[0][:, -1]
        # whatever is nearest to a point of the cell is no further from its centre than this
        reach = away + math.sqrt(dof) / side * (1.0 + 1e-9)
        found = motor.tree.query_ball_point(centers, reach)
        if motor.scale.periodic.any() and reach.max() + 1.0 / side >= 0.5:
            return None  # so few nodes that one may be nearest from both sides
        counts = np.array([len(nodes) for nodes in found])
        owner = np.repeat(np.arange(len(found)), counts)
        node = np.concatenate([np.sort(nodes) for nodes in found]).astype(np.intp)
        # each node the short way round from its cell, so that no query has to ask
        turns = np.where(motor.scale.periodic, np.round(units[node] - centers[owner]), 0.0)
        seen = units[node] - turns
        kept: dict[Any, Any] = {}  # a point and a number once, not in every cell
        rows = [kept.setdefault(row, row) for row in zip(*seen.T.tolist(), strict=True)]
        numbers = [kept.setdefault(n, n) for n in node.tolist()]
        ends = np.cumsum(counts).tolist()
        cells = [(tuple(rows[a:b]), tuple(numbers[a:b])) for a, b in itertools.pairwise([0, *ends])]
        return NodeCells(side, count, cells)

    def near(self, u: Sequence[float]) -> _Near:
        """Nodes that speak for a point of the unit box, and their weights, which sum to 1."""
        points, nodes = self.cells[self._place(u)]
        away = _distances(points, u)
        furthest = sorted(away)[self.count]
        found, weights = [], []
        for d, n in zip(away, nodes, strict=True):
            if d < furthest:
                share = d / furthest
                weight = 1.0 - share * share
                found.append(n)
                weights.append(weight * weight)
        total = sum(weights)
        if not total > 0.0:  # all equally far
            every = sorted(zip(away, nodes, strict=True))[: self.count]
            return [n for _, n in every], [1.0 / self.count] * self.count
        return found, [w / total for w in weights]

    def _place(self, u: Sequence[float]) -> int:
        """Number of the cell that holds a point; outside of the box the nearest cell."""
        side, place = self.side, 0
        for value in u:
            k = int(value * side)
            place = place * side + (0 if k < 0 else side - 1 if k >= side else k)
        return place

    def nearest(self, u: Sequence[float]) -> tuple[float, int] | None:
        """Distance and number of the nearest node; None outside of the box that cells cover."""
        for value in u:
            if not 0.0 <= value <= 1.0:
                return None
        points, nodes = self.cells[self._place(u)]
        away = _distances(points, u)
        least = min(away)
        return least, nodes[away.index(least)]

    def blend(self, u: Sequence[float], values: Sequence[float]) -> float:
        """Values of the nodes, blended at a point of the unit box."""
        points, nodes = self.cells[self._place(u)]
        away = _distances(points, u)
        furthest = sorted(away)[self.count]
        total = blended = 0.0
        for d, n in zip(away, nodes, strict=True):
            if d < furthest:  # the weights of `near`, without lists of them
                share = d / furthest
                weight = 1.0 - share * share
                weight *= weight
                total += weight
                blended += weight * values[n]
        if total > 0.0:
            return blended / total
        found, weights = self.near(u)  # all equally far
        mean: float = sum(map(mul, weights, map(values.__getitem__, found)))
        return mean


def _distances(points: _Points, u: Sequence[float]) -> list[float]:
    """Distances of points from one, in a loop of C: Python's takes twice as long.

    `math.dist` copies what is no tuple, each time.
    """
    return list(map(math.dist, points, itertools.repeat(tuple(u))))
