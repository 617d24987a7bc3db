"""Linear models of maps and links: what the readout ``linear`` regresses.

At the border active nodes are on one side of a query, and the mean of their partners is the value
at their middle; a regression on the nodes' mean activity positions continues to the query.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, ReadOnly
from .blend import Blend, blend_size
from .map import Map
from .settings import READOUT


def regress(
    place: Array,
    value: Array,
    weight: Array,
) -> tuple[Array, Array, Array]:
    """Weighted ridge regressions of values on places, one for each row.

    place, value, weight : (n, k, d), (n, k, o), (n, k), nodes' places, their values, and how
        active they are; a row of zeros gives zeros
    Returns (n, d), (n, o), (n, d, o), means of the places and of the values, slope between them.
    """
    total = weight.sum(axis=1, keepdims=True)
    share = weight / np.where(total > 0.0, total, 1.0)
    middle = np.einsum("nk,nkd->nd", share, place)
    mean = np.einsum("nk,nko->no", share, value)
    gap = place - middle[:, None]
    shares = share[..., None]
    weighted = np.swapaxes(gap * shares, 1, 2)
    power = weighted @ gap
    diagonal = np.einsum("ndd->nd", power)
    variance = diagonal.mean(axis=1, keepdims=True)
    diagonal += READOUT.ridge * variance + 1e-300
    moments = weighted @ (value - mean[:, None])
    slope = np.linalg.solve(power, moments)
    return middle, mean, slope


@dataclass(frozen=True, eq=False)
class LinearModels(ReadOnly):
    """The forward direction of maps and links as a smooth function of the joints.

    It has the interface of :class:`~calib.maps.predictor.Smooth`, so that bounds and the search for
    branches run on it: there is no kinematic model behind it.
    """

    motor: Map  # the map whose nodes carry the models
    values: Array  # (nodes, o) [unit], position at each node
    # (nodes, d, o) [unit], its derivatives by the unit coordinates
    slopes: Array

    def value(self, u: Array) -> Array:
        """Positions (n, o) at the points `u` (n, d) of the unit box."""
        return self.value_and_slope(u)[0]

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Positions (n, o) and their derivatives by the unit coordinates (n, o, d)."""
        # sums of a point alone would be in another order than those of several
        points = np.concatenate([u, u[:1]])
        size = 2 * blend_size(u.shape[1])
        blend = Blend(self.motor, points, size)
        # points are last: each operation runs along them
        nodes = blend.index.T
        weight = blend.weight.T.copy()
        gap = blend.gap.T.copy()
        slopes = self.slopes.T.take(nodes, axis=2)
        of_nodes = self.values.T.take(nodes, axis=1)
        of_nodes += np.einsum("dmn,odmn->omn", gap, slopes)
        value = np.einsum("mn,omn->on", weight, of_nodes)
        slope = np.einsum("mn,odmn->odn", weight, slopes)
        slope += np.einsum("dmn,omn->odn", blend.tilt(), of_nodes)
        positions = value.T[:-1].copy()
        transposed = slope.T[:-1].copy()
        return positions, transposed.swapaxes(1, 2)

    @staticmethod
    def of(
        motor: Map,
        places: Array,
        partners: Array,
        strength: Array,
        active: tuple[Index, Array],
    ) -> LinearModels:
        """Regress the partners' values around each node.

        places : (nodes, d), mean activity position of each node, in the unit box
        partners, strength : (nodes, o), (nodes,), link-weighted mean of each node's partners [unit]
            and the sum of its links
        active : (nodes, k), (nodes, k), nodes around each node's own place, and their activities
            there (eq. 6)
        """
        near, activity = active
        weight = activity * strength[near]
        nodes = motor.units[:, None]
        place = motor.scale.difference(places[near], nodes)
        middle, mean, slope = regress(place, partners[near], weight)
        value = mean - np.einsum("nd,ndo->no", middle, slope)
        total = weight.sum(axis=1)
        has_links = (strength > 0.0) & (total > 0.0)
        # in place of a node without links the nearest model goes on
        source = motor.nearest_of(has_links)
        gap = motor.scale.difference(motor.units, motor.units[source])
        slope = slope[source]
        value = value[source] + np.einsum("nd,ndo->no", gap, slope)
        return LinearModels(motor, value, slope)
