"""Measurements: what a sensor tells of a chain's tip, and how that depends on both.

A view of a tip p is a matrix on p and one, and where that has a depth a lens: of a pinhole camera
as of a homography, whose picture is the plane.  Arrays have rows last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from ..arm.rotations import exponential, logarithm
from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import PRIOR

Angular = Array | float
"""Angular velocity (..., 3, n) [rad], or 0 where nothing turns."""

Moved = tuple[Array, Angular]
"""How the tip moves: velocity (..., 3, n) [m] and angular velocity (..., 3, n) [rad], or 0."""

LEAST_DEPTH = 1e-3
"""A point nearer to the camera's plane than this [m] has no pixel; it is held there."""


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
    def scaled(self) -> bool:
        """Whether it has a scale of its own."""
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


class Sight(Protocol):
    """What a sensor sees at n rows.

    Outputs (n, m), and how they (..., m, n) move when the tip does.
    """

    @property
    def values(self) -> Array: ...  # noqa: D102
    def push(self, velocity: Array, angular: Angular = 0.0) -> Array: ...  # noqa: D102


class ArmSize(NamedTuple):
    """What the prior of a sensor rests on: how large the arm is, and where its drawing stands."""

    reach: float  # [unit]
    unit: str  # of its lengths
    # of a planar drawing in its plane's frame [rad, unit]
    rotation: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)


class Scene(NamedTuple):
    """What n rows show a measurement."""

    blocks: Mapping[str, Array]  # all parameters, by block
    placed: Placed  # the structure's sensor at them
    motion: Motion  # where the chain is
    # (n, g), what else a row tells: which point was touched, which corner was seen
    also: Array


class Measurement:
    """A kind of reading, with the sensor's own parameters."""

    outputs: int = 2  # numbers of a row, see `ViewKind`
    curves: bool = True  # whether its rows may tell error curves of joints
    # times the drawing's doubt that joint origins may be off
    within: tuple[float, float] = PRIOR.wider
    # whether it tells nothing of where the arm's base stands
    floating: bool = False
    noise: float | None = None  # sd of its outputs; None: the rows tell it
    # blocks that every member of the gate fits beside the view's own
    free: tuple[str, ...] = ()
    # what is known of the tool where there is a drawing
    tool: Hyper | None = None

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:  # noqa: ARG002
        """Return the sensor's own parameters."""
        return ()

    def look(self, scene: Scene) -> Sight:
        """See the chain."""
        raise NotImplementedError


# A sensor at its parameters, and what it sees.


@dataclass(frozen=True, eq=False)
class Placed:
    """A sensor: ``w = matrix (p, 1)`` of a point p; read as it is, or through a lens."""

    matrix: Array  # (w, d + 1), d coordinates of points
    # (4,), focal length, centre and k1 of what reads pixels
    lens: Array | None = None
    posed: bool = False  # whether it reads orientations too
    rotation: Array = field(default_factory=lambda: np.eye(3))
    scale: float = 1.0

    @property
    def shift(self) -> Array:
        """What it reads of the origin (w,)."""
        return self.matrix[:, -1]

    def look(self, position: Array, rotation: Array | None = None) -> View:
        """See the tip at `position` (d, n) with orientation `rotation` (3, 3, n)."""
        w = self.matrix[:, :-1] @ position + self.shift[:, None]
        if self.lens is not None:
            picture = pixels(self.lens, w)
            return View(picture.values, self, picture)
        if not self.posed:
            return View(np.ascontiguousarray(w.T), self)
        turn = logarithm(
            self.rotation @ np.moveaxis(np.asarray(rotation), 2, 0)
        )
        return View(np.concatenate([w.T, turn], axis=1), self)


@dataclass(frozen=True, eq=False)
class View:
    """What a sensor sees of the tip at n rows."""

    values: Array  # (n, m)
    sensor: Placed
    picture: Picture | None = None

    def push(self, velocity: Array, angular: Angular = 0.0) -> Array:
        """How outputs (..., m, n) move when the tip moves (..., d, n) [m] and turns [rad]."""
        moved = self.sensor.matrix[:, :-1] @ velocity
        if self.picture is not None:
            return self.picture.seen(moved)
        if not self.sensor.posed:
            return moved
        turned: Array | float = 0.0
        if isinstance(angular, np.ndarray):
            turned = self.sensor.rotation @ angular
        return np.concatenate(
            [moved, np.broadcast_to(turned, moved.shape)], axis=-2
        )


@dataclass(frozen=True, eq=False)
class Picture:
    """Points of a camera's frame, seen through a lens."""

    lens: Array  # (4,), focal length, centre and k1
    point: Array  # (3, n), no nearer than `LEAST_DEPTH`
    ideal: Array  # (2, n), seen through a pinhole
    bent: Array  # (n,), by how much the lens moves that away from the centre

    @property
    def values(self) -> Array:
        """Pixels (n, 2)."""
        return (
            np.ascontiguousarray((self.lens[0] * self.ideal * self.bent).T)
            + self.lens[1:3]
        )

    @cached_property
    def slope(self) -> Array:
        """Derivative (2, 3, n) by the point."""
        # d pixel / d ideal = f ((1 + k1 r^2) 1 + 2 k1 u u'), d ideal / d point = [1, -u] / depth
        focal = self.lens[0]
        radial = self.lens[3]
        across = 2 * radial * self.ideal[:, None] * self.ideal
        slope = np.empty((2, *self.point.shape))
        slope[:, :2] = (
            focal / self.point[2] * (across + self.bent * np.eye(2)[..., None])
        )
        slope[:, 2] = -(slope[:, :2] * self.ideal).sum(axis=1)
        return slope

    def seen(self, moved: Array) -> Array:
        """How pixels (..., 2, n) move when points move (..., 3, n)."""
        return np.asarray((self.slope * moved[..., None, :, :]).sum(axis=-2))

    def refocused(self) -> Array:
        """Derivative (4, 2, n) by focal length, centre and k1."""
        slope = np.zeros((4, *self.ideal.shape))
        slope[0] = self.ideal * self.bent
        slope[1, 0] = 1.0
        slope[2, 1] = 1.0
        slope[3] = self.lens[0] * self.ideal * (self.ideal**2).sum(axis=0)
        return slope


def pixels(lens: Array, point: Array) -> Picture:
    """Pixels of points (3, n) through a lens (4,)."""
    point = np.stack([point[0], point[1], np.maximum(point[2], LEAST_DEPTH)])
    ideal = point[:2] / point[2]
    bent = 1 + lens[3] * (ideal**2).sum(axis=0)
    return Picture(np.asarray(lens), point, ideal, bent)


def compose(first: Array, second: Array) -> Array:
    """Rotation vectors (..., 3) of exp(first) exp(second)."""
    return np.asarray(logarithm(exponential(first) @ exponential(second)))
