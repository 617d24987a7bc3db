"""Sensors: what is known of each beforehand, its parameters, and how these place it.

Several sensors of one arm share one vector of parameters and one belief.  A structure sees as one
of them: that one's blocks are named as those of a single sensor (``view.rotation``), those of the
others after them (``right.view.rotation``).  The order is the same, whichever it sees as.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arm.rotations import exponential
from ..arm.spatial_chain import ChainState
from ..common.arrays import Array
from .parameters import Block, Hyper
from .settings import FLAT_SD, PRIOR
from .views import (
    PLANAR,
    SPATIAL,
    ArmSize,
    Measurement,
    Projection,
    Sight,
    ViewKind,
    is_camera,
)

SENSOR_BLOCKS = ("view.rotation", "view.shift", "view.scale", "lens")
"""Blocks of the place of a sensor in space, and of its lens."""

LensValues = tuple[float, float, float, float]
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
    def view_kind(self) -> ViewKind:
        """The kind of its view."""
        return self.kinds[self.view]

    @property
    def outputs(self) -> int:  # type: ignore[override]
        """How many numbers a row has."""
        return self.view_kind.outputs

    @property
    def is_metric(self) -> bool:
        """Whether it says how long a metre is."""
        return not (self.view_kind.has_scale or is_camera(self.view))

    @property
    def groups(self) -> tuple[str, ...]:
        """The blocks that every member of the gate fits: its place, the tip that it sees."""
        return self.view_kind.groups

    def projection(self, beta: Mapping[str, Array]) -> Projection:
        """The sensor at its parameters, by block."""
        raise NotImplementedError

    def look(
        self,
        blocks: Mapping[str, Array],
        state: ChainState,
        row_facts: Array,  # noqa: ARG002
    ) -> Sight:
        """See the tip."""
        return self.projection(blocks).look(state)

    def parameters_with_name(
        self, arm: ArmSize, *, further: bool
    ) -> tuple[Block, ...]:
        """Its parameters with its own name before theirs."""
        blocks = self.parameters(arm)
        if further and self.marked:
            distance = Hyper(f"{self.name}.marker", PRIOR.marker, PRIOR.markers)
            marker = Block.of("marker", "m", "xyz", scales=(distance,))
            blocks = (*blocks, marker)
        return tuple(block.with_sensor_name(self.name) for block in blocks)


@dataclass(frozen=True)
class InSpace(Sensor):
    """A sensor of an arm in space: positions, poses or pixels."""

    kinds = SPATIAL
    marked = True
    # of a camera, known or assumed, and how sure that is: 0 for a lens that is known
    lens: LensValues = (900.0, 640.0, 360.0, 0.0)
    lens_sd: LensValues = (300.0, 50.0, 50.0, 0.3)

    @property
    def camera(self) -> bool:
        """Whether it sees pixels."""
        return self.outputs == 2

    @property
    def groups(self) -> tuple[str, ...]:
        """The blocks that every member of the gate fits; of a camera its lens, too."""
        groups = self.view_kind.groups
        if self.camera and any(self.lens_sd):
            return (*groups, "lens")
        return groups

    @property
    def tool(self) -> Hyper | None:  # type: ignore[override]
        """What is known of the tool: a camera's tag is near the tip."""
        if not self.camera:
            return None
        return Hyper("tool", PRIOR.tag, PRIOR.wider)

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:
        """The sensor's own parameters; a camera is metres away."""
        unit = self.unit
        size = self.extent
        if self.camera:
            unit = arm.unit
            size = arm.reach
        lens = Block.of(
            "lens",
            ("px", "px", "px", "1"),
            ("focal", "centre.u", "centre.v", "k1"),
            sd=np.asarray(self.lens_sd),
            mean=np.asarray(self.lens),
        )
        return (
            Block.of("view.rotation", "rad", "xyz", sd=100.0),
            Block.of("view.shift", unit, "xyz", sd=FLAT_SD * size),
            Block.of("view.scale", "1", sd=100.0),
            lens,
        )

    def projection(self, beta: Mapping[str, Array]) -> Projection:
        """The sensor with its place, its scale and its lens."""
        scale = float(np.exp(beta["view.scale"][0]))
        if not self.camera:
            scale *= self.metre
        turn = exponential(beta["view.rotation"])
        matrix = np.column_stack([scale * turn, beta["view.shift"]])
        return Projection(
            matrix=matrix,
            lens=beta["lens"] if self.camera else None,
            has_orientation=self.outputs == 6,
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
        """The sensor's own parameters."""
        rotation = 0.0
        shift = np.zeros(2)
        if self.view == "base":
            rotation = arm.rotation
            shift = self.metre * np.asarray(arm.shift)
        anywhere = FLAT_SD * self.extent
        slope = f"1/{arm.unit}"
        middle = ("radial", "centre x", "centre y")
        return (
            Block.of("view.rotation", "rad", sd=100.0, mean=rotation),
            Block.of("view.scale", "1", sd=100.0),
            Block.of("view.shear", "1", ("stretch", "shear"), sd=1.0),
            Block.of("view.shift", self.unit, "xy", sd=anywhere, mean=shift),
            Block.of("view.tilt", slope, "xy", sd=1.0 / arm.reach),
            Block.of("lens", "1", middle, sd=0.5),
        )

    def projection(self, beta: Mapping[str, Array]) -> Projection:
        """The plane as a picture, or without tilt and bend positions as they are."""
        radial, *bend = beta["lens"].tolist()
        (angle,) = beta["view.rotation"].tolist()
        stretch, shear = beta["view.shear"].tolist()
        shift = beta["view.shift"]
        tilt = beta["view.tilt"]
        cosine = np.cos(angle)
        sine = np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        sides = np.array([[1.0 + stretch, shear], [shear, 1.0 - stretch]])
        sides[:, 1] *= self.mirror
        scale = self.metre * np.exp(beta["view.scale"].item())
        linear = scale * turn @ sides
        if not radial and not tilt.any() and self.view != "homography":
            return Projection(np.column_stack([linear, shift]))
        size = PRIOR.lens_size * self.extent
        middle = self.centre + size * np.array(bend)
        # A / size in the corner, and the product of (t - middle, size) / size with (h, 1)
        start = np.append((shift - middle) / size, 1.0)
        picture = np.outer(start, np.append(tilt, 1.0))
        picture[:2, :2] += linear / size
        lens = np.array([size, *middle, radial])
        return Projection(picture, lens)
