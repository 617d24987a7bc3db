"""The baseline: what a model knows of an undisturbed arm where it learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Index, Shape
from ..common.frozen import ReadOnly
from ..maps.association import Association
from ..maps.map import Map, nearest_nodes, search_tree

# without a body the bound of a node holds within so many times the rms distance of its samples
KNOWN = 2.0

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
