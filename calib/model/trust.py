"""Trust: where a model answers, within the joints' range and where its bound means something."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..maps.map import Map, search_tree
from ..maps.node_bounds import blend_nodes
from .baseline import Paths

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from ..body.belief import Body

MOST_SHARE = 0.1
"""Share of the reach: where the bound on the position exceeds it, there is no answer."""

MOST_BLENDED = 3
"""Joints up to which bounds are blended between the motor map's nodes."""

STEEP = 2.0
"""Extents of the workspace that a position may change by over the range of a joint."""

ROUNDED = 1e-5
"""Share of a joint's range by which values beyond it are answered: 0.06 mrad of a full turn.

An encoder at its stop reads a hair beyond the limit; a body and its bound hardly change there.
"""


@dataclass(frozen=True, eq=False)
class Trust:
    """Where answers are given."""

    motor: Map  # motor map
    bounds: Array  # (nodes,) [unit], 95 % bound on the position around each node
    most: float  # [unit], largest bound with which a position is still an answer
    # (nodes,), how far from each node its bound holds, in the unit box, negative where it holds
    # nowhere; the bound of a point further away from all of them grows.  Without it a bound holds
    # wherever its node is among the nearest, as that of a body does.
    known: Array | None = None
    growth: float = 0.0  # [unit], what the position may change by over the unit box
    paths: Paths | None = None  # beside these bounds grow at once
    body: Body | None = None  # its posterior is asked where the nodes' bounds give no answer

    def in_range(self, u: Array) -> NDArray[np.bool_]:
        """Which coordinates (n, dof) of the unit box are within the joints' range."""
        inside = (u >= -ROUNDED) & (u <= 1.0 + ROUNDED)
        return np.asarray(inside | self.motor.scale.periodic)

    def covers(self, u: Array) -> NDArray[np.bool_]:
        """Whether points of the unit box (n, dof) are answered, (n,)."""
        known = np.asarray(self.in_range(u).all(axis=1))
        if not self.everywhere and known.any():
            known[known] = self.bound(self.bounds, u[known]) <= self.most
        return known

    def outside(self, q: Array, names: tuple[str, ...]) -> str | None:
        """Why joint values (1, dof) [rad or m] are not answered, None if they are."""
        scale = self.motor.scale
        u = scale.to_unit(q)
        if bool(self.covers(u)[0]):
            return None
        lower, upper = scale.lower, scale.lower + scale.span
        for k, name in enumerate(names):
            if not self.in_range(u)[0, k]:
                return (
                    f"{name} = {q[0, k]:.6g} is outside of the learned range "
                    f"{lower[k]:.6g} to {upper[k]:.6g}"
                )
        return (
            "no row was measured near these joint values: the position may be off by more than "
            f"{MOST_SHARE:.0%} of the reach"
        )

    def bound(self, bounds: Array, u: Array, *, noise: bool = False) -> Array:
        """Bounds (n,) at points of the unit box (n, dof), from those of the nodes (nodes,).

        `noise` says whether they count the noise of a single reading.
        """
        blended = blend_nodes(self.motor, bounds, u)
        wide = blended > self.most
        if self.body is not None and wide.any():
            # Beside a joint that hardly moved the posterior widens within less than a node's
            # spacing: a blended bound would refuse the measured rows themselves.  What held-out
            # rows added at the nodes to the posterior is added here in the same proportion.
            scale, known = self.motor.scale, np.clip(self.motor.units, 0.0, 1.0)
            own = self.body.bound(scale.from_unit(known), noise=noise)
            more = np.maximum(bounds / np.maximum(own, np.finfo(float).tiny), 1.0)
            there = self.body.bound(scale.from_unit(u[wide]), noise=noise)
            there = there * blend_nodes(self.motor, more, u[wide])
            blended[wide] = np.minimum(blended[wide], there)
        if self.known is None:
            return blended
        holding = np.flatnonzero(self.known >= 0.0)
        distance, nearest = self._tree.query(self.motor.scale.wrapped(u), k=1)
        node = holding[nearest]
        away = np.maximum(distance - self.known[node], 0.0)
        if self.paths is not None:
            gap = self.motor.scale.difference(u, self.motor.units[node])
            away = np.maximum(away, self.paths.beside(node, gap))
        return np.asarray(blended + self.growth * away)

    @cached_property
    def _tree(self) -> cKDTree:
        """Nodes whose bound holds somewhere."""
        assert self.known is not None  # noqa: S101
        return search_tree(self.motor.units[self.known >= 0.0], self.motor.scale)

    @cached_property
    def everywhere(self) -> bool:
        """Whether there is an answer wherever joints are within their range."""
        return self.known is None and bool((self.bounds <= self.most).all())
