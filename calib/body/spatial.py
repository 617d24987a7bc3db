"""Spatial body: a chain with a prior on every joint origin, seen by a tracker or a camera.

It predicts what a sensor reads at joint values, and how that depends on each parameter. Source:
the product of exponentials (Brockett 1984) with six numbers per joint origin, joint elasticity
under gravity, and an error curve per joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.motion import Deviations, Motion, move
from ..arm.rotations import exponential, logarithm
from ..arm.spatial_chain import GRAVITY, SpatialChain
from ..common.arrays import Array
from . import priors
from .curves import curve_value
from .layout import SpatialLayout, spatial_layout
from .spatial_slopes import by_joints, by_parameters
from .spatial_view import Placed, View, compose, look
from .structure import Structure
from .words import spatial_words


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
    view: str = "rigid"  # ``"base"``, ``"rigid"``, ``"similarity"``, ``"pose"`` or ``"pinhole"``
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
    # whether the rows are too few to move joint origins; `spatial_starts` finds out
    few: bool = False

    @property
    def outputs(self) -> int:
        """Number of outputs: 3 positions, 6 of a pose, 2 pixels."""
        return self.seen_as.outputs

    @property
    def camera(self) -> bool:
        """Whether a camera sees the arm, in pixels."""
        return self.outputs == 2

    @property
    def extents(self) -> Array:
        """Size of the workspace along each output [unit]; 1 rad for rotations."""
        out = np.full(self.outputs, self.extent)
        out[3:] = 1.0
        return out

    @cached_property
    def layout(self) -> SpatialLayout:
        """Where each parameter stands, and what it is."""
        weighted = len(self.chain.masses) > 0
        return spatial_layout(self.joint_names, self.chain_names, self.revolute, weighted)

    @property
    def units(self) -> Mapping[str, str]:
        """Units that depend on the sensor: a camera stands metres away."""
        return {"position": "m" if self.camera else self.unit}

    @cached_property
    def torque(self) -> float:
        """Largest torque [N m] of gravity on the first joint: that of the arm stretched."""
        away = np.linalg.norm(self.chain.centres - self.chain.points[0], axis=1)
        return max(float(self.chain.masses @ away * np.linalg.norm(self.gravity)), 1e-12)

    def loads(self, q: Array) -> Array:
        """Torques (m, n) of gravity on the chain's joints, as shares of the largest.

        Where nothing is known of its masses, there are none.
        """
        # a fit asks for the same rows again, and they do not depend on its parameters
        last = self._memory.get("loads")
        if last is None or last[0] is not q:
            loads = self.chain.torques(q, np.asarray(self.gravity)).T / self.torque
            last = self._memory["loads"] = (q, np.ascontiguousarray(loads))
        return last[1]

    def load_slopes(self, q: Array) -> Array:
        """Derivatives (m, dof, n) of the loads by the joint values."""
        slopes = self.chain.torque_slopes(q, np.asarray(self.gravity)) / self.torque
        return np.moveaxis(slopes, 0, 2)

    @cached_property
    def _memory(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def neutral(self) -> Array:
        """Parameters (d,) of the nominal arm in a sensor frame at its root."""
        beta = np.zeros(self.size)
        beta[self.groups["gain"]] = 1.0
        beta[self.groups["lens"]] = self.lens
        return beta

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof); a rotation is a rotation vector."""
        return self.seen(q, beta)[1].values

    derivative, predict_and_slope = by_parameters, by_joints

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        out = beta + delta
        # a sensor's step turns about the sensor's axes (on the left), the arm's about their own
        view = self.groups["view.rotation"]
        if delta[view].any():
            out[view] = compose(delta[view], beta[view])
        own = np.vstack([self.groups["tool.rotation"], self.layout.turns])
        if delta[own].any():
            out[own] = compose(beta[own], delta[own])
        return out

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs.

        Of a pose, the last three are the rotation vector, in the sensor's frame, that turns the
        predicted orientation into the observed one.
        """
        out = z - predicted
        if self.outputs == 6:
            seen, expected = exponential(z[:, 3:]), exponential(predicted[:, 3:])
            out[:, 3:] = logarithm(seen @ np.swapaxes(expected, 1, 2))
        return np.asarray(out)

    prior, members, words = priors.spatial_prior, priors.spatial_members, spatial_words

    def starts(self, q: Array, z: Array) -> Sequence[tuple[Structure, Array]]:
        """Candidate starts: structures with their parameters (d,)."""
        from .spatial_start import spatial_starts  # SciPy's linear algebra, which no query needs

        return spatial_starts(self, q, z)

    def with_view(self, view: str, **changes: Any) -> SpatialStructure:
        """Return the structure with another view."""
        return replace(self, view=view, **changes)

    def pose(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Position (n, 3) [m] and orientation (n, 3, 3) of the tip in the arm's root frame."""
        motion = move(self.chain, self.joint_values(q, beta), self.deviations(beta))
        # rows first and contiguous, or every product that follows would copy
        return np.ascontiguousarray(motion.position.T), np.moveaxis(motion.rotation, 2, 0).copy()

    def joint_values(self, q: Array, beta: Array) -> Array:
        """True values (m, n) of the chain's joints at logged values (n, dof) [rad or m]."""
        own = np.empty((self.dof, len(q)))
        for k in range(self.dof):
            own[k] = beta[self.groups["gain"][k]] * q[:, k] + beta[self.groups["offset"][k]]
            curve = self.groups[f"curve.{k}"]
            if len(curve) and beta[curve].any():
                own[k] += curve_value(q[:, k], beta[curve])
        values = self.chain.coupling @ own + self.chain.bias[:, None]
        elastic = beta[self.groups["elastic"]]
        if elastic.any():
            values = values + elastic[:, None] * self.loads(q)
        return np.asarray(values)

    def deviations(self, beta: Array) -> Deviations:
        """How the chain differs from its nominal one."""
        layout, groups = self.layout, self.groups
        parts = (layout.shifts, layout.turns, groups["tool"], groups["tool.rotation"])
        return Deviations(*(beta[index] for index in parts))

    def sensor(self, beta: Array) -> Placed:
        """The sensor: where it stands, its scale and its lens."""
        groups = self.groups
        scale = float(np.exp(beta[groups["view.scale"][0]]))
        return Placed(
            self.view,
            exponential(beta[groups["view.rotation"]]),
            beta[groups["view.shift"]],
            scale if self.camera else scale * self.metre,
            beta[groups["lens"]],
        )

    def seen(self, q: Array, beta: Array) -> tuple[Motion, View]:
        """Where the chain is at joint values (n, dof), and what the sensor sees of it."""
        motion = move(self.chain, self.joint_values(q, beta), self.deviations(beta))
        return motion, look(self.sensor(beta), motion.position, motion.rotation)


def structure_of(arm: Any, view: str = "rigid", **options: Any) -> SpatialStructure:
    """Return the structure of a `SpatialArm` and a view of it, its URDF being the prior.

    `options` are further attributes: unit, metre, extent, lens, lens_sd, gravity.
    """
    chain: SpatialChain = arm.chain
    names = []
    for i, leader in enumerate(chain.leaders):
        name = arm.joint_names[leader]
        names.append(name if name not in names else f"{name}.mimic{i}")
    options.setdefault("extent", max(chain.reach, 1e-9) * options.get("metre", 1.0))
    return SpatialStructure(
        chain, tuple(arm.joint_names), tuple(names), tuple(arm.revolute), view, **options
    )


def unknown_structure(
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    extent: float,
    unit: str = "m",
    metre: float = 1.0,
    simulated: bool = False,
) -> SpatialStructure:
    """Return the structure of a serial arm of which only its joints' names are known.

    joint_names, revolute : base to tip; whether each joint turns
    extent : size of the workspace along an output [unit]: the positions' rms spread
    unit : unit of positions
    metre : units of positions in one metre
    simulated : whether the rows are samples of a simulation
    """
    dof = len(joint_names)
    link = extent / metre / max(dof, 1)
    points = np.outer(np.arange(dof), (0.0, 0.0, link))
    chain = SpatialChain(
        axes=np.tile((0.0, 0.0, 1.0), (dof, 1)),
        points=points,
        tip=np.array([0.0, 0.0, dof * link]),
        rotation=np.eye(3),
        revolute=tuple(revolute),
        coupling=np.eye(dof),
        bias=np.zeros(dof),
    )
    names = tuple(joint_names)
    return SpatialStructure(
        chain, names, names, tuple(revolute), "base", unit=unit, metre=metre, extent=extent,
        informed=False, simulated=simulated,
    )  # fmt: skip
