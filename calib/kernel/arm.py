"""Any body as one chain of joints and one sensor: what the C source evaluates.

A planar arm is a chain of parallel axes.  Every sensor is a matrix, a shift and, where it divides
by a depth, a lens: a homography is a camera whose picture is the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.gravity import Loads
from ..arm.rotations import exponential
from ..arm.spatial_chain import (
    ChainState,
    Deviations,
    Links,
    SpatialChain,
    move,
)
from ..body.curves import HARMONICS
from ..body.loads import loads_of
from ..body.planar import PlanarLoads, PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..body.views import lens_slope, pixels
from ..common.arrays import Array, Index
from ..common.rows import row_lengths


@dataclass(frozen=True, eq=False)
class Sag:
    """How the joints of a chain bend under what they carry: ``e`` loads of ``p`` points."""

    loads: Loads
    elastic: Array  # (e,) [rad], of each load
    gravity: Array  # (3,), direction
    tilts: Array  # (2, 3), the ways in which its two angles move it

    @staticmethod
    def of(structure: SpatialStructure, beta: Array) -> Sag | None:
        """The sag of an arm in space at parameters (d,); None where its drawing has no loads."""
        if not structure.loads:
            return None
        blocks = [
            name
            for name in structure.loads
            if name == "elastic" or beta[structure.groups[name]].any()
        ]
        loads = Loads.together([structure.loads[name] for name in blocks])
        elastic = np.concatenate(
            [beta[structure.groups[name]] for name in blocks]
        )
        gravity = structure.gravity_at(beta)
        return Sag(loads, elastic, gravity, structure.tilts["gravity"])

    @staticmethod
    def in_plane(
        chain: SpatialChain, loads: PlanarLoads, elastic: Array
    ) -> Sag:
        """The sag of a planar arm whose gravity is unknown: moments of pairs of weights.

        Along the second axis a moment along a link pulls by the cosine of the link's direction, one
        across it by the sine.
        """
        logged = replace(chain, coupling=np.diag(loads.turns * 1.0))
        still = [0.0, 0.0, 0.0]
        ends = [[1.0, 0.0, 0.0], still, [0.0, -1.0, 0.0], still]
        links = np.repeat(loads.pairs[:, 1], 4)
        points = chain.points[links] + np.tile(ends, (len(loads.pairs), 1))
        weights = np.asarray(np.kron(np.eye(len(loads.joints)), [1.0, -1.0]))
        pairs = Loads(
            logged,
            loads.joints,
            weights,
            points,
            links,
        )
        along_second_axis = np.array([0.0, 1.0, 0.0])
        return Sag(
            pairs,
            elastic,
            gravity=along_second_axis,
            tilts=np.zeros((2, 3)),
        )

    @property
    def on_links(self) -> Array:
        """Mass and moment [kg, kg m] of each load on each link, (e, m, 4)."""
        return _on_links(self.loads)

    @property
    def spans(self) -> Index:
        """The joint that each load bends, the first and the last link that weigh on it, (e, 3)."""
        weighs = np.asarray(self.on_links.any(axis=2))
        first = weighs.argmax(axis=1)
        last = weighs.shape[1] - 1 - weighs[:, ::-1].argmax(axis=1)
        return np.column_stack([self.loads.joints, first, last])

    @property
    def bending(self) -> Array:
        """How much mass and moment of each link bend each joint, (m, m, 4)."""
        return _on_links(self._together)

    @cached_property
    def _together(self) -> Loads:
        """One load for each joint of the chain that bends it as all of them do."""
        loads = self.loads
        joints = np.arange(loads.chain.joints)
        weights = np.zeros((len(joints), loads.weights.shape[1]))
        bending = self.elastic[:, None] * loads.weights
        np.add.at(weights, loads.joints, bending)
        return replace(loads, joints=joints, weights=weights)

    def bends(self, q: Array) -> Array:
        """How much joints of the chain bend (m, n) at joint values (n, dof)."""
        return loads_of(self._together.levers(q), self.gravity)

    def derivatives(self, q: Array, chained: Array) -> tuple[Array, Array]:
        """How positions move with each load's elasticity (e, 3, n), and with gravity's (2, 3, n).

        chained : (m, 3, n), how they move with each joint of the chain
        """
        levers = self.loads.levers(q)
        bent = chained[self.loads.joints]
        by_elasticity = bent * loads_of(levers, self.gravity)[:, None]
        joints = self._together.levers(q)
        pulls = np.einsum("mgn,tg->tmn", joints, self.tilts)
        return by_elasticity, np.einsum("mkn,tmn->tkn", chained, pulls)


def _on_links(loads: Loads) -> Array:
    """Mass and moment [kg, kg m] of loads on each link, (e, m, 4).

    In the frame at the link's end, where the next joint or the tip is.
    """
    chain = loads.chain
    frames = Frames.of(chain, chain.nominal_links)
    ends = loads.links + 1
    arms = loads.points - chain.points[loads.links] - frames.strides[ends]
    moments = np.einsum("pij,pi->pj", frames.sides[ends], arms)
    masses = np.column_stack([np.ones(len(arms)), moments])
    link = np.arange(chain.joints)[:, None] == loads.links
    beyond = loads.weights * (loads.links >= loads.joints[:, None])
    return np.asarray(np.einsum("ep,mp,pk->emk", beyond, link, masses))


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of m joints, which move about or along their third axes, and of the tip."""

    axes: Array  # (m + 1, 3, 3), in the frames of the links
    sides: Array  # (m + 1, 3, 3), in the frame of the link before
    strides: Array  # (m + 1, 3) [m], to their origins, in the frame of the link before

    @staticmethod
    def of(chain: SpatialChain, links: Links) -> Frames:
        """The frames of a chain with its links."""
        place, rotation = links.tip
        least = np.argmin(np.abs(chain.axes), axis=1)
        first = np.cross(chain.axes, np.eye(3)[least])
        first /= row_lengths(first)[:, None]
        second = np.cross(chain.axes, first)
        frames = np.stack([first, second, chain.axes], axis=2)
        axes = np.concatenate([frames, np.eye(3)[None]])
        turned = np.concatenate([links.rotations, rotation[None]])
        strides = np.vstack([links.strides[:-1, :, 0], place])
        return Frames(axes, turned @ axes, strides)


@dataclass(frozen=True, eq=False)
class KernelArm:
    """A chain of m joints and what sees it, as plain numbers; dof joints are logged."""

    structure: PlanarStructure | SpatialStructure  # of the body
    beta: Array  # its parameters
    chain: SpatialChain
    deviations: Deviations
    # values of the chain's joints are mix q + bias, without what bends them
    mix: Array  # (m, dof)
    bias: Array  # (m,)
    view: Array  # (3, 3), the sensor sees view @ tip + shift
    shift: Array  # (3,)
    # (4, 3), axes of its root in the frame of poses, and its origin there [m]
    root: Array
    outputs: int  # coordinates of a position: 2 or 3
    # (4,), focal length, centre, k1; None where nothing is divided by a depth
    lens: Array | None
    curves: Array  # (dof, 96)
    sag: Sag | None = None

    @staticmethod
    def of(structure: Structure, beta: Array) -> KernelArm:
        """The arm of a body's structure at parameters (d,)."""
        if isinstance(structure, PlanarStructure):
            return _planar(structure, beta)
        assert isinstance(structure, SpatialStructure)  # noqa: S101
        return _spatial(structure, beta)

    @property
    def bends(self) -> bool:
        """Whether its joints have curves, or bend with their posture."""
        sags = self.sag is not None and self.sag.elastic.any()
        return bool(sags or self.curves.any())

    @property
    def drawn(self) -> KernelArm:
        """The arm at whose postures weights bend it; of an arm with a sag."""
        assert self.sag is not None  # noqa: S101
        chain = self.sag.loads.chain
        return replace(
            self,
            chain=chain,
            deviations=Deviations.none(chain.joints),
            mix=chain.coupling,
            bias=chain.bias,
            curves=np.zeros_like(self.curves),
            sag=None,
        )

    @cached_property
    def links(self) -> Links:
        """Its links as the body has them."""
        return Links.of(self.chain, self.deviations)

    @cached_property
    def frames(self) -> Frames:
        """The frames of its joints."""
        return Frames.of(self.chain, self.links)

    def joints(self, q: Array) -> Array:
        """Values (m, n) of the chain's joints."""
        return self.structure.joint_values(q, self.beta)

    def derivatives(self, q: Array) -> tuple[dict[str, Array], Array]:
        """How positions move with each part of it (k, m, n), and with joints (dof, m, n)."""
        motion = move(self.links, self.joints(q))
        chained = self.view @ motion.joints()[0]
        shifts = np.swapaxes(motion.frames, 1, 2)
        joints = np.tensordot(self.chain.coupling.T, chained, axes=1)
        parts = {
            "view": self._by_view(motion),
            "shift": self.view @ _along(self.frames.sides, shifts),
            "turn": self.view
            @ _along(self.frames.axes[:-1], motion.turns()[0]),
            "offset": joints,
            "gain": joints * q.T[:, None],
            "neighbour": joints[1:] * q.T[:-1, None],
        }
        if self.sag is not None:
            by_load, by_tilt = self.sag.derivatives(q, chained)
            parts["load"] = by_load
            parts["tilt"] = by_tilt
        moved = {
            name: part.reshape(-1, 3, len(q)) for name, part in parts.items()
        }
        if self.lens is None:
            size = self.outputs
            by_part = {name: part[:, :size] for name, part in moved.items()}
            return by_part, joints[:, :size]
        point = self.view @ motion.position + self.shift[:, None]
        sight = pixels(self.lens, point, np.eye(3))
        in_pixels = {name: sight.push(part) for name, part in moved.items()}
        in_pixels["lens"] = lens_slope(self.lens, point)
        return in_pixels, sight.push(joints)

    def _by_view(self, motion: ChainState) -> Array:
        """How points move with each number of the view's rows, (12, 3, n)."""
        outputs = np.eye(3)
        n = motion.position.shape[1]
        point = np.vstack([motion.position, np.ones((1, n))])
        moves = outputs[:, None, :, None] * point[:, None]
        return moves.reshape(12, 3, n)


def _along(axes: Array, moves: Array) -> Array:
    """How positions move by shifts or turns along axes (m, 3, 3), from those along x, y, z."""
    return np.asarray(np.einsum("mij,mikn->mjkn", axes, moves))


def _curves(structure: Structure, beta: Array) -> Array:
    """Curves (dof, 96) of all joints."""
    out = np.zeros((structure.dof, 2 * HARMONICS))
    for k in range(structure.dof):
        curve = structure.groups[f"curve.{k}"]
        if len(curve):
            out[k] = beta[curve]
    return out


def _spatial(structure: SpatialStructure, beta: Array) -> KernelArm:
    """An arm in space."""
    groups = structure.groups
    sensor = structure.sensor(beta)
    chain = structure.chain
    motors = np.diag(beta[groups["gain"]])
    motors += np.diag(beta[groups["coupling"]], -1)
    return KernelArm(
        structure=structure,
        beta=beta,
        chain=chain,
        deviations=structure.deviations(beta),
        mix=chain.coupling @ motors,
        bias=chain.bias + chain.coupling @ beta[groups["offset"]],
        view=sensor.matrix[:, :3],
        shift=sensor.shift,
        root=np.eye(4, 3),
        outputs=min(structure.outputs, 3),
        lens=sensor.lens,
        curves=_curves(structure, beta),
        sag=Sag.of(structure, beta),
    )


def _planar(structure: PlanarStructure, beta: Array) -> KernelArm:
    """A planar arm: axes along z, links along x; a slide's direction is turned by its offset."""
    groups = structure.groups
    dof = structure.dof
    revolute = np.asarray(structure.revolute)
    way = np.asarray(structure.signs, dtype=float)
    offset = beta[groups["offset"]]
    up = np.array([0.0, 0.0, 1.0])
    slant = np.where(revolute, 0.0, offset)
    # (dof, 3), of each link
    along = exponential(np.outer(slant, up))[:, :, 0]
    links = beta[groups["length"], None] * along
    ends = np.cumsum(links, axis=0)
    chain = SpatialChain(
        axes=np.where(revolute[:, None], up, along),
        points=np.vstack([np.zeros(3), ends[:-1]]),
        tip=ends[-1],
        rotation=np.eye(3),
        revolute=structure.revolute,
        coupling=np.eye(dof),
        bias=np.zeros(dof),
    )
    sensor = structure.sensor(beta)
    view = np.zeros((3, 4))
    size = len(sensor.matrix)
    view[:size, :2] = sensor.matrix[:, :2]
    view[:size, 3] = sensor.shift
    return KernelArm(
        structure=structure,
        beta=beta,
        chain=chain,
        deviations=Deviations.none(dof),
        mix=np.diag(beta[groups["gain"]] * way),
        bias=np.where(revolute, offset, 0.0),
        view=view[:, :3],
        shift=view[:, 3],
        root=np.eye(4, 3),
        outputs=2,
        lens=sensor.lens,
        curves=_curves(structure, beta),
        sag=Sag.in_plane(
            chain, structure.loads["elastic"], beta[groups["elastic"]]
        ),
    )
