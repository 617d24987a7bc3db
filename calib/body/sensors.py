"""Sensors: what is said of each before its rows, its parameters, and how these place it.

Several sensors of one arm share one vector of parameters and one belief.  A structure sees as one
of them: that one's blocks are named as those of a single sensor (``view.rotation``), those of the
others after them (``right.view.rotation``).  The order is the same, whichever it sees as.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arm.rotations import cross_matrix, exponential
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import FREE, PRIOR
from .views import (
    PLANAR,
    SPATIAL,
    ArmSize,
    By,
    Measurement,
    Placed,
    Scene,
    View,
    ViewKind,
)

_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
_STRETCH = np.array([[[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])

Lens = tuple[float, float, float, float]
"""Focal length, centre [px] and k1 of a camera."""


@dataclass(frozen=True)
class Sensor(Measurement):
    """A sensor of an arm."""

    kinds: ClassVar[Mapping[str, ViewKind]]
    # whether a further sensor sees a marker of its own, apart from the first one's
    marked: ClassVar[bool]
    view: str
    unit: str = "m"  # of positions
    metre: float = 1.0  # units of positions in one metre; not used by a camera
    extent: float = 1.0  # size of the workspace along an output [unit]
    name: str = ""  # where the arm has several

    @property
    def seen_as(self) -> ViewKind:
        """Return the kind of its view."""
        return self.kinds[self.view]

    @property
    def outputs(self) -> int:  # type: ignore[override]
        """Return how many numbers a row has."""
        return self.seen_as.outputs

    @property
    def focuses(self) -> bool:
        """Whether the rows tell of its lens in every member of the gate."""
        return False

    @property
    def frame(self) -> tuple[str, ...]:
        """Return the blocks that place it, which every member of the gate fits."""
        groups = [
            group for group in self.seen_as.groups if group.startswith("view.")
        ]
        return (*groups, "lens") if self.focuses else tuple(groups)

    def place(self, beta: Mapping[str, Array]) -> Placed:
        """Return the sensor at its parameters, by block."""
        raise NotImplementedError

    def look(self, scene: Scene) -> View:
        """See the tip."""
        motion = scene.motion
        placed = scene.placed
        return placed.look(
            motion.position, motion.rotation if placed.posed else None
        )

    def named_parameters(
        self, arm: ArmSize, *, further: bool
    ) -> tuple[Block, ...]:
        """Return its parameters with its own name before theirs."""
        blocks = self.parameters(arm)
        if further and self.marked:
            axes = [f"marker.{axis}" for axis in "xyz"]
            apart = Hyper(f"{self.name}.marker", PRIOR.marker, PRIOR.markers)
            blocks = (*blocks, Block.of("marker", "m", axes, scales=(apart,)))
        return tuple(block.named(self.name) for block in blocks)


@dataclass(frozen=True)
class InSpace(Sensor):
    """A sensor of an arm in space: positions, poses or pixels."""

    kinds = SPATIAL
    marked = True
    # of a camera, known or assumed, and how sure that is: 0 for a lens that is known
    lens: Lens = (900.0, 640.0, 360.0, 0.0)
    lens_sd: Lens = (300.0, 50.0, 50.0, 0.3)

    @property
    def camera(self) -> bool:
        """Whether it sees pixels."""
        return self.outputs == 2

    @property
    def focuses(self) -> bool:
        """Whether the rows tell of its lens in every member of the gate."""
        return self.camera and any(self.lens_sd)

    @property
    def tool(self) -> Hyper | None:  # type: ignore[override]
        """Return what is known of the tool: a camera's tag is near the tip."""
        return Hyper("tool", PRIOR.tag, PRIOR.wider) if self.camera else None

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:
        """Return what the sensor has of its own; a camera stands metres away."""
        unit, size = (
            (arm.unit, arm.reach) if self.camera else (self.unit, self.extent)
        )
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
            Block.of("view.shift", unit, shifts, FREE * size),
            Block.of("view.scale", "1", ["view.scale"], 100.0),
            Block(
                "lens", lens, np.asarray(self.lens), np.asarray(self.lens_sd)
            ),
        )

    def place(self, beta: Mapping[str, Array]) -> Placed:
        """Return the sensor: where it stands, its scale and its lens."""
        scale = float(np.exp(beta["view.scale"][0]))
        if not self.camera:
            scale *= self.metre
        eye = np.eye(3)
        turn = exponential(beta["view.rotation"])
        arm = np.hstack([scale * turn, np.zeros((3, 1))])
        by = {
            "view.rotation": lambda: By(cross_matrix(eye) @ arm, eye),
            "view.shift": lambda: By(eye[:, :, None] * np.eye(4)[3]),
            "view.scale": lambda: By(arm[None]),
        }
        lens: Array | None = None
        if self.camera:
            lens = beta["lens"]
            by["lens"] = lambda: By(np.zeros((4, 3, 4)), lens=np.eye(4))
        return Placed(
            matrix=np.column_stack([arm[:, :3], beta["view.shift"]]),
            lens=lens,
            by=by,
            posed=self.outputs == 6,
            rotation=turn,
            scale=scale,
        )


@dataclass(frozen=True)
class InPlane(Sensor):
    """A sensor of a planar arm: two coordinates, turned, scaled, sheared, shifted, tilted, bent.

    With u in extents from a lens's free centre; with k = 0 the lens does nothing::

        y = A p / (1 + h.p) + t,  A = metre exp(s) R(alpha) [[1+a, b], [b, 1-a]] mirror
        z = y + size k |u|^2 u,   u = (y - middle) / size - c
    """

    kinds = PLANAR
    marked = False
    mirror: int = 1  # -1 where the sensor sees the plane from behind
    # mean position [unit], origin of the lens
    centre: tuple[float, float] = (0.0, 0.0)

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:
        """Return what the sensor has of its own."""
        rotation = 0.0
        shift = np.zeros(2)
        if self.view == "base":
            rotation = arm.rotation
            shift = self.metre * np.asarray(arm.shift)
        shifts = ["view.shift x", "view.shift y"]
        shears = ["view.stretch", "view.shear"]
        tilts = ["view.tilt x", "view.tilt y"]
        lens = ["lens.radial", "lens.centre x", "lens.centre y"]
        return (
            Block.of(
                "view.rotation", "rad", ["view.rotation"], 100.0, rotation
            ),
            Block.of("view.scale", "1", ["view.log scale"], 100.0),
            Block.of("view.shear", "1", shears, 1.0),
            Block.of(
                "view.shift", self.unit, shifts, FREE * self.extent, shift
            ),
            Block.of("view.tilt", f"1/{arm.unit}", tilts, 1.0 / arm.reach),
            Block.of("lens", "1", lens, 0.5),
        )

    def place(self, beta: Mapping[str, Array]) -> Placed:
        """Return the plane as a picture, or without tilt and bend positions as they are."""
        size = PRIOR.lens_size * self.extent
        eye = np.eye(3)
        radial = beta["lens"][0]
        middle = self.centre + size * beta["lens"][1:]
        shift = beta["view.shift"]
        angle = beta["view.rotation"][0]
        turn = np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        turned = self.metre * np.exp(beta["view.scale"][0]) * turn
        stretch, shear = beta["view.shear"]
        sides = np.array([[1 + stretch, shear], [shear, 1 - stretch]])
        flip = np.diag([1.0, self.mirror])
        linear = turned @ sides @ flip
        by_shear = _STRETCH @ flip
        # the matrix is A / size and the product of (t - middle, size) / size with (h, 1)
        start = np.append((shift - middle) / size, 1.0)
        tilt = np.append(beta["view.tilt"], 1.0)
        across = eye[:2, :, None] * tilt
        # without a bend its centre is nowhere
        by_lens = np.concatenate([np.zeros((1, 3, 3)), -across])
        lens_order = np.diag([1.0, size, size]) @ np.eye(4)[[3, 1, 2]]
        by = {
            "view.rotation": lambda: By(
                _corner(_QUARTER_TURN @ linear[None]) / size
            ),
            "view.scale": lambda: By(_corner(linear[None]) / size),
            "view.shear": lambda: By(_corner(turned @ by_shear) / size),
            "view.shift": lambda: By(across / size),
            "view.tilt": lambda: By(start[:, None] * eye[:2, None]),
            "lens": lambda: By(by_lens, lens=lens_order),
        }
        picture = _corner(linear) / size + np.outer(start, tilt)
        whole = Placed(picture, np.array([size, *middle, radial]), by)
        if radial or beta["view.tilt"].any():
            return whole
        return Placed(np.column_stack([linear, shift]), None, by, whole=whole)


def _corner(linear: Array) -> Array:
    """Return matrices (..., 3, 3) of those (..., 2, 2) in their corner."""
    out = np.zeros((*linear.shape[:-2], 3, 3))
    out[..., :2, :2] = linear
    return out
