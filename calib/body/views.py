"""Measurements: what a sensor tells of a chain's tip, and how that depends on both.

A view of a tip p is a matrix on p and one, and where that has a depth a lens: of a pinhole camera
as of a homography, whose picture is the plane.  Arrays have rows last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..arm.rotations import cross_matrix, exponential, logarithm
from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import FREE, TAG, WIDER

Moved = tuple[Array, Any]
"""How the tip moves: velocity (..., 3, n) [m] and angular velocity (..., 3, n) [rad], or 0."""

Columns = Iterator[tuple[str, Callable[[], Array]]]
"""Derivatives (k, m, n) by each of a sensor's own blocks."""

LEAST_DEPTH = 1e-3
"""A point nearer to the camera's plane than this [m] has no pixel; it is held there."""

_LENS = 1.5  # extents at which a planar arm's lens bends by its radial parameter
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


# Kinds of sensors.


@dataclass(frozen=True)
class ViewKind:
    """A kind of sensor."""

    groups: tuple[str, ...] = ()  # groups of parameters that every member fits
    outputs: int = (
        2  # 2 positions in a plane or pixels, 3 positions in space, 6 of a pose
    )
    least: int = 2  # fewest rows that place the sensor in front of an arm in space

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

    Outputs (n, m), how they (..., m, n) move when the tip does, and their derivative (k, m, n) by
    each of the sensor's own blocks.
    """

    @property
    def values(self) -> Array: ...  # noqa: D102
    def push(self, velocity: Array, angular: Any = 0.0) -> Array: ...  # noqa: D102
    def columns(self) -> Columns: ...  # noqa: D102


class Measurement:
    """A kind of reading, with the sensor's own parameters."""

    outputs: int = (
        2  # numbers of a row: 2 in the plane or pixels, 3 in space, 6 with orientation
    )
    curves: bool = True  # whether its rows may tell error curves of joints
    within: tuple[float, float] = (
        WIDER  # times the drawing's doubt that joint origins may be off
    )
    floating: bool = False  # whether it tells nothing of where the arm's base stands
    noise: float | None = (
        None  # sd of its outputs where that is stated; None: it is learned
    )
    free: tuple[
        str, ...
    ] = ()  # blocks that every member of the gate fits beside the view's own
    tool: Hyper | None = None  # what is known of the tool where there is a drawing

    def parameters(self) -> tuple[Block, ...]:
        """The sensor's own parameters."""
        return ()

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The sensor at its parameters, by block."""
        raise NotImplementedError

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> Sight:  # noqa: ARG002
        """See a chain with the parameters, by block; ``"placed"`` is the sensor at them.

        also : (n, g), what else a row tells: which point was touched, which corner was seen
        """
        placed: Placed = own["placed"]
        return placed.look(motion.position, motion.rotation if placed.posed else None)


# A sensor at its parameters, and what it sees.


class By(NamedTuple):
    """How a sensor's matrix, orientation and lens depend on k parameters."""

    matrix: Array  # (k, w, d + 1)
    turn: Array | None = None  # (k, 3) [rad]
    lens: Array | None = None  # (k, 4)


@dataclass(frozen=True, eq=False)
class Placed:
    """A sensor: ``w = matrix (p, 1)`` of a point p; read as it is, or through a lens."""

    matrix: Array  # (w, d + 1), d coordinates of points
    lens: Array | None = None  # (4,), focal length, centre and k1 of what reads pixels
    by: Mapping[str, Callable[[], By]] = field(default_factory=dict)  # its own blocks
    posed: bool = False  # whether it reads orientations too
    rotation: Array = field(default_factory=lambda: np.eye(3))
    scale: float = 1.0
    # the same through a lens: what `by` is of, where it is read without
    whole: Placed | None = None

    @property
    def shift(self) -> Array:
        """What it reads of the origin (w,)."""
        return self.matrix[:, -1]

    def look(self, position: Array, rotation: Array | None = None) -> View:
        """See the tip at `position` (d, n) with orientation `rotation` (3, 3, n)."""
        w = self.matrix[:, :-1] @ position + self.shift[:, None]
        if self.lens is not None:
            picture = pixels(self.lens, w)
            return View(picture.values, self, position, picture)
        if not self.posed:
            return View(np.ascontiguousarray(w.T), self, position)
        turn = logarithm(self.rotation @ np.moveaxis(np.asarray(rotation), 2, 0))
        return View(np.concatenate([w.T, turn], axis=1), self, position)


@dataclass(frozen=True, eq=False)
class View:
    """What a sensor sees of the tip at n rows."""

    values: Array  # (n, m)
    sensor: Placed
    tip: Array  # (d, n)
    picture: Picture | None = None

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:
        """How outputs (..., m, n) move when the tip moves (..., d, n) [m] and turns [rad]."""
        sensor = self.sensor
        turned: Array | float = 0.0
        if sensor.posed and np.ndim(angular):
            turned = sensor.rotation @ angular
        return self._seen(sensor.matrix[:, :-1] @ velocity, turned)

    def columns(self) -> Columns:
        """The derivative (k, m, n) by each of the sensor's own blocks."""
        for name in self.sensor.by:
            yield name, partial(self._by, name)

    @cached_property
    def _whole(self) -> View:
        return self.sensor.whole.look(self.tip) if self.sensor.whole else self

    def _by(self, name: str) -> Array:
        view = self._whole
        by = view.sensor.by[name]()
        moved = by.matrix[..., :-1] @ self.tip + by.matrix[..., -1:]
        turned = 0.0 if by.turn is None else by.turn[..., None]
        columns = view._seen(moved, turned)
        if by.lens is not None and view.picture is not None:
            columns = columns + np.tensordot(by.lens, view.picture.refocused(), axes=1)
        return columns

    def _seen(self, moved: Array, turned: Array | float) -> Array:
        if self.picture is not None:
            return self.picture.seen(moved)
        if self.sensor.posed:
            return np.concatenate(
                [moved, np.broadcast_to(turned, moved.shape)], axis=-2
            )
        return moved


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


@dataclass(frozen=True, eq=False)
class InSpace(Measurement):
    """Positions, poses or pixels of an arm in space."""

    kind: str  # one of :data:`SPATIAL`
    unit: str  # unit of positions
    metre: float  # units of positions in one metre; not used by a camera
    size: float  # of the workspace [unit]; a camera's that of the arm [m]
    lens: tuple[
        float, float, float, float
    ]  # of a camera: focal length, centre [px] and k1
    lens_sd: tuple[float, float, float, float]

    @property
    def outputs(self) -> int:  # type: ignore[override]
        """Numbers of a row."""
        return SPATIAL[self.kind].outputs

    @property
    def tool(self) -> Hyper | None:  # type: ignore[override]
        """What is known of the tool: a camera's tag is near the tip."""
        return Hyper("tool", TAG, WIDER) if self.camera else None

    @property
    def camera(self) -> bool:
        """Whether it sees pixels."""
        return is_camera(self.kind)

    def parameters(self) -> tuple[Block, ...]:
        """What the sensor has of its own."""
        unit = "m" if self.camera else self.unit  # a camera stands metres away
        turns = [f"view.rotation.{axis}" for axis in "xyz"]
        shifts = [f"view.shift.{axis}" for axis in "xyz"]
        lens = (
            (None, "lens.focal", "px"),
            (None, "lens.centre.u", "px"),
            (None, "lens.centre.v", "px"),
            (None, "lens.k1", "1"),
        )
        return (
            Block.of("view.rotation", "rad", turns, 100.0),
            Block.of("view.shift", unit, shifts, FREE * self.size),
            Block.of("view.scale", "1", ["view.scale"], 100.0),
            Block("lens", lens, np.asarray(self.lens), np.asarray(self.lens_sd)),
        )

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The sensor: where it stands, its scale and its lens."""
        scale = float(np.exp(own["view.scale"][0]))
        if not self.camera:
            scale *= self.metre
        eye = np.eye(3)
        turn = exponential(own["view.rotation"])
        arm = np.hstack([scale * turn, np.zeros((3, 1))])
        by = {
            "view.rotation": lambda: By(cross_matrix(eye) @ arm, eye),
            "view.shift": lambda: By(eye[:, :, None] * np.eye(4)[3]),
            "view.scale": lambda: By(arm[None]),
        }
        lens: Array | None = None
        if self.camera:
            lens = own["lens"]
            by["lens"] = lambda: By(np.zeros((4, 3, 4)), lens=np.eye(4))
        return Placed(
            matrix=np.column_stack([arm[:, :3], own["view.shift"]]),
            lens=lens,
            by=by,
            posed=self.outputs == 6,
            rotation=turn,
            scale=scale,
        )


@dataclass(frozen=True, eq=False)
class InPlane(Measurement):
    """Two coordinates in the plane of an arm: turned, scaled, sheared, shifted, tilted, bent.

    With u in extents from a lens's free centre; with k = 0 the lens does nothing::

        y = A p / (1 + h.p) + t,  A = metre exp(s) R(alpha) [[1+a, b], [b, 1-a]] mirror
        z = y + size k |u|^2 u,   u = (y - middle) / size - c
    """

    unit: str  # unit of positions
    metre: float  # units of positions in one of the chain's
    mirror: int  # -1 where the sensor sees the plane from behind
    extent: float  # [unit]
    centre: tuple[float, float]  # [unit], origin of the lens
    length: str  # unit of the chain's lengths
    tilt: float  # prior sd [1/length]
    rotation: float  # prior means of the sensor's frame, that of its shift [length]
    shift: tuple[float, float]

    def parameters(self) -> tuple[Block, ...]:
        """What the sensor has of its own."""
        shifts = ["view.shift x", "view.shift y"]
        tilts = ["view.tilt x", "view.tilt y"]
        lens = ["lens.radial", "lens.centre x", "lens.centre y"]
        place = self.metre * np.asarray(self.shift)
        return (
            Block.of("view.rotation", "rad", ["view.rotation"], 100.0, self.rotation),
            Block.of("view.scale", "1", ["view.log scale"], 100.0),
            Block.of("view.shear", "1", ["view.stretch", "view.shear"], 1.0),
            Block.of("view.shift", self.unit, shifts, FREE * self.extent, place),
            Block.of("view.tilt", f"1/{self.length}", tilts, self.tilt),
            Block.of("lens", "1", lens, 0.5),
        )

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The sensor: the plane as a picture, or without tilt and bend positions as they are."""
        size = _LENS * self.extent
        eye = np.eye(3)
        radial = own["lens"][0]
        middle = self.centre + size * own["lens"][1:]
        shift = own["view.shift"]
        angle = own["view.rotation"][0]
        turn = np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        turned = self.metre * np.exp(own["view.scale"][0]) * turn
        stretch, shear = own["view.shear"]
        sides = np.array([[1 + stretch, shear], [shear, 1 - stretch]])
        flip = np.diag([1.0, self.mirror])
        linear = turned @ sides @ flip
        by_shear = (
            np.array([[[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]]) @ flip
        )
        # the matrix is A / size and the product of (t - middle, size) / size with (h, 1)
        start = np.append((shift - middle) / size, 1.0)
        tilt = np.append(own["view.tilt"], 1.0)
        across = eye[:2, :, None] * tilt
        # without a bend its centre is nowhere
        by_lens = np.concatenate([np.zeros((1, 3, 3)), -across])
        lens_order = np.diag([1.0, size, size]) @ np.eye(4)[[3, 1, 2]]
        by = {
            "view.rotation": lambda: By(_corner(_QUARTER_TURN @ linear[None]) / size),
            "view.scale": lambda: By(_corner(linear[None]) / size),
            "view.shear": lambda: By(_corner(turned @ by_shear) / size),
            "view.shift": lambda: By(across / size),
            "view.tilt": lambda: By(start[:, None] * eye[:2, None]),
            "lens": lambda: By(by_lens, lens=lens_order),
        }
        picture = _corner(linear) / size + np.outer(start, tilt)
        whole = Placed(picture, np.array([size, *middle, radial]), by)
        if radial or own["view.tilt"].any():
            return whole
        return Placed(np.column_stack([linear, shift]), None, by, whole=whole)


def _corner(linear: Array) -> Array:
    """Matrices (..., 3, 3) of those (..., 2, 2) in their corner."""
    out = np.zeros((*linear.shape[:-2], 3, 3))
    out[..., :2, :2] = linear
    return out
