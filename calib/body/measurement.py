"""Measurement: what a sensor tells of a chain, and how that depends on both.

Positions in a plane (`planar_view`), positions, poses and pixels in space (`spatial_view`).  A new
one is a class with these two faces; the fit knows no others.  Arrays have rows last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np

from ..common.arrays import Array
from .parameters import Block
from .settings import SCALES

Moved = tuple[Array, Any]
"""How the tip moves: velocity (..., D, n) [m] and angular velocity (..., 3, n) [rad], or 0."""


class TipMotion(Protocol):
    """Where a chain is at n rows: its tip, and how that moves with each joint (m, D, n)."""

    def joints(self) -> Moved: ...  # noqa: D102


class Sight(Protocol):
    """What a sensor sees at n rows.

    Outputs (n, m), how they (..., m, n) move when the tip does, and their derivative (k, m, n) by
    each of the sensor's own blocks.
    """

    @property
    def values(self) -> Array: ...  # noqa: D102
    def push(self, velocity: Array, angular: Any = 0.0) -> Array: ...  # noqa: D102
    def columns(self) -> Iterator[tuple[str, Callable[[], Array]]]: ...  # noqa: D102


class Measurement:
    """A kind of reading, with the sensor's own parameters."""

    blocks: tuple[int, ...]  # sizes of the outputs that share a unit and a noise
    curves: bool = True  # whether its rows may tell error curves of joints
    scales: tuple[float, ...] = SCALES  # factors on the sd of joint origins that are compared

    @property
    def outputs(self) -> int:
        """Number m of outputs."""
        return sum(self.blocks)

    def parameters(self) -> tuple[Block, ...]:
        """The sensor's own parameters."""
        raise NotImplementedError

    def ready(self, own: Mapping[str, Array]) -> Any:
        """What `look` needs of the sensor's parameters, by block; it is kept for many rows."""
        return own

    def look(self, ready: Any, motion: Any, also: Array) -> Sight:
        """See a chain.

        also : (n, g), what else a row tells: which point was touched, which corner was seen
        """
        raise NotImplementedError

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs."""
        return np.asarray(z - predicted)

    def start(self, structure: Any, q: Array) -> Array:
        """Parameters (d,) of a structure to begin a fit of rows (n, dof + g) with."""
        raise NotImplementedError
