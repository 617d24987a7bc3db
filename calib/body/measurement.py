"""Measurement: what a sensor tells of a chain, and how that depends on both.

Positions in a plane (`planar_view`), positions, poses and pixels in space (`spatial_view`), corners
and touches.  A new one is a class with these two faces.  Arrays have rows last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np

from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import WIDER

Moved = tuple[Array, Any]
"""How the tip moves: velocity (..., 3, n) [m] and angular velocity (..., 3, n) [rad], or 0."""

Columns = Iterator[tuple[str, Callable[[], Array]]]
"""Derivatives (k, m, n) by each of a sensor's own blocks."""


class Sight(Protocol):
    """What a sensor sees at n rows.

    Outputs (n, m), how they (..., m, n) move when the tip does, and their derivative (k, m, n) by
    each of the sensor's own blocks.
    """

    @property
    def values(self) -> Array: ...  # noqa: D102
    def push(self, velocity: Array, angular: Any = 0.0) -> Array: ...  # noqa: D102
    def columns(self) -> Columns: ...  # noqa: D102


class Measurement:
    """A kind of reading, with the sensor's own parameters."""

    blocks: tuple[int, ...]  # sizes of the outputs that share a unit and a noise
    curves: bool = True  # whether its rows may tell error curves of joints
    within: tuple[float, float] = WIDER  # times the drawing's doubt that joint origins may be off
    floating: bool = False  # whether it tells nothing of where the arm's base stands
    noise: float | None = None  # sd of its outputs where that is stated; None: it is learned
    free: tuple[str, ...] = ()  # blocks that every member of the gate fits beside the view's own
    tool: Hyper | None = None  # what is known of the tool where there is a drawing

    def parameters(self) -> tuple[Block, ...]:
        """The sensor's own parameters."""
        return ()

    def ready(self, own: Mapping[str, Array]) -> Mapping[str, Any]:  # noqa: ARG002
        """What follows from the sensor's own parameters alone, by further names for `look`."""
        return {}

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> Sight:
        """See a chain with the sensor's parameters, by block.

        also : (n, g), what else a row tells: which point was touched, which corner was seen
        """
        raise NotImplementedError

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs."""
        return np.asarray(z - predicted)
