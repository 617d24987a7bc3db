"""The one bound on a model's positions, for any arm; the C source reads the same numbers.

It is the sum of three: what is believed of the arm, how far joint values are beside the rows of a
log without a body, and what play leaves open where the side is not known from which joints came.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..kernel.posterior import CompactPosterior
from ..maps.map import Map
from ..maps.node_bounds import blend_nodes
from ..maps.predictor import Predictor
from .baseline import Seen

# joints up to which bounds are blended between the motor map's nodes
MOST_BLENDED = 3
STEEP = 2.0  # extents of the workspace that a position may change by over the range of a joint


@dataclass(frozen=True, eq=False)
class PositionBound:
    """95 % bounds on what a predictor answers, at points of the unit box of the joints."""

    predictor: Predictor
    body: Body | None
    posterior: (
        CompactPosterior | None
    )  # the body's, made small, of more than three joints
    play: Array | None  # (dof,) [rad or m], half the play of each joint
    rows: Seen | None  # where rows were, of a log without a body
    extent: float  # of the workspace [unit]
    widest: float  # [unit], with which a position is still an answer

    def at(
        self,
        u: Array,
        nodes: Array,
        *,
        noise: bool,
        side_known: Mask | None = None,
    ) -> Array:
        """95 % bound (n,) [unit] at points `u` (n, dof).

        nodes : (nodes,) [unit], bounds around the motor map's nodes
        noise : whether the noise of a single reading is part of it
        side_known : (n,), whether `u` is where the joints stand; by default it is where they read,
            and they may stand anywhere within their play
        """
        if u.shape[1] > MOST_BLENDED and self.body is not None:
            # a lattice covers too little of their box to blend between its nodes
            bound = self._believed(self.body, u, noise=noise)
        else:
            bound = self.blended(u, nodes, noise=noise)
        if self.play is None:
            return bound
        reach = self._play_reach(u, self.play)
        if side_known is not None:
            reach = np.where(side_known, 0.0, reach)
        return bound + reach

    def blended(self, u: Array, nodes: Array, *, noise: bool) -> Array:
        """Bounds (n,) at points `u` (n, dof), from those of the nodes (nodes,)."""
        bound = blend_nodes(self._motor, nodes, u)
        wide = bound > self.widest
        if self.body is not None and wide.any():
            # beside a joint that hardly moved the posterior widens within less than a node's
            # spacing: a blended bound would refuse the measured rows themselves
            q = self._motor.scale.from_unit(u[wide])
            bound[wide] = np.minimum(
                bound[wide], self.body.bound(q, noise=noise)
            )
        if self.rows is not None:
            bound = bound + STEEP * self.extent * self.rows.beside(
                self._motor.scale, u
            )
        return bound

    @property
    def _motor(self) -> Map:
        return self.predictor.motor

    def _believed(self, body: Body, u: Array, *, noise: bool) -> Array:
        q = self._motor.scale.from_unit(u)
        if self.posterior is not None:
            return self.posterior.bound(q, noise=noise)
        return body.bound(q, noise=noise)

    def _play_reach(self, u: Array, play: Array) -> Array:
        """How far the tip may be (n,) [unit] with all joints at the worst side of their play."""
        slope = self.predictor.value_and_slope(u)[1] / self._motor.scale.span
        return np.asarray(np.linalg.norm(slope * play, axis=1).sum(axis=1))
