"""Positions in a plane as a sensor sees them: turned, scaled, sheared, shifted, tilted, bent.

Equation 6 of :mod:`calib.body.planar`::

    y = A p / (1 + h.p),  A = exp(s) R(alpha) [[1+a, b], [b, 1-a]] mirror
    u = (y + t - middle) / size - c,  z = y + t + size k |u|^2 u

The lens is radial with a free centre `c`; with ``k = 0`` it does nothing and its centre is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .measurement import Columns, Measurement
from .parameters import Block
from .settings import FREE

_LENS = 1.5  # extents at which the lens bends by its radial parameter
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class PlanarReading(Measurement):
    """Two coordinates in the plane of an arm."""

    unit: str  # unit of positions
    length: str  # unit of the chain's lengths
    mirror: int  # -1 where the sensor sees the plane from behind
    extent: float  # [unit]
    centre: tuple[float, float]  # [unit], origin of the lens
    reach: float  # of the chain, in its own unit
    rotation: float = 0.0  # prior means where the sensor's frame is known
    shift: tuple[float, float] = (0.0, 0.0)
    blocks = (2,)

    def parameters(self) -> tuple[Block, ...]:
        """What the sensor has of its own."""
        tilt = 1.0 / self.reach
        return (
            Block.of("view.rotation", "rad", ["view.rotation"], 100.0, self.rotation),
            Block.of("view.scale", "1", ["view.log scale"], 100.0),
            Block.of("view.shear", "1", ["view.stretch", "view.shear"], 1.0),
            Block.of(
                "view.shift", self.unit, ["view.shift x", "view.shift y"], FREE * self.extent,
                np.asarray(self.shift),
            ),
            Block.of("view.tilt", f"1/{self.length}", ["view.tilt x", "view.tilt y"], tilt),
            Block.of("lens", "1", ["lens.radial", "lens.centre x", "lens.centre y"], 0.5),
        )  # fmt: skip

    @property
    def size_of_lens(self) -> float:
        """Radius [unit] at which the lens bends by its radial parameter."""
        return _LENS * self.extent

    def ready(self, own: Mapping[str, Array]) -> Mapping[str, Any]:
        """The view's linear part."""
        return {"view": self.matrix(own)}

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> Seen:  # noqa: ARG002
        """See the tip."""
        x, depth, slope = motion.position, np.ones(1), own["view"][:, :, None]
        y = _times(slope, x)
        h = own["view.tilt"]
        if h.any():
            depth = 1 + h @ x
            y = y / depth
            slope = (slope - y[:, None] * h[:, None]) / depth
        seen, lens, k = y + own["view.shift"][:, None], None, own["lens"][0]
        if k:
            u, r2 = self.from_centre(seen, own["lens"])
            lens = (1 + k * r2) * np.eye(2)[:, :, None] + 2 * k * u[:, None] * u
            slope = np.swapaxes(_times(lens, np.swapaxes(slope, 0, 1)), 0, 1)
            seen = seen + self.size_of_lens * k * r2 * u
        return Seen(np.ascontiguousarray(seen.T), self, own, x, y, depth, slope, lens)

    def from_centre(self, seen: Array, lens: Array) -> tuple[Array, Array]:
        """Places (2, n) from the lens's centre, in its own size, and their squares (n,)."""
        u = (seen - np.reshape(self.centre, (2, 1))) / self.size_of_lens - lens[1:, None]
        return u, (u**2).sum(axis=0)

    def turned(self, own: Mapping[str, Array]) -> Array:
        """Rotation and scale (2, 2) of the view."""
        c, s = np.cos(own["view.rotation"][0]), np.sin(own["view.rotation"][0])
        return np.asarray(np.exp(own["view.scale"][0]) * np.array([[c, -s], [s, c]]))

    def matrix(self, own: Mapping[str, Array]) -> Array:
        """Linear part A (2, 2) of the view, with the mirror."""
        a, b = own["view.shear"]
        shear = np.array([[1 + a, b], [b, 1 - a]])
        return np.asarray(self.turned(own) @ shear @ np.diag([1.0, float(self.mirror)]))


@dataclass(frozen=True, eq=False)
class Seen:
    """What a sensor sees of the tip at n rows."""

    values: Array  # (n, 2)
    sensor: PlanarReading
    own: Mapping[str, Array]  # the sensor's parameters
    point: Array  # (2, n), the tip
    y: Array  # (2, n), seen before shift and lens
    depth: Array  # (n or 1)
    slope: Array  # (2, 2, n or 1), derivative by the tip
    lens: Array | None  # (2, 2, n), derivative of the lens, None where it does nothing

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:  # noqa: ARG002
        """How outputs (..., 2, n) move when the tip moves (..., 2, n)."""
        return _times(self.slope, velocity)

    def columns(self) -> Columns:
        """The derivative (k, 2, n) by each of the sensor's own blocks."""
        n = self.point.shape[1]
        yield "view.rotation", lambda: self._bent(_QUARTER_TURN @ self.y)
        yield "view.scale", lambda: self._bent(self.y)
        yield "view.shear", self._sheared
        yield "view.shift", lambda: self._bent(np.repeat(np.eye(2)[:, :, None], n, axis=2))
        yield "view.tilt", lambda: self._bent(-self.y * (self.point / self.depth)[:, None])
        yield "lens", self._refocused

    def _bent(self, moved: Array) -> Array:
        return moved if self.lens is None else _times(self.lens, moved)

    def _sheared(self) -> Array:
        x = self.point * np.array([[1.0], [float(self.sensor.mirror)]])
        stretched = np.stack([x * np.array([[1.0], [-1.0]]), x[::-1]])
        return self._bent(self.sensor.turned(self.own) @ stretched / self.depth)

    def _refocused(self) -> Array:
        seen = self.y + self.own["view.shift"][:, None]
        u, r2 = self.sensor.from_centre(seen, self.own["lens"])
        # without a bend its centre is nowhere
        grown = 0.0 * u[:, None] * u if self.lens is None else self.lens - np.eye(2)[:, :, None]
        return self.sensor.size_of_lens * np.concatenate([(u * r2)[None], -grown])


def _times(matrix: Array, vector: Array) -> Array:
    """Products (..., 2, n) of matrices (2, 2, n or 1) with vectors (..., 2, n)."""
    out = np.empty(np.broadcast_shapes(vector.shape, (*vector.shape[:-1], matrix.shape[-1])))
    for i in range(2):
        out[..., i, :] = matrix[i, 0] * vector[..., 0, :] + matrix[i, 1] * vector[..., 1, :]
    return out
