"""A planar arm: a chain of parallel axes, of which nothing leaves the plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from ..common.arrays import Array, Mask
from ..common.scale import METRES
from .curves import curve_shape
from .drawing import Complex, PlanarDrawing
from .parameters import Block, Hyper, Indices
from .sensors import InPlane
from .settings import DRAWN_SHIFT_SD, DRAWN_TURN_SD, FIT, PRIOR
from .structure import Structure, TipMotions, constants_at
from .views import ArmSize, TipMotion


@dataclass(frozen=True, eq=False)
class PlanarState:
    """Where a planar chain is at n rows, as complex numbers: the angles of parallel axes add up."""

    direction: Complex  # (dof, n), of each link or slide
    terms: Complex  # (dof, n), the links
    turning: Mask  # (dof, 1), whether each joint turns

    @property
    def position(self) -> Array:
        """The tip (2, n)."""
        return _pairs(self.terms.sum(axis=0))

    def joints(self) -> TipMotion:
        """How the tip moves with the value of each joint, (dof, 2, n)."""
        # a joint turns all that comes after it about its own place
        from_tip = self.terms[::-1]
        sums = from_tip.cumsum(axis=0)
        beyond = sums[::-1]
        swung = 1j * beyond
        moved = np.where(self.turning, swung, self.direction)
        return _pairs(moved), None


@dataclass(frozen=True, eq=False)
class PlanarLoads:
    """Cosines and sines of the directions of the links that bend joints, as logged."""

    turns: Indices  # (dof,), direction of each joint that turns, else 0

    @cached_property
    def pairs(self) -> Indices:
        """Joints that bend, and the links (by their joints) that bend them, (p, 2)."""
        turning = self.turns != 0
        both = np.outer(turning, turning)
        return np.argwhere(np.triu(both))

    @property
    def joints(self) -> Indices:
        """The joints (2 p,) that they bend."""
        return np.repeat(self.pairs[:, 0], 2)

    def levers(self, q: Array) -> Array:
        """Cosines and sines (2 p, 1, n) at joint values (n, dof)."""
        levers = _pairs(self._directions(q))
        count = len(self.joints)
        return levers.reshape(count, 1, len(q))

    def slopes(self, q: Array, gravity: Array) -> Array:  # noqa: ARG002
        """Derivatives (2 p, dof, n) of those by the joint values."""
        n, dof = q.shape
        joints = np.arange(dof)
        before = joints <= self.pairs[:, 1:]
        turns = before * self.turns
        directions = self._directions(q)[:, None]
        moved = 1j * turns[:, :, None] * directions
        slopes = np.swapaxes(_pairs(moved), 1, 2)
        return slopes.reshape(len(self.joints), dof, n)

    def _directions(self, q: Array) -> Complex:
        """Directions (p, n) of the links."""
        sums = np.cumsum(q * self.turns, axis=1)
        links = self.pairs[:, 1]
        directions: Complex = np.exp(1j * sums.T[links])
        return directions


def _pairs(values: Complex) -> Array:
    """Complex numbers (..., n) as coordinates (..., 2, n)."""
    *rest, n = values.shape
    pairs = np.empty((*rest, 2, n))
    # quicker than NumPy's stack, which counts of one row
    pairs[..., 0, :] = values.real
    pairs[..., 1, :] = values.imag
    return pairs


@dataclass(frozen=True, eq=False)
class PlanarStructure(Structure):
    """The structure of a planar body, whose parameters are full lengths [m] and offsets.

    With those of an arm in space it was 2.6 % worse on a real UR10 (.2013 for .1962 mm) and took
    twice the time, of single queries four times.  Its joint curves have longer waves, and its
    elasticity is free: ``elastic_i = sum_{j>=i} a_ij cos psi_j + b_ij sin psi_j``, psi being sums
    of s q.  Where the view has a scale and no drawing gives a length, the first one is the unit.
    """

    kind = "planar"
    gate_rows = 3000
    # with 3 mrad real rows were bounded up to 9.2 times their error, paths covered to 96 % as now
    wide = (200.0, 1.5e-3)
    # scaled as in space, 30 rows of curves of 1 mrad were covered to 93 %, 79 at least, not 96, 89
    few_rows = 0
    guards: ClassVar = {"lens": (FIT.guard_lens, 0.0, 0.0)}  # its bend alone
    joint_names: tuple[str, ...]
    revolute: tuple[bool, ...]
    signs: tuple[int, ...]  # direction of each joint against its log, +1 or -1
    nominal: PlanarDrawing | None  # prior geometry, in metres
    simulated: bool  # whether the rows are samples of a simulation
    sensors: tuple[InPlane, ...]
    place: int = 0
    # whether the geometry is as drawn, and only joints' zeros and the sensor are not
    zeros_alone: bool = False
    others = ()

    @property
    def chain_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of all joints (c,) of the chain."""
        return self.joint_names

    @property
    def directions(self) -> tuple[int, ...]:
        """How each joint (dof,) moves with its log, 1 or -1."""
        return self.signs

    @property
    def is_reversed(self) -> Mask:
        """Which joints (dof,) turn against their drawing, or without one against their log."""
        drawn = self.nominal.signs if self.nominal else np.ones(self.dof)
        return np.not_equal(drawn, self.signs)

    @property
    def reversals(self) -> int:
        """How many joints turn against their drawing, and whether the sensor sees a mirror."""
        return int(self.is_reversed.sum()) + (self.mirror < 0)

    @cached_property
    def loads(self) -> Mapping[str, PlanarLoads]:
        """Loads that bend the joints, by the block of elasticity with a parameter for each."""
        turns = np.multiply(self.signs, self.revolute)
        return {"elastic": PlanarLoads(turns)}

    @property
    def _unit_of_lengths(self) -> str:
        """Metres, or the first length where neither drawing nor view knows metres."""
        first = self.sensors[0]
        if self.nominal is not None:
            return "m"
        if first.unit in METRES and not first.view_kind.has_scale:
            return "m"
        return "1"

    @property
    def _link_size(self) -> float:
        """Prior size of a link's length without a drawing."""
        first = self.sensors[0]
        if first.view_kind.has_scale:
            return 1.0
        return 0.5 * first.extent / first.metre

    @property
    def arm_size(self) -> ArmSize:
        """Size and place of the arm, for the priors of sensors."""
        unit = self._unit_of_lengths
        drawing = self.nominal
        if drawing is None:
            return ArmSize(2.0 * self._link_size, unit)
        reach = max(sum(drawing.lengths), 1e-12)
        return ArmSize(reach, unit, drawing.rotation, drawing.shift)

    @property
    def mirror(self) -> int:
        """-1 where its sensor sees the plane from behind, else 1."""
        return self.viewpoint.mirror

    def undrawn(self) -> PlanarStructure | None:
        """The structure without its drawing, None where the sensor's frame is the drawing's."""
        if self.nominal is None or self.view == "base" or self.zeros_alone:
            return None
        return self.with_fields(nominal=None)

    @property
    def viewpoint(self) -> InPlane:
        """The sensor that it sees as."""
        return self.sensors[self.place]

    def geometry(self) -> Sequence[Block]:
        """Blocks of the chain's geometry and of its joints."""
        drawing = self.nominal
        elastic = PRIOR.elastic_in_plane
        if drawing is not None:
            joints = self._joints_of_drawing(drawing)
        else:
            joints = self._unknown_joints()
            elastic *= 2.0
        shape = curve_shape(PRIOR.long)
        curves = self.curves(PRIOR.curve_rows_in_plane, shape)
        return (*joints, self._elasticity(elastic), *curves)

    def _joints_of_drawing(self, drawing: PlanarDrawing) -> tuple[Block, ...]:
        """Lengths, offsets and gains near those of a drawing."""
        of_joints = partial(Block.of, joints=self.joint_names)
        unit = self._unit_of_lengths
        size = Hyper("length", DRAWN_SHIFT_SD, PRIOR.wider)
        has_offset = slice(self.first_free, None)
        zero = Hyper("offset", DRAWN_TURN_SD, PRIOR.servos, indices=has_offset)
        length = np.array(drawing.lengths)
        offset = np.array(drawing.offsets)
        return (
            of_joints("length", unit, ["length"], mean=length, scales=(size,)),
            of_joints("offset", "rad", ["offset"], mean=offset, scales=(zero,)),
            self.gains(),
        )

    def _unknown_joints(self) -> tuple[Block, ...]:
        """Lengths, offsets and gains without a drawing."""
        names = self.joint_names
        unit = self._unit_of_lengths
        length = np.where(self.is_revolute, self._link_size, 0.0)
        sd = 2.0 * length
        if self.sensors[0].view_kind.has_scale and all(self.revolute):
            sd[0] = 0.0  # the view's scale is the first length
        anywhere = np.where(np.arange(self.dof) < self.first_free, 0.0, 10.0)
        gain = 2.0 * PRIOR.gain
        return (
            Block.of(
                "length", unit, ["length"], sd=sd, mean=length, joints=names
            ),
            Block.of("offset", "rad", ["offset"], sd=anywhere, joints=names),
            Block.of("gain", "1", ["gain"], sd=gain, mean=1.0, joints=names),
        )

    def _elasticity(self, size: float) -> Block:
        """How much loads bend the joints, with the prior's scale [rad]."""
        names = self.joint_names
        labels = tuple(
            (names[i], f"{names[i]}.elastic {wave} {names[j]}", "rad")
            for i, j in self.loads["elastic"].pairs
            for wave in ("cos", "sin")
        )
        scale = Hyper("elastic", size, pseudo=4.0)
        return Block("elastic", labels, scales=(scale,))

    def offsets(self, beta: Array) -> Array:
        """Offsets that are added to the joints' values (dof,); a slide's is its direction."""
        offsets = beta[self.groups["offset"]]
        return np.where(self.revolute, offsets, 0.0)

    def links(self, beta: Array) -> tuple[Array, Array, Mask]:
        """The links' lengths (dof, 1), the slides' directions [rad], and which joints turn."""
        turning = self.is_revolute[:, None]
        length = beta[self.groups["length"], None]
        offset = beta[self.groups["offset"], None]
        slide_angle = np.where(turning, 0.0, offset)
        return length, slide_angle, turning

    def move(self, values: Array, beta: Array) -> PlanarState:  # type: ignore[override]
        """Where the chain is at the true values (dof, n) of its joints."""
        length, slide_angle, turning = constants_at(self, beta).links
        if not all(self.revolute):
            length = length + np.where(turning, 0.0, values)
            values = np.where(turning, values, 0.0)
        angles = values.cumsum(axis=0) + slide_angle
        direction = np.exp(1j * angles)
        return PlanarState(direction, direction * length, turning)

    def tip_motions(self, state: PlanarState) -> TipMotions:  # type: ignore[override]
        """How the tip moves with each part of the geometry."""
        yield self.groups["length"], lambda: (_pairs(state.direction), None)
        # turning a slide's direction turns no other link
        slides = np.flatnonzero(~self.is_revolute)
        offsets = self.groups["offset"][slides]
        yield offsets, lambda: (_pairs(1j * state.terms[slides]), None)

    def turn_parameters(self, turn: Array) -> Array:
        """Angle (1,) of the sensor's turn (2, 2)."""
        return np.arctan2(turn[1:, 0], turn[:1, 0])

    def ladder(self) -> Sequence[tuple[str, tuple[str, ...], bool]]:
        """Members from simple to rich: a name, the blocks that it frees, whether it is wanted."""
        turns = any(self.revolute)
        exact = self.simulated
        joints = ("length", "offset", "gain")
        frame = self.frame_groups
        bent = ("view.shear", "view.tilt")
        few = (*(group for group in frame if group not in bent), *joints)
        chain = (*frame, *joints)
        return (
            ("frame", frame or ("offset",), self.nominal is not None),
            # few rows of a camera that looks straight down need no more
            ("similarity", few, "view.shear" in frame),
            ("chain", chain, True),
            ("scales", (*chain, *self.scale_groups), bool(self.scale_groups)),
            ("elastic", (*chain, "elastic"), exact and turns),
            # a simulated sensor may be tilted or bent; the lengths hold the scale
            ("view", (*chain, "view.shear", "view.tilt", "lens"), exact),
            ("lens", (*chain, "lens"), self.view == "homography" and not exact),
            ("curves", (*chain, "curve"), turns),
            ("elastic", (*chain, "elastic"), turns),
            ("curves and elastic", (*chain, "elastic", "curve"), turns),
        )


def planar_structure(
    z: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: PlanarDrawing | None = None,
    view: str = "auto",
    unit: str = "m",
    simulated: bool = False,
) -> PlanarStructure:
    """The structure for some rows and options; signs and mirror are found later."""
    if view == "auto":
        view = "rigid" if unit in METRES else "homography"
    x, y = z.mean(axis=0).tolist()
    variance = z.var(axis=0).sum()
    extent = float(np.sqrt(variance))
    size = float(np.abs(z).max())
    signs = (1,) * len(joint_names)
    if nominal is not None:
        signs = nominal.signs
    sensor = InPlane(
        view=view,
        unit=unit,
        metre=METRES.get(unit, 1.0),
        extent=max(extent, 1e-9 * (1e-3 + size)),
        centre=(x, y),
    )
    return PlanarStructure(
        joint_names=tuple(joint_names),
        revolute=tuple(bool(turns) for turns in revolute),
        signs=signs,
        nominal=nominal,
        simulated=simulated,
        sensors=(sensor,),
    )
