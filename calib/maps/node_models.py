"""Local models of the nodes for one query, in plain Python floats.

The counterpart of `local_models.predict` for a control loop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..body.basis import exponents
from .local_models import SILENT, LocalModels, heard, reach_of
from .map import Map
from .node_cells import NodeCells

_Term = tuple[tuple[int, ...], float, float]


@dataclass(frozen=True, eq=False)
class NodeModels:
    """Polynomials of the nodes."""

    cells: NodeCells  # finds the nodes that speak for a point
    # for each node its coordinates, radius and terms (exponents, x, y); only what is not zero
    nodes: list[tuple[list[float], float, list[_Term]]] = field(repr=False)
    periodic: tuple[bool, ...]  # axes whose ends meet
    # how far each node speaks in full, in the unit box; None where it always does
    reach: list[float] | None = field(default=None, repr=False)
    # share of the weight below which silent nodes decide, 0 where they have no vote
    votes: float = SILENT
    # for each node the half-space in which it speaks, see :mod:`calib.maps.gates`
    gates: list[list[float]] | None = field(default=None, repr=False)

    @staticmethod
    def of(models: LocalModels, motor: Map, cells: NodeCells) -> NodeModels:
        """The local models of a motor map."""
        powers = [tuple(e) for e in exponents(motor.units.shape[1], models.degree).tolist()]
        nodes = []
        for w, radius, rows in zip(
            motor.units.tolist(), models.radius.tolist(), models.coefficients.tolist(), strict=True
        ):
            terms = [(e, x, y) for e, (x, y) in zip(powers, rows, strict=True) if x or y]
            nodes.append((w, radius, terms))
        reach = reach_of(motor).tolist() if models.fades else None
        periodic = tuple(bool(p) for p in motor.scale.periodic)
        gates = None if models.gates is None else models.gates.tolist()
        return NodeModels(cells, nodes, periodic, reach, models.votes, gates)

    def value(self, u: Sequence[float]) -> tuple[float, float]:
        """Blended correction at a point of the unit box."""
        x = y = 0.0
        for n, weight, z in self._speaking(u):
            terms = self.nodes[n][2]
            for powers, cx, cy in terms:
                factor = weight
                for value, power in zip(z, powers, strict=True):
                    for _ in range(power):
                        factor *= value
                x += factor * cx
                y += factor * cy
        return x, y

    def value_and_slope(self, u: Sequence[float]) -> tuple[float, float, list[float], list[float]]:
        """Blended correction and its derivatives by the unit coordinates."""
        x = y = 0.0
        gx, gy = [0.0] * len(u), [0.0] * len(u)
        for n, weight, z in self._speaking(u):
            terms = self.nodes[n][2]
            per_unit = weight / self.nodes[n][1]
            for powers, cx, cy in terms:
                factor = weight
                for value, power in zip(z, powers, strict=True):
                    factor *= value**power
                x += factor * cx
                y += factor * cy
                for k, power in enumerate(powers):
                    if not power:
                        continue
                    tilt = per_unit * power
                    for j, (value, other) in enumerate(zip(z, powers, strict=True)):
                        tilt *= value ** (other - (j == k))
                    gx[k] += tilt * cx
                    gy[k] += tilt * cy
        return x, y, gx, gy

    def _speaking(self, u: Sequence[float]) -> list[tuple[int, float, list[float]]]:
        """Nodes that speak for a point, their weights, and the point about each of them."""
        nodes, weights = self.cells.near(u)
        places = [self._at(n, u) for n in nodes]
        if self.reach is None:
            return list(zip(nodes, weights, places, strict=True))
        shares = []
        for n, z in zip(nodes, places, strict=True):
            beyond = self.nodes[n][1] * math.sqrt(sum(v * v for v in z)) / self.reach[n] - 1.0
            shares.append(1.0 if beyond <= 0.0 else 0.0 if beyond >= 1.0 else (1 - beyond**2) ** 2)
        spoken = [w * share for w, share in zip(weights, shares, strict=True)]
        total = sum(spoken)
        if not total > 0.0:
            return []
        left = max(shares) / total
        loud = sum(w for n, w in zip(nodes, spoken, strict=True) if self.nodes[n][2]) / total
        left *= heard(loud, self.votes) if self.votes else 1.0
        found = [(n, w * left, z) for n, w, z in zip(nodes, spoken, places, strict=True)]
        if self.gates is None:
            return found
        return [(n, w * self._opening(n, z), z) for n, w, z in found]

    def _opening(self, n: int, z: list[float]) -> float:
        """How far a node's gate is open at a point about it, in its radius."""
        assert self.gates is not None  # noqa: S101
        *normal, t = self.gates[n]
        radius = self.nodes[n][1]
        for a, v in zip(normal, z, strict=True):
            t += a * v * radius
        t = min(max(t, 0.0), 1.0)
        return t * t * (3.0 - 2.0 * t)

    def _at(self, n: int, u: Sequence[float]) -> list[float]:
        """Coordinates of a point about a node, in its radius."""
        w, radius, _ = self.nodes[n]
        z = []
        for a, b, turns in zip(u, w, self.periodic, strict=True):
            gap = a - b
            if turns:
                gap -= round(gap)
            z.append(gap / radius)
        return z
