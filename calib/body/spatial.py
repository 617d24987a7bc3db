"""Spatial body: a chain with a prior on every joint origin, seen by a tracker or a camera.

The product of exponentials (Brockett 1984) with six numbers per joint origin, joint elasticity
under gravity, and an error curve per joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.arm import PlanarArm, SpatialArm
from ..arm.gravity import GRAVITY, Loads
from ..arm.rotations import logarithm
from ..arm.spatial_chain import ChainState, Deviations, Links, SpatialChain
from ..common.arrays import Array, Mask
from ..common.rows import row_lengths
from ..common.scale import METRES
from .curves import curve_shape
from .parameters import Block, Hyper, Indices
from .sensors import InSpace
from .settings import DRAWN_SHIFT_SD, DRAWN_TURN_SD, FIT, PRIOR
from .structure import Structure, TipMotions
from .views import ArmSize, Measurement, compose


@dataclass(frozen=True, eq=False)
class SpatialStructure(Structure):
    """The structure of a spatial arm and its sensor; see `Structure`."""

    kind = "spatial"
    gate_rows = 1200  # each has three outputs and hundreds of parameters
    wide = (200.0, 1e-3)
    # fewer rows show how large its curves are, if not where
    few_rows = FIT.shared_rows
    # the nominal chain [m]: of a URDF, or what `chain_starts` found without one
    chain: SpatialChain
    # active joints (dof), and all joints of the chain (c) with mimic joints
    joint_names: tuple[str, ...]
    chain_names: tuple[str, ...]
    revolute: tuple[bool, ...]  # which active joints turn
    sensors: tuple[InSpace, ...] = (InSpace("rigid"),)
    place: int = 0
    # whether the chain is a drawing (prior 1 mm, 0.1 deg) or was found from rows alone
    informed: bool = True
    # (3,) [m/s2], in the root frame
    gravity: tuple[float, float, float] = GRAVITY
    simulated: bool = False  # whether the rows are samples of a simulation
    # whether the geometry is as drawn, and only joints' zeros and the sensor are not
    zeros_alone: bool = False
    others: tuple[Measurement, ...] = field(
        default=(), metadata={"kept": False}
    )

    @property
    def camera(self) -> bool:
        """Whether a camera sees the arm, in pixels."""
        return self.outputs == 2

    @property
    def viewpoint(self) -> InSpace:
        """The sensor that is predicted, or the first one where a touch is."""
        return super().viewpoint  # type: ignore[return-value]

    @property
    def arm_size(self) -> ArmSize:
        """Size and place of the arm, for the priors of sensors."""
        return ArmSize(self._reach, "m")

    @property
    def _reach(self) -> float:
        return max(self.chain.reach, 1e-9)

    @property
    def placements(self) -> Indices:
        """Parameters (c, 2, 3) that shift and turn the joint origins."""
        return self.groups["placement"].reshape(-1, 2, 3)

    @property
    def shifts(self) -> Indices:
        """Parameters (c, 3) that shift the joint origins."""
        return self.placements[:, 0]

    @property
    def turns(self) -> Indices:
        """Parameters (c, 3) that turn the joint origins."""
        return self.placements[:, 1]

    @property
    def linear(self) -> Indices:
        """Parameters that shift the reading: sensor's place, tool, origins; none in pixels."""
        if self.camera:
            return super().linear
        shift = self.groups["view.shift"]
        tool = self.groups["tool"]
        origins = self.shifts.ravel()
        return np.concatenate([shift, tool, origins])

    def geometry(self) -> Sequence[Block]:
        """Blocks of the tip, the joint origins and the joints."""
        # parts of the tool that one orientation does not determine are held
        turn = DRAWN_TURN_SD if self.sensors[0].view == "base pose" else 3.0
        tools = (self.tool,) if self.tool and self.informed else ()
        names = self.joint_names
        indices = np.flatnonzero(self._has_motor_before)
        gears = Hyper("coupling", PRIOR.coupling, pseudo=1.0, indices=indices)
        return (
            Block.of("tool", "m", "xyz", sd=self._reach, scales=tools),
            Block.of("tool.rotation", "rad", "xyz", sd=turn),
            self._placement(),
            self._offset(),
            self.gains(),
            *self._elasticity(),
            Block.of(
                "coupling", "1", ["coupling"], scales=(gears,), joints=names[1:]
            ),
            *self.curves(PRIOR.curve_rows, curve_shape()),
        )

    @property
    def _has_motor_before(self) -> Mask:
        """Whether each joint from the second on (dof - 1,) turns, and the one before it, too."""
        return self.is_revolute[1:] & self.is_revolute[:-1]

    def _placement(self) -> Block:
        """Where the joints' origins are; anywhere, without a drawing."""
        count = len(self.chain_names)
        sd = np.zeros(6 * count)
        scales: tuple[Hyper, ...] = ()
        if self.informed:
            within = self.others[0].within if self.others else PRIOR.wider
            free = np.arange(6 * self.first_free, len(sd))
            places = free.reshape(-1, 2, 3)
            shifts = places[:, 0].ravel()
            turns = places[:, 1].ravel()
            scales = (
                Hyper(
                    "placement.shift", DRAWN_SHIFT_SD, within, indices=shifts
                ),
                Hyper("placement.turn", DRAWN_TURN_SD, within, indices=turns),
            )
        else:
            shift_and_turn = np.repeat((self._reach, 3.0), 3)
            sd = np.tile(shift_and_turn, count)
        parts = [f"{way}.{axis}" for way in ("shift", "turn") for axis in "xyz"]
        units = ["m"] * 3 + ["rad"] * 3
        names = self.chain_names
        return Block.of(
            "placement", units, parts, sd=sd, scales=scales, joints=names
        )

    def _offset(self) -> Block:
        """The joints' zeros."""
        turning = self.is_revolute
        free = np.arange(self.dof) >= self.first_free
        angles = np.flatnonzero(free & turning)
        lengths = np.flatnonzero(free & ~turning)
        scales = (
            Hyper("offset", DRAWN_TURN_SD, PRIOR.servos, indices=angles),
            Hyper("offset.slide", DRAWN_SHIFT_SD, PRIOR.wider, indices=lengths),
        )
        units = np.where(turning, "rad", "m").tolist()
        names = self.joint_names
        return Block.of(
            "offset", units, ["offset"], scales=scales, joints=names
        )

    def _elasticity(self) -> Iterator[Block]:
        """Blocks of how much loads bend the joints, and of where gravity points."""
        names = self.chain_names
        ends = (*names[1:], "tip")
        for block, loads in self.loads.items():
            labels: list[tuple[str, str, str]] = []
            for joint, weights in zip(loads.joints, loads.weights, strict=True):
                name = f"{names[joint]}.{block}"
                if block != "elastic" or not self.has_masses:
                    name += f" {ends[weights.argmax()]}"
                unit = "rad" if self.chain.revolute[joint] else "m"
                labels.append((names[joint], name, unit))
            scale = Hyper(block, PRIOR.elastic, pseudo=1.0)
            yield Block(block, tuple(labels), scales=(scale,))
        axes = ["xyz"[axis] for axis in self._level_axes]
        yield Block.of("gravity", "rad", axes, sd=PRIOR.tilt)

    @property
    def has_masses(self) -> bool:
        """Whether the drawing states masses."""
        return len(self.chain.masses) > 0

    @cached_property
    def loads(self) -> Mapping[str, Loads]:
        """Loads of each block of elasticity, as shares of the largest under a unit gravity.

        Those of the drawing's masses, if it states some, and of unit weights at the links' ends: of
        a payload, or instead of masses.  A chain without a drawing has none.
        """
        if not self.informed:
            return {}
        weights = Loads.of_unit_weights(self.chain)
        units = weights.scaled(1.0 / self._reach)
        if not self.has_masses:
            return {"elastic": units}
        chain = self.chain
        arms = chain.centres - chain.points[0]
        # [kg m], on the first joint
        largest = float(chain.masses @ row_lengths(arms))
        largest = max(largest, 1e-12)
        masses = Loads.of_masses(chain)
        shares = masses.scaled(1.0 / largest)
        return {"elastic": shares, "payload": units}

    @property
    def _level_axes(self) -> list[int]:
        """The root frame's axes that are the least along the drawing's gravity."""
        sizes = np.abs(self.gravity)
        order = np.argsort(sizes, kind="stable")
        return sorted(order[:2].tolist())

    @cached_property
    def tilts(self) -> Mapping[str, Array]:
        """The ways (2, 3) in which the block of gravity's two angles moves its direction."""
        down = self._drawn_gravity
        across = np.eye(3)[self._level_axes]
        return {"gravity": across - np.outer(across @ down, down)}

    @property
    def _drawn_gravity(self) -> Array:
        """The drawing's direction (3,) of gravity."""
        gravity = np.asarray(self.gravity, dtype=float)
        size = float(np.linalg.norm(gravity))
        return gravity / max(size, 1e-300)

    def gravity_at(self, beta: Array) -> Array:
        """Direction (3,) of gravity in the root frame."""
        angles = beta[self.groups["gravity"]]
        return self._drawn_gravity + angles @ self.tilts["gravity"]

    def chain_values(self, values: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        chain = self.chain
        values = chain.coupling @ values
        values += chain.bias[:, None]
        return values

    def joint_slope(self, chain_slope: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        count, outputs, n = chain_slope.shape
        rows = chain_slope.reshape(count, outputs * n)
        slopes = self.chain.coupling.T @ rows
        return slopes.reshape(self.dof, outputs, n)

    def turn_parameters(self, turn: Array) -> Array:
        """Rotation vector (3,) of the sensor's turn (3, 3)."""
        return logarithm(turn)

    def deviations(self, beta: Array) -> Deviations:
        """How the chain differs from its nominal one."""
        tool = beta[self.groups["tool"]]
        if "marker" in self.groups:
            tool = tool + beta[self.groups["marker"]]
        turn = beta[self.groups["tool.rotation"]]
        shifts = beta[self.shifts]
        turns = beta[self.turns]
        return Deviations(shifts, turns, tool, turn)

    def links(self, beta: Array) -> Links:
        """The chain's links."""
        return Links.of(self.chain, self.deviations(beta))

    def tip_motions(self, state: ChainState) -> TipMotions:
        """How the tip moves with each part of the geometry."""
        no_motion = np.zeros((3, *state.position.shape))
        groups = self.groups
        for tool in groups.keys() & {"tool", "marker"}:
            yield groups[tool], lambda: (_axes(state.flange), None)
        tool_turn = groups["tool.rotation"]
        yield tool_turn, lambda: (no_motion, _axes(state.rotation))
        frames = state.frames[:-1]
        yield self.shifts, lambda: (_axes(frames), None)
        yield self.turns, state.turns

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        moved = beta + delta
        # a sensor's step turns about the sensor's axes (on the left), the arm's about their own
        for block, indices in self.groups.items():
            if block.endswith("view.rotation"):
                step = delta[indices]
                if step.any():
                    moved[indices] = compose(step, beta[indices])
        tool = self.groups["tool.rotation"]
        turns = np.vstack([tool, self.turns])
        step = delta[turns]
        if step.any():
            moved[turns] = compose(beta[turns], step)
        return moved

    def ladder(self) -> Sequence[tuple[str, tuple[str, ...], bool]]:
        """Members from simple to rich: a name, the blocks that it frees, whether it is wanted."""
        frame = self.frame_groups
        turns = any(self.revolute)
        gears = bool(self._has_motor_before.any())
        drawn = self.informed
        chain = (*frame, "placement")
        bent = chain
        if drawn:
            chain = (*chain, "offset")
            bent = (*chain, "elastic", "gravity")
        # touches of some places follow wrong gains: 2 % more error elsewhere
        geared = "point" not in self.groups
        return (
            ("frame", frame, drawn),
            ("offsets", (*frame, "offset"), drawn and self.camera),
            ("chain", chain, True),
            ("scales", (*chain, *self.scale_groups), bool(self.scale_groups)),
            ("elastic", bent, drawn),
            ("payload", (*bent, "payload"), drawn and self.has_masses),
            ("coupled", (*chain, "coupling"), drawn and gears),
            ("geared", (*chain, "gain"), geared),
            ("curves", (*bent, "curve"), turns),
        )

    def pose(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Position (n, 3) [m] and orientation (n, 3, 3) of the tip in the arm's root frame."""
        values = self.joint_values(q, beta)
        state = self.move(values, beta)
        # rows first and contiguous, or every product that follows would copy
        position = np.ascontiguousarray(state.position.T)
        rotation = np.moveaxis(state.rotation, 2, 0)
        return position, rotation.copy()


def _axes(rotation: Array) -> Array:
    """Axes (..., 3, 3, n) of frames (..., 3, 3, n): their columns first."""
    return np.swapaxes(rotation, -3, -2)


def structure_of(
    arm: PlanarArm | SpatialArm, view: str = "rigid", **fields: Any
) -> SpatialStructure:
    """The structure of an arm and a view of it, its URDF being the prior.

    `fields` are those of its sensor, see `InSpace`, and of the structure: gravity.
    """
    chain = arm.chain
    names: list[str] = []
    for i, leader in enumerate(chain.leaders):
        name = arm.joint_names[leader]
        names.append(name if name not in names else f"{name}.mimic{i}")
    gravity = fields.pop("gravity", tuple(arm.gravity))
    extent = max(chain.reach, 1e-9) * fields.get("metre", 1.0)
    sensor = InSpace(view, **{"extent": extent, **fields})
    return SpatialStructure(
        chain,
        joint_names=tuple(arm.joint_names),
        chain_names=tuple(names),
        revolute=tuple(arm.revolute),
        sensors=(sensor,),
        gravity=gravity,
    )


def unknown_structure(
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    extent: float,
    unit: str = "m",
    simulated: bool = False,
) -> SpatialStructure:
    """The structure of a serial arm of which only its joints' names are known.

    extent : size of the workspace along an output [unit]: the positions' rms spread
    """
    dof = len(joint_names)
    metre = METRES.get(unit, 1.0)
    ends = np.zeros((dof + 1, 3))
    link = extent / metre / max(dof, 1)
    ends[:, 2] = link * np.arange(dof + 1)
    chain = SpatialChain(
        axes=np.tile([0.0, 0.0, 1.0], (dof, 1)),
        points=ends[:-1],
        tip=ends[-1],
        rotation=np.eye(3),
        revolute=tuple(revolute),
        coupling=np.eye(dof),
        bias=np.zeros(dof),
    )
    return SpatialStructure(
        chain,
        joint_names=tuple(joint_names),
        chain_names=tuple(joint_names),
        revolute=tuple(revolute),
        sensors=(InSpace("base", unit, metre, extent),),
        informed=False,
        simulated=simulated,
    )
