"""Local models of the nodes for one query, in plain Python floats.

The counterpart of `local_models.predict` for a control loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ..body.basis import exponents
from .local_models import LocalModels
from .map import Map
from .node_cells import NodeCells

Term = tuple[tuple[int, ...], float, float]


@dataclass(frozen=True, eq=False)
class NodeModels:
    """Polynomials of the nodes.

    Attributes
    ----------
    cells : NodeCells
        Finds the nodes that speak for a point.
    nodes : list
        For each node its coordinates, radius and terms (exponents, x, y); only what is not zero.
    periodic : tuple of bool
        Axes whose ends meet.
    """

    cells: NodeCells
    nodes: list[tuple[list[float], float, list[Term]]] = field(repr=False)
    periodic: tuple[bool, ...]

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
        return NodeModels(cells, nodes, tuple(bool(p) for p in motor.scale.periodic))

    def value(self, u: Sequence[float]) -> tuple[float, float]:
        """Blended correction at a point of the unit box."""
        x = y = 0.0
        for n, weight in zip(*self.cells.near(u), strict=True):
            z, terms = self._at(n, u)
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
        for n, weight in zip(*self.cells.near(u), strict=True):
            z, terms = self._at(n, u)
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

    def _at(self, n: int, u: Sequence[float]) -> tuple[list[float], list[Term]]:
        """Coordinates of a point about a node, in its radius, and the node's terms."""
        w, radius, terms = self.nodes[n]
        z = []
        for a, b, turns in zip(u, w, self.periodic, strict=True):
            gap = a - b
            if turns:
                gap -= round(gap)
            z.append(gap / radius)
        return z, terms
