"""Measurements: what a sensor reads of a chain's tip, and the derivatives by both.

A view of a tip p is a matrix on p and one, and where that has a depth a lens: of a pinhole camera
as of a homography, whose picture is the plane.  Arrays have rows last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arm.rotations import exponential, logarithm
from ..arm.spatial_chain import ChainState, cross
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import PRIOR

TipMotion = tuple[Array, Array | None]
"""How the tip moves: velocity (..., 3, n) [m] and angular velocity (..., 3, n) [rad], or none."""

LEAST_DEPTH = 1e-3
"""A point nearer to the camera's plane than this [m] has no pixel; it is held there."""

_UNTURNED = np.eye(3)


# Kinds of sensors.


@dataclass(frozen=True)
class ViewKind:
    """A kind of sensor."""

    groups: tuple[str, ...] = ()  # groups of parameters that every member fits
    # 2 positions in a plane or pixels, 3 positions in space, 6 of a pose
    outputs: int = 2
    # fewest rows that place the sensor in front of an arm in space
    least: int = 2

    @property
    def has_scale(self) -> bool:
        """Whether it has its own scale."""
        return "view.scale" in self.groups


_FRAME = ("view.rotation", "view.shift")
_AFFINE = (*_FRAME, "view.scale", "view.shear")

PLANAR = {
    "base": ViewKind(),
    "rigid": ViewKind(_FRAME),
    "similarity": ViewKind((*_FRAME, "view.scale")),
    "affine": ViewKind(_AFFINE),
    "homography": ViewKind((*_AFFINE, "view.tilt")),
}
"""Sensors of a planar arm; users choose among :data:`calib.common.choices.VIEWS`."""

SPATIAL = {
    "base": ViewKind(("tool",), 3),
    "rigid": ViewKind((*_FRAME, "tool"), 3, 4),
    "similarity": ViewKind((*_FRAME, "tool", "view.scale"), 3, 4),
    # in the robot's root frame with the orientation of the drawing's tip, or of some target there
    "base pose": ViewKind(("tool", "tool.rotation"), 6, 3),
    "base target": ViewKind(("tool", "tool.rotation"), 6, 3),
    "pose": ViewKind((*_FRAME, "tool", "tool.rotation"), 6, 3),
    "pinhole": ViewKind((*_FRAME, "tool"), 2, 6),
}
"""Sensors of an arm in space; where there are two outputs, a camera sees it."""


def is_camera(view: str) -> bool:
    """Whether a view is that of a camera that sees an arm in space."""
    return view in SPATIAL and SPATIAL[view].outputs == 2


# The interface.


@dataclass(frozen=True, eq=False)
class Sight:
    """What a sensor sees at n rows, and how that moves with the tip."""

    values: Array  # (n, m)
    # derivative, of which many predictions make no use
    slope_at: Callable[[], Array]

    @cached_property
    def slope(self) -> Array:
        """Derivative (m, d) or (m, d, n) by the tip's d coordinates, and the turn that it reads."""
        return self.slope_at()

    def push(self, velocity: Array, angular: Array | None = None) -> Array:
        """How outputs (..., m, n) move when the tip moves (..., d, n) [m] and turns [rad]."""
        size = velocity.shape[-2]
        by_place = self.slope[:, :size]
        moved = _product(by_place, velocity)
        if angular is not None and self.slope.shape[1] > size:
            by_turn = self.slope[:, size:]
            moved = moved + _product(by_turn, angular)
        return moved


def _product(slope: Array, motions: Array) -> Array:
    """Products (..., m, n) of derivatives (m, d) or (m, d, n) and motions (..., d, n)."""
    if slope.ndim == 2:
        return slope @ motions
    products = slope * motions[..., None, :, :]
    total: Array = products.sum(axis=-2)
    return total


class ArmSize(NamedTuple):
    """The arm's size and the place of its drawing, for the priors of sensors."""

    reach: float  # [unit]
    unit: str  # of its lengths
    # of a planar drawing in its plane's frame [rad, unit]
    rotation: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)


class Measurement:
    """A kind of reading, with the sensor's own parameters."""

    outputs: int = 2  # numbers of a row, see `ViewKind`
    # times the drawing's doubt that joint origins may be off
    within: tuple[float, float] = PRIOR.wider
    # whether it leaves the place of the arm's base undetermined
    floating: bool = False
    noise: float | None = None  # sd of its outputs; None: it is fitted
    # blocks that every member of the gate fits, besides the view's own
    free: tuple[str, ...] = ()
    # what is known of the tool where there is a drawing
    tool: Hyper | None = None

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:  # noqa: ARG002
        """The sensor's own parameters."""
        return ()

    def look(
        self, blocks: Mapping[str, Array], state: ChainState, row_facts: Array
    ) -> Sight:
        """See the chain at n rows.

        blocks : all parameters, by block
        state : where the chain is
        row_facts : (n, g), further facts of a row: which point was touched, which corner was seen
        """
        raise NotImplementedError


# A sensor at its parameters.


@dataclass(frozen=True, eq=False)
class Projection:
    """A sensor: ``w = matrix (p, 1)`` of a point p; read as it is, or through a lens."""

    matrix: Array  # (w, d + 1), d coordinates of points
    # (4,), focal length, centre and k1 of what reads pixels
    lens: Array | None = None
    has_orientation: bool = False  # whether it reads orientations too
    rotation: Array = field(default_factory=lambda: _UNTURNED)
    scale: float = 1.0

    @property
    def shift(self) -> Array:
        """What it reads of the origin (w,)."""
        return self.matrix[:, -1]

    def tip_motions(self, position: Array) -> Mapping[str, TipMotion]:
        """Motions of a tip (3, n) [m] that look like each parameter of its place in space."""
        axes = np.broadcast_to(self.rotation[..., None], (3, *position.shape))
        return {
            "view.rotation": (cross(axes, position), axes),
            "view.shift": (axes / self.scale, None),
            "view.scale": (position[None], None),
        }

    def look(self, state: ChainState) -> Sight:
        """See the tip of a chain."""
        linear = self.matrix[:, :-1]
        point = linear @ state.position
        point += self.shift[:, None]
        if self.lens is not None:
            return pixels(self.lens, point, linear)
        if not self.has_orientation:
            values = np.ascontiguousarray(point.T)
            return Sight(values, lambda: linear)
        orientation = np.moveaxis(state.rotation, 2, 0)
        turn = logarithm(self.rotation @ orientation)
        values = np.concatenate([point.T, turn], axis=1)
        apart = np.zeros((3, 3))
        blocks = [[linear, apart], [apart, self.rotation]]
        return Sight(values, lambda: np.block(blocks))


def pixels(lens: Array, point: Array, linear: Array) -> Sight:
    """Pixels of points (3, n), no nearer than `LEAST_DEPTH`, through a lens (4,).

    linear : (3, d), how the points move with what the derivative is by
    """
    focal, *centre, radial = lens
    depth = np.maximum(point[2], LEAST_DEPTH)
    ideal = point[:2] / depth
    square = (ideal**2).sum(axis=0)
    bent = 1 + radial * square
    bent_ideal = focal * ideal * bent
    values = np.ascontiguousarray(bent_ideal.T)

    def slope() -> Array:
        # d pixel / d ideal = f ((1 + k1 r^2) 1 + 2 k1 u u'), d ideal / d point = [1, -u] / depth
        across = 2 * radial * ideal[:, None] * ideal
        across += bent * np.eye(2)[..., None]
        across *= focal / depth
        products = across * ideal
        ahead = -products.sum(axis=1)
        by_point = np.concatenate([across, ahead[:, None]], axis=1)
        return np.asarray(np.einsum("mwn,wd->mdn", by_point, linear))

    return Sight(values + centre, slope)


def lens_slope(lens: Array, point: Array) -> Array:
    """Derivative (4, 2, n) of pixels by focal length, centre and k1."""
    depth = np.maximum(point[2], LEAST_DEPTH)
    ideal = point[:2] / depth
    square = (ideal**2).sum(axis=0)
    slope = np.zeros((4, *ideal.shape))
    slope[0] = ideal * (1 + lens[3] * square)
    slope[1, 0] = 1.0
    slope[2, 1] = 1.0
    slope[3] = lens[0] * ideal * square
    return slope


def compose(first: Array, second: Array) -> Array:
    """Rotation vectors (..., 3) of exp(first) exp(second)."""
    rotation = exponential(first) @ exponential(second)
    return logarithm(rotation)
