"""Readings of an arm in space: positions, poses and pixels of its tip.

``base``, ``rigid`` and ``similarity`` see a position, ``pose`` a position and an orientation,
``pinhole`` pixels. A view is evaluated at rows; `View.push` differentiates it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm
from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .measurement import Columns, Measurement
from .parameters import Block, Hyper
from .settings import FREE
from .views import SPATIAL

#: A point nearer to the camera's plane than this [m] has no pixel; it is held there.
LEAST_DEPTH = 1e-3


@dataclass(frozen=True)
class Placed:
    """A sensor: its rotation, shift, scale and, of a camera, its lens (f, u0, v0, k1)."""

    kind: str
    rotation: Array
    shift: Array
    scale: float
    lens: Array


@dataclass(frozen=True, eq=False)
class InSpace(Measurement):
    """Positions, poses or pixels of the tip in the frame of a sensor."""

    kind: str  # one of :data:`calib.body.views.SPATIAL`
    unit: str  # unit of positions
    metre: float  # units of positions in one metre; not used by a camera
    size: float  # of the workspace [unit]; a camera's that of the arm [m]
    lens: tuple[float, float, float, float]  # of a camera: focal length, centre [px] and k1
    lens_sd: tuple[float, float, float, float]

    @property
    def blocks(self) -> tuple[int, ...]:  # type: ignore[override]
        """Sizes of the outputs that share a unit and a noise."""
        outputs = SPATIAL[self.kind].outputs
        return (3, 3) if outputs == 6 else (outputs,)

    @property
    def tool(self) -> Hyper | None:  # type: ignore[override]
        """What is known of the tool."""
        return SPATIAL[self.kind].tool

    @property
    def camera(self) -> bool:
        """Whether it sees pixels."""
        return self.blocks == (2,)

    def parameters(self) -> tuple[Block, ...]:
        """What the sensor has of its own."""
        unit = "m" if self.camera else self.unit  # a camera stands metres away
        lens = {"focal": "px", "centre.u": "px", "centre.v": "px", "k1": "1"}
        turn, shift = ([f"view.{what}.{axis}" for axis in "xyz"] for what in ("rotation", "shift"))
        return (
            Block.of("view.rotation", "rad", turn, 100.0),
            Block.of("view.shift", unit, shift, FREE * self.size),
            Block.of("view.scale", "1", ["view.scale"], 100.0),
            Block(
                "lens", tuple((None, f"lens.{what}", unit) for what, unit in lens.items()),
                np.asarray(self.lens), np.asarray(self.lens_sd),
            ),
        )  # fmt: skip

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The sensor: where it stands, its scale and its lens."""
        scale = float(np.exp(own["view.scale"][0])) * (1.0 if self.camera else self.metre)
        turn = exponential(own["view.rotation"])
        return Placed(self.kind, turn, own["view.shift"], scale, own["lens"])

    def ready(self, own: Mapping[str, Array]) -> Mapping[str, Any]:
        """The sensor."""
        return {"placed": self.placed(own)}

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> View:  # noqa: ARG002
        """See the tip."""
        return look(own["placed"], motion.position, motion.rotation)

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs.

        Of a pose, the last three are the rotation vector, in the sensor's frame, that turns the
        predicted orientation into the observed one.
        """
        out = z - predicted
        if len(self.blocks) == 2:
            seen, expected = exponential(z[:, 3:]), exponential(predicted[:, 3:])
            out[:, 3:] = logarithm(seen @ np.swapaxes(expected, 1, 2))
        return np.asarray(out)


@dataclass(frozen=True)
class View:
    """What a sensor sees of the tip at n rows."""

    values: Array  # (n, outputs)
    sensor: Placed
    # (3, n), the tip in the sensor's frame (camera: [m]), its shift left out for others
    point: Array
    slope: Array | None  # (2, 3, n), derivative of pixels by the point

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:
        """How outputs (..., outputs, n) move when the tip moves in the arm's root frame.

        `velocity` (..., 3, n) [m] and `angular` (..., 3, n) [rad] are those of the tip.
        """
        rotation = self.sensor.rotation
        turned = rotation @ angular if np.ndim(angular) else 0.0
        return self.seen(self.sensor.scale * (rotation @ velocity), turned)

    def columns(self) -> Columns:
        """The derivative (k, outputs, n) by each of the sensor's own blocks."""
        arm = self.point if self.slope is None else self.point - self.sensor.shift[:, None]
        one = np.eye(3)[:, :, None]  # the sensor's own axes
        yield "view.rotation", lambda: self.seen(np.cross(one, arm, axis=-2), one)
        yield "view.shift", lambda: self.seen(np.repeat(one, arm.shape[1], axis=2))
        yield "view.scale", lambda: self.seen(arm)
        if self.slope is not None:
            yield "lens", self.refocused

    def refocused(self) -> Array:
        """Derivative (4, 2, n) of pixels by focal length, centre and k1."""
        f, _, _, k1 = self.sensor.lens
        ideal = self.point[:2] / self.point[2]
        r2 = (ideal**2).sum(axis=0)
        out = np.zeros((4, *ideal.shape))
        out[0] = ideal * (1 + k1 * r2)
        out[1, 0] = out[2, 1] = 1.0
        out[3] = f * ideal * r2
        return out

    def seen(self, moved: Array, turned: Array | float = 0.0) -> Array:
        """How outputs move when the point moves and turns (..., 3, n) in the sensor's frame."""
        if self.slope is not None:
            return np.asarray((self.slope * moved[..., None, :, :]).sum(axis=-2))
        if SPATIAL[self.sensor.kind].outputs == 6:
            return np.concatenate([moved, np.broadcast_to(turned, moved.shape)], axis=-2)
        return moved


def look(sensor: Placed, position: Array, rotation: Array) -> View:
    """See the tip at `position` (3, n) [m] with orientation `rotation` (3, 3, n)."""
    turned = sensor.scale * (sensor.rotation @ position)
    if SPATIAL[sensor.kind].outputs == 2:
        return pixels(sensor, turned + sensor.shift[:, None])
    values = (turned + sensor.shift[:, None]).T
    if SPATIAL[sensor.kind].outputs == 6:
        matrices = sensor.rotation @ np.moveaxis(rotation, 2, 0)
        values = np.concatenate([values, logarithm(matrices)], axis=1)
    return View(np.ascontiguousarray(values), sensor, turned, None)


def pixels(sensor: Placed, point: Array) -> View:
    """See points (3, n) of a camera's frame [m]."""
    f, u0, v0, k1 = sensor.lens
    depth = np.maximum(point[2], LEAST_DEPTH)
    point = np.stack([point[0], point[1], depth])
    ideal = point[:2] / depth
    bent = 1 + k1 * (ideal**2).sum(axis=0)
    values = f * ideal * bent + np.array([[u0], [v0]])
    # d pixel / d ideal = f ((1 + k1 r^2) 1 + 2 k1 u u'), d ideal / d point = [1, -u] / depth
    slope = np.empty((2, 3, len(depth)))
    for i in range(2):
        for j in range(2):
            slope[i, j] = f * 2 * k1 * ideal[i] * ideal[j] / depth
        slope[i, i] += f * bent / depth
    slope[:, 2] = -(slope[:, 0] * ideal[0] + slope[:, 1] * ideal[1])
    return View(np.ascontiguousarray(values.T), sensor, point, slope)


def compose(first: Array, second: Array) -> Array:
    """Rotation vectors (..., 3) of exp(first) exp(second)."""
    return np.asarray(logarithm(exponential(first) @ exponential(second)))
