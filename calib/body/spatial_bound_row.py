"""The bound of one row of a spatial body, for a control loop: `Body.bound` without its overhead.

Most of a posterior are the curves, 96 parameters a joint, which enter a row through one number a
joint: how far the curve is off there.  So the covariance's root U (its own triangle, as it is
stored) meets each joint's harmonics once, and the geometry afterwards:

    U X' = U_g J_g' + sum_k (U_k w_k(q_k)) j_k'

with the derivatives J_g (3, g) of the geometry, j_k (3,) of joint k, its harmonics w_k (96,).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..arm.motion import placements
from ..common.arrays import Array
from .belief import SHARED, Body, Second
from .covariance import NORMAL_95
from .curves import HARMONICS, ORDERS
from .parameters import Indices
from .spatial import SpatialStructure
from .spatial_row import SpatialRow

_SIGNS = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _SIGNS[_a, _b, _c], _SIGNS[_a, _c, _b] = 1.0, -1.0
_TURNING = _SIGNS.reshape(3, 9)  # a @ _TURNING is the matrix whose product with v is v x a


class SpatialBoundRow:
    """Bounds on the position for single rows; joint values [rad or m] are not checked.

    body : in space, its view one that sees positions: no camera
    """

    def __init__(self, body: Body) -> None:
        structure = body.structure
        assert isinstance(structure, SpatialStructure) and structure.outputs == 3  # noqa: S101, PT018
        self._first = _Posterior(structure, body)
        self._second = None if body.second is None else _Posterior(structure, body.second)
        self._kappa, self._residual = body.kappa, (body.residual[:3] ** 2).tolist()
        self._noise = (body.noise[:3] ** 2).tolist()

    def bound(self, q: Sequence[float], *, noise: bool) -> float:
        """95 % bound [unit] at joint values (dof,), as `Body.bound`."""
        extra = self._residual
        if noise:
            extra = [a + b for a, b in zip(extra, self._noise, strict=True)]
        waves = np.multiply.outer(q, ORDERS)
        waves = np.concatenate([np.cos(waves), np.sin(waves)], axis=1)
        seen, spread = self._first.at(q, waves)
        out = self._kappa * _radius(spread * SHARED**2, extra)
        if self._second is not None:
            other, spread = self._second.at(q, waves)
            out = max(out, math.dist(seen, other) + _radius(spread, extra))
        return out


class _Posterior:
    """One Gaussian over the parameters of a structure."""

    def __init__(self, structure: SpatialStructure, belief: Body | Second) -> None:
        groups, chain, active = structure.groups, structure.chain, belief.active
        self._row = SpatialRow(structure, belief.beta)
        links = placements(chain, structure.deviations(belief.beta))
        self._strides, self._turned = links.strides[:, :, None], links.turns
        self._axes, self._coupling = chain.axes[:, :, None], chain.coupling
        self._turns, self._flange = np.array(chain.revolute)[:, None], chain.rotation
        sensor = structure.sensor(belief.beta)
        self._see, self._shift = sensor.scale * sensor.rotation, sensor.shift
        self._bends = bool(np.isin(groups["elastic"], active).any())
        curves = {k: np.isin(active, groups[f"curve.{k}"]) for k in range(structure.dof)}
        bare = ~np.any(list(curves.values()), axis=0)
        self._geometry, self._root = active[bare], _met(belief.root[bare])
        self._curves = [
            (k, _in_turn(active[own] - groups[f"curve.{k}"][0]), _met(belief.root[own]))
            for k, own in curves.items()
            if own.any()
        ]
        self._rank = belief.root.shape[1]

    def at(self, q: Sequence[float], waves: Array) -> tuple[Array, Array]:
        """Prediction (3,) and its covariance (3, 3) at joint values (dof,)."""
        geometry, joints, seen = self._derivatives(q)
        curves = np.zeros((len(q), self._rank))
        for k, orders, root in self._curves:
            np.dot(root, waves[k, orders], out=curves[k, : len(root)])
        met = joints @ curves
        met[:, : len(self._root)] += geometry[:, self._geometry] @ self._root.T
        return seen, met @ met.T

    def _derivatives(self, q: Sequence[float]) -> tuple[Array, Array, Array]:
        """Derivatives (3, g) by all but curves, (3, dof) by the joints; what is seen (3,).

        Columns are in the order of `SpatialLayout`; `spatial_slopes` has them for many rows.
        """
        places, rotations, tip = self._row.frames(q)
        m, see = len(places), self._see
        before = np.concatenate([np.eye(3)[None], rotations[:-1]])
        origins = (before @ self._strides)[..., 0]
        origins[1:] += places[:-1]
        after = before @ self._turned
        swing = ((tip - origins) @ _TURNING).reshape(m, 3, 3)
        axes = after @ self._axes
        chained = see @ np.where(self._turns, (swing @ axes)[..., 0], axes[..., 0]).T
        placement = np.concatenate([before, swing @ after], axis=2).transpose(1, 0, 2)
        own, point = chained @ self._coupling, see @ tip
        parts = [
            (point @ _TURNING).reshape(3, 3), np.eye(3), point[:, None], np.zeros((3, 4)),
            see @ rotations[-1] @ self._flange, np.zeros((3, 3)),
            see @ placement.reshape(3, -1), own, own * q,
        ]  # fmt: skip
        if self._bends:
            parts.append(chained * self._row.shares(q))
        return np.concatenate(parts, axis=1), own, point + self._shift


def _in_turn(orders: Indices) -> Indices | slice:
    """Indices, as a slice where they are all that there are: a view costs a fifth of a copy."""
    return slice(None) if len(orders) == 2 * HARMONICS else orders


def _met(rows: Array) -> Array:
    """Rows (k, r) of a root, transposed, without the columns that are zero at the end."""
    filled = np.flatnonzero(rows.any(axis=0))
    return np.ascontiguousarray(rows[:, : filled[-1] + 1 if len(filled) else 0].T)


def _radius(spread: Array, extra: list[float]) -> float:
    """`radius_95` of one covariance (3, 3) with more variance (3,) on its diagonal."""
    (a, b, c), (_, d, e), (_, _, f) = spread.tolist()
    a, d, f = a + extra[0], d + extra[1], f + extra[2]
    trace = a + d + f
    square = a * a + d * d + f * f + 2.0 * (b * b + c * c + e * e)
    share = 2.0 / 9.0 / max(trace * trace / max(square, 1e-300), 1e-300)
    return math.sqrt(max(trace, 0.0) * (1.0 - share + NORMAL_95 * math.sqrt(share)) ** 3)
