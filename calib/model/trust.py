"""Trust: where a model answers, and what it knows of an undisturbed arm where it learned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Index, Shape
from ..common.frozen import ReadOnly
from ..maps.association import Association
from ..maps.map import Map, nearest_nodes, search_tree
from ..maps.node_bounds import blend_nodes

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

KNOWN = 2.0
"""Without a body the bound of a node that samples have visited holds within so many times
the root mean square distance of its samples."""

_PRIOR = 4.0  # samples that the mean of all nodes counts for at each node
_PLACES = 5  # least places around a node, for each joint: fewer are on a line by chance

# of the radius of a node's places, their sd along a direction in which they tell no slope: babbled
# ones have 0.26 to 0.5, those of 60 rows along a circle 0.08
_THIN = 0.1


@dataclass(frozen=True, eq=False)
class Paths(ReadOnly):
    """What is beside the rows of a node: along a path these tell the slope along it alone."""

    # (nodes, dof, dof), projections on the directions beside the path, zero where rows are all over
    across: Annotated[Array, Shape("nodes", "dof", "dof", kept="f4")]
    width: Annotated[Array, Shape("nodes", kept="f4")]  # of the path there, in the unit box

    def beside(self, node: Index, gap: Array) -> Array:
        """How far beside their paths points are, (n,), that lie `gap` (n, dof) from nodes (n,)."""
        away = np.linalg.norm(np.einsum("nij,nj->ni", self.across[node], gap), axis=1)
        return np.asarray(away - self.width[node])

    @staticmethod
    def of(motor: Map, squares: Array, u: Array) -> Paths | None:
        """Those of rows `u` (n, dof), None where they are all over.

        squares : (nodes,), expected squared distance of a row to its winner
        """
        scale, dof = motor.scale, u.shape[1]
        places = np.unique(np.round(scale.wrapped(u), 3), axis=0)  # an arm at rest is at one
        tree, nodes = search_tree(places, scale), scale.wrapped(motor.units)
        least = nearest_nodes(tree, nodes, min(_PLACES * dof, len(places)))[0][:, -1]
        radius = np.maximum(KNOWN * np.sqrt(squares), least)
        across, width = np.zeros((motor.size, dof, dof)), np.zeros(motor.size)
        for node, near in enumerate(tree.query_ball_point(nodes, radius * (1.0 + 1e-9))):
            gap = scale.difference(places[near], nodes[node])
            variance, axes = np.linalg.eigh(np.cov(gap.T, bias=True).reshape(dof, dof))
            thin = variance < (_THIN * radius[node]) ** 2
            across[node] = axes[:, thin] @ axes[:, thin].T
            width[node] = KNOWN * np.sqrt(np.maximum(variance[thin], 0.0).sum())
        return Paths(_as_kept(across), _as_kept(width)) if across.any() else None


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
        blended, scale = blend_nodes(self.motor, bounds, u), self.motor.scale
        wide = blended > self.most
        if self.body is not None and wide.any():
            # beside a joint that hardly moved the posterior widens within less than a node's
            # spacing: a blended bound would refuse the measured rows themselves
            there = self.body.bound(scale.from_unit(u[wide]), noise=noise)
            blended[wide] = np.minimum(blended[wide], there)
        if self.known is None:
            return blended
        holding = np.flatnonzero(self.known >= 0.0)
        distance, nearest = self._tree.query(scale.wrapped(u), k=1)
        node = holding[nearest]
        away = np.maximum(distance - self.known[node], 0.0)
        if self.paths is not None:
            gap = scale.difference(u, self.motor.units[node])
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


@dataclass(frozen=True, eq=False)
class Baseline(ReadOnly):
    """Distortions of samples that training never saw, stored with a model."""

    # (nodes,), expected squared distance of a sample to its winner, per winner, in the unit box
    motor: Annotated[Array, Shape("nodes", kept="f4")]
    sensory: Annotated[Array, Shape("places", kept="f4")]
    # variance of squared distance over expected one, in the motor and sensory map
    spread: tuple[float, float]
    # [unit], standard deviation per axis of measured less predicted position in training
    noise: float
    # of a log without a body, where its rows are along paths
    paths: Paths | None = None


def learn_baseline(association: Association, u: Array, x: Array, errors: Array) -> Baseline:
    """Learn what to expect from samples that training never saw.

    They are joints `u` (n, dof) in the unit box and positions `x` (n, m); `errors` (m,) [unit] are
    the distances from measured to predicted positions of the samples of training.
    """
    motor, first = _expected(association.motor, u)
    sensory, second = _expected(association.sensory, association.sensory.scale.to_unit(x))
    # the median of a Rayleigh distribution: a few wrong detections do not count
    noise = float(np.median(errors)) / np.sqrt(2.0 * np.log(2.0))
    return Baseline(motor, sensory, (first, second), float(noise))


def _expected(network: Map, points: Array) -> tuple[Array, float]:
    distance, winner = (part[:, 0] for part in network.nearest(points))
    square = distance**2
    count = np.bincount(winner, minlength=network.size)
    total = np.bincount(winner, square, minlength=network.size)
    # of unvisited nodes and of few samples: the mean of all, or the least that is not zero
    mean = max(float(square.mean()), 1e-24)
    expected = (total + _PRIOR * mean) / (count + _PRIOR)
    expected = _as_kept(expected)
    return expected, float(np.var(square / expected[winner]))


def _as_kept(values: Array) -> Array:
    """Values as a model file keeps them."""
    return values.astype(np.float32).astype(float)
