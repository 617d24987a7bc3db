"""Spatial body: a chain with a prior on every joint origin, seen by a tracker or a camera.

The product of exponentials (Brockett 1984) with six numbers per joint origin, joint elasticity
under gravity, and an error curve per joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from ..arm.spatial_chain import GRAVITY, Deviations, Links, Motion, SpatialChain
from ..common.arrays import Array
from .curves import curve_shape
from .parameters import Block, Hyper, Indices
from .settings import CURVE_RMS, CURVE_ROWS, ELASTIC, GAIN, SERVOS, SHIFT, TURN, WIDER
from .structure import Ladder, Moving, Structure
from .views import InSpace, Measurement, compose, is_camera


@dataclass(frozen=True, eq=False)
class SpatialStructure(Structure):
    """The structure of a spatial arm and its sensor; see `Structure`."""

    kind = "spatial"
    gate_rows = 1200  # each has three outputs and hundreds of parameters
    wide = (200.0, 1e-3)
    # the nominal chain [m]: of a URDF, or what `spatial_starts` found without one
    chain: SpatialChain
    # active joints (dof), and all joints of the chain (m) with mimic joints
    joint_names: tuple[str, ...]
    chain_names: tuple[str, ...]
    revolute: tuple[bool, ...]  # which active joints turn
    view: str = "rigid"  # one of :data:`calib.body.views.SPATIAL`
    unit: str = "m"  # unit of positions
    metre: float = 1.0  # units of positions in one metre; not used by a camera
    extent: float = 1.0  # size of the workspace along an output [unit]
    # (4,), focal length, centre [px] and k1 that are known or assumed; used by ``"pinhole"``
    lens: tuple[float, float, float, float] = (900.0, 640.0, 360.0, 0.0)
    # (4,), how sure they are: 0 for a lens that is known
    lens_sd: tuple[float, float, float, float] = (300.0, 50.0, 50.0, 0.3)
    # whether the chain is a drawing (prior 1 mm, 0.1 deg) or was found from rows alone
    informed: bool = True
    gravity: tuple[float, float, float] = GRAVITY  # (3,) [m/s2], in the root frame
    simulated: bool = False  # whether the rows are samples of a simulation
    reading: Measurement | None = None  # what is measured, where its view's name does not say all

    @property
    def based(self) -> bool:
        """Whether the sensor's frame is the robot's root frame."""
        return self.view.startswith("base")

    @property
    def camera(self) -> bool:
        """Whether a camera sees the arm, in pixels."""
        return self.outputs == 2

    @cached_property
    def measurement(self) -> Measurement:
        """What its sensor measures."""
        size = self._reach if is_camera(self.view) else self.extent
        view = InSpace(self.view, self.unit, self.metre, size, self.lens, self.lens_sd)
        return self.reading or view

    @property
    def _reach(self) -> float:
        return max(self.chain.reach, 1e-9)

    @property
    def shifts(self) -> Indices:
        """Parameters (c, 3) that shift the joint origins."""
        return self.groups["placement"].reshape(-1, 2, 3)[:, 0]

    @property
    def turns(self) -> Indices:
        """Parameters (c, 3) that turn the joint origins."""
        return self.groups["placement"].reshape(-1, 2, 3)[:, 1]

    def geometry(self) -> Sequence[Block]:
        """Blocks of the tip, the joint origins and the joints."""
        informed, joints, reach = self.informed, self.chain_names, self._reach
        units = tuple("rad" if turns else "m" for turns in self.revolute)
        # in a free frame the first turning joint's offset and a turn of the frame about its axis
        # are one, and the first origin's place is the frame's own
        first = 0 if self.based and not self.measurement.floating else 1
        turned, slid = ([k for k in range(first, self.dof) if units[k] == u] for u in ("rad", "m"))
        places = [(w, a, u) for (w, u), a in product((("shift", "m"), ("turn", "rad")), "xyz")]
        origins = [(n, f"{n}.{what}.{axis}", unit) for n in joints for what, axis, unit in places]
        placed = np.arange(6 * first, len(origins)).reshape(-1, 2, 3)
        within, tool = self.measurement.within, self.measurement.tool
        drawn = (
            Hyper("placement.shift", SHIFT, within, indices=placed[:, 0].ravel()),
            Hyper("placement.turn", TURN, within, indices=placed[:, 1].ravel()),
        )
        offsets = (
            Hyper("offset", TURN, SERVOS, indices=turned),
            Hyper("offset.slide", SHIFT, WIDER, indices=slid),
        )
        # where no drawing says, origins are anywhere; what one orientation does not tell is held
        flat = np.tile(np.repeat((reach, 3.0), 3), len(joints))
        held = (tool,) if tool is not None and informed else ()
        bent = tuple((n, f"{n}.elastic", "rad") for n in joints) if len(self.chain.masses) else ()
        turns = [f"tool.rotation.{axis}" for axis in "xyz"]
        return (
            Block.of("tool", "m", [f"tool.{axis}" for axis in "xyz"], reach, scales=held),
            Block.of("tool.rotation", "rad", turns, TURN if self.view == "base pose" else 3.0),
            Block("placement", tuple(origins), 0.0, *((0.0, drawn) if informed else (flat,))),
            Block("offset", self.of_joints("offset", *units), scales=offsets),
            Block("gain", self.of_joints("gain", "1"), 1.0, scales=(Hyper("gain", GAIN, WIDER),)),
            Block("elastic", bent, scales=(Hyper("elastic", ELASTIC, pseudo=1.0),)),
            *self.curves(CURVE_RMS, CURVE_ROWS, curve_shape()),
        )

    @cached_property
    def torque(self) -> float:
        """Largest torque [N m] of gravity on the first joint: that of the arm stretched."""
        away = np.linalg.norm(self.chain.centres - self.chain.points[0], axis=1)
        return max(float(self.chain.masses @ away * np.linalg.norm(self.gravity)), 1e-12)

    def loads(self, q: Array) -> tuple[Array, Indices]:
        """Torques (c, n) of gravity on the chain's joints, as shares of the largest.

        Where nothing is known of its masses, there are none.
        """
        loads = self.chain.torques(q, self.gravity).T / self.torque
        return np.ascontiguousarray(loads), np.arange(self.chain.joints)

    def load_slopes(self, q: Array) -> Array:
        """Derivatives (c, dof, n) of those shares by the joint values."""
        return np.asarray(self.chain.torque_slopes(q, self.gravity) / self.torque)

    def coupled(self, own: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        return np.asarray(self.chain.coupling @ own + self.chain.bias[:, None])

    def led(self, chained: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        return np.tensordot(self.chain.coupling.T, chained, axes=1)

    def deviations(self, beta: Array) -> Deviations:
        """How the chain differs from its nominal one."""
        parts = (self.shifts, self.turns, self.groups["tool"], self.groups["tool.rotation"])
        return Deviations(*(beta[index] for index in parts))

    def links(self, beta: Array) -> Links:
        """The chain's links."""
        return Links.of(self.chain, self.deviations(beta))

    def moving(self, motion: Motion) -> Moving:
        """How the tip moves with each part of the geometry."""
        still = np.zeros((3, *motion.position.shape))
        yield self.groups["tool"], lambda: (_axes(motion.flange), 0.0)
        yield self.groups["tool.rotation"], lambda: (still, _axes(motion.rotation))
        yield self.shifts, lambda: (_axes(motion.frames[:-1]), 0.0)
        yield self.turns, motion.turns

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        out = beta + delta
        # a sensor's step turns about the sensor's axes (on the left), the arm's about their own
        view = self.groups["view.rotation"]
        if delta[view].any():
            out[view] = compose(delta[view], beta[view])
        own = np.vstack([self.groups["tool.rotation"], self.turns])
        if delta[own].any():
            out[own] = compose(beta[own], delta[own])
        return out

    def members(self) -> Ladder:
        """The gate's members from simple to rich."""
        frame, drawn = self.frame_groups, self.informed
        chain = (*frame, "placement", *(("offset",) if drawn else ()))
        bends = drawn and len(self.groups["elastic"]) > 0
        bent = (*chain, "elastic") if bends else chain
        ladder = (
            ("frame", frame, drawn),
            ("offsets", (*frame, "offset"), drawn and self.camera),
            ("chain", chain, True),
            ("elastic", bent, bends),
            ("curves", (*bent, "curve"), any(self.revolute) and self.measurement.curves),
        )
        return tuple((name, groups) for name, groups, wanted in ladder if wanted)

    @property
    def frame_groups(self) -> tuple[str, ...]:
        """Blocks that every member fits: the sensor's place and the tip that it sees."""
        lens = ("lens",) if self.camera and any(self.lens_sd) else ()
        return (*self.seen_as.groups, *self.measurement.free, *lens)

    def with_view(self, view: str, **changes: Any) -> SpatialStructure:
        """Return the structure with another view."""
        return replace(self, view=view, **changes)

    def pose(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Position (n, 3) [m] and orientation (n, 3, 3) of the tip in the arm's root frame."""
        motion = self.move(self.joint_values(q, beta), beta)
        # rows first and contiguous, or every product that follows would copy
        return np.ascontiguousarray(motion.position.T), np.moveaxis(motion.rotation, 2, 0).copy()


def _axes(rotation: Array) -> Array:
    """Axes (..., 3, 3, n) of frames (..., 3, 3, n): their columns first."""
    return np.swapaxes(rotation, -3, -2)


def structure_of(
    arm: Any, view: str = "rigid", kind: type[SpatialStructure] | None = None, **options: Any
) -> SpatialStructure:
    """Return the structure of an arm and a view of it, its URDF being the prior.

    `options` are further attributes: unit, metre, extent, lens, lens_sd, gravity.
    """
    chain: SpatialChain = arm.chain
    names: list[str] = []
    for i, leader in enumerate(chain.leaders):
        name = arm.joint_names[leader]
        names.append(name if name not in names else f"{name}.mimic{i}")
    options.setdefault("extent", max(chain.reach, 1e-9) * options.get("metre", 1.0))
    own = tuple(arm.joint_names), tuple(names), tuple(arm.revolute)
    return (kind or SpatialStructure)(chain, *own, view, **options)


def unknown_structure(
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    extent: float,
    unit: str = "m",
    metre: float = 1.0,
    simulated: bool = False,
) -> SpatialStructure:
    """Return the structure of a serial arm of which only its joints' names are known.

    extent : size of the workspace along an output [unit]: the positions' rms spread
    metre : units of positions in one metre
    """
    names = tuple(joint_names)
    dof = len(names)
    up = np.array([0.0, 0.0, 1.0])
    ends = np.outer(extent / metre / max(dof, 1) * np.arange(dof + 1), up)
    chain = SpatialChain(
        axes=np.tile(up, (dof, 1)),
        points=ends[:-1],
        tip=ends[-1],
        rotation=np.eye(3),
        revolute=tuple(revolute),
        coupling=np.eye(dof),
        bias=np.zeros(dof),
    )
    return SpatialStructure(
        chain,
        names,
        names,
        tuple(revolute),
        "base",
        unit,
        metre,
        extent,
        informed=False,
        simulated=simulated,
    )
