"""Any body as one chain of joints and one sensor: what the C source evaluates.

A planar arm is a chain of parallel axes.  Every sensor is a matrix, a shift and, where it divides
by a depth, a lens: a homography is a camera whose picture is the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arm.rotations import exponential
from ..arm.spatial_chain import Placements, SpatialChain
from ..body.curves import HARMONICS, curve_value
from ..body.spatial_view import LEAST_DEPTH
from ..common.arrays import Array


@dataclass(frozen=True, eq=False)
class KernelArm:
    """A chain and what sees it, as plain numbers; m joints of the chain, dof logged ones."""

    bends: Array  # (m,), 1 of joints that turn, 0 of those that slide
    axis: Array  # (m, 3), unit axes in the joints' frames
    links: Placements  # from joint to joint, as the body has them
    coupling: Array  # (m, dof), by how much each joint follows the logged ones
    bias: Array  # (m,)
    gain: Array  # (dof,)
    offset: Array  # (dof,)
    view: Array  # (3, 3), the sensor sees view @ tip + shift
    shift: Array  # (3,)
    aim: Array  # (3, 3), orientation of the sensor
    outputs: int  # coordinates of a position: 2 or 3
    lens: Array  # (4,), focal length, centre, k1
    nearest: float = -1e300  # least depth
    projective: bool = False  # whether what is seen is divided by its depth
    curves: Array = field(default_factory=lambda: np.zeros((0, 2 * HARMONICS)))  # (dof, 96)
    # (dof, dof) each, cosines and sines of the summed angles up to joint k that bend joint i
    flex: Array | None = None
    way: Array = field(default_factory=lambda: np.zeros(0))  # (dof,), sense of joints that turn
    bending: Array = field(default_factory=lambda: np.zeros(0))  # (m,), by gravity's torques
    loaded: SpatialChain | None = None  # the drawing, by whose masses gravity bends
    gravity: Array = field(default_factory=lambda: np.zeros(3))  # per largest torque

    @staticmethod
    def of(structure: Any, beta: Array) -> KernelArm:
        """The arm of a body's structure at parameters (d,)."""
        return (_planar if structure.kind == "planar" else _spatial)(structure, beta)

    def loads(self, q: Array) -> Array:
        """Shares (m, n) of the largest torque of gravity at joint values (n, dof)."""
        assert self.loaded is not None  # noqa: S101
        return np.asarray(self.loaded.torques(q, self.gravity).T)

    def joints(self, q: Array) -> Array:
        """Values (m, n) of the chain's joints."""
        own = self.gain[:, None] * q.T + self.offset[:, None]
        for k, curve in enumerate(self.curves):
            own[k] += curve_value(q[:, k], curve)
        if self.flex is not None:
            psi = np.cumsum(self.way * q, axis=1).T
            own += self.flex[0] @ np.cos(psi) + self.flex[1] @ np.sin(psi)
        values = self.coupling @ own + self.bias[:, None]
        return values + self.bending[:, None] * self.loads(q) if len(self.bending) else values

    def derivatives(self, q: Array) -> tuple[Array, Array]:
        """How positions (m, n) move: with whatever may be off (D, m, n), with joints (dof, m, n).

        The same as `calib_derivatives` of the C source, in the same order.
        """
        n, values = len(q), self.joints(q)
        r, p = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        before, after, origins, axes = [], [], [], []
        for i, turns in enumerate(self.bends):
            p = p + r @ self.links.strides[i]
            before.append(r)
            r = r @ self.links.turns[i]
            after.append(r)
            axes.append(r @ self.axis[i])
            origins.append(p)
            if turns:
                r = r @ exponential(values[i][:, None] * self.axis[i])
            else:
                p = p + values[i][:, None] * axes[-1]
        before.append(r)
        p = p + r @ self.links.tip
        seen, still = self.view @ p.T + self.shift[:, None], np.zeros((3, n))
        linear = [np.where(np.arange(3)[:, None] == k, c, still) for k in range(3) for c in p.T]
        shifts = [np.where(np.arange(3)[:, None] == k, 1.0, still) for k in range(3)]
        moved = [self.view @ f[:, :, a].T for f in before for a in range(3)]
        turned, chained = [], []
        for i, turns in enumerate(self.bends):
            arrow = p - origins[i]
            turned += [self.view @ np.cross(after[i][:, :, a], arrow).T for a in range(3)]
            chained.append(self.view @ (np.cross(axes[i], arrow) if turns else axes[i]).T)
        own = np.tensordot(self.coupling.T, np.stack(chained), axes=1)
        parts = [linear, shifts, moved, turned, own, own * q.T[:, None]]
        if self.loaded is not None:
            parts.append(np.stack(chained) * self.loads(q)[:, None])
        if self.flex is not None:
            psi = np.cumsum(self.way * q, axis=1).T
            each = [(k, i) for k in range(len(psi)) for i in range(k + 1)]
            parts.append([own[i] * wave(psi[k]) for k, i in each for wave in (np.cos, np.sin)])
        geometry = np.concatenate([np.asarray(part) for part in parts])
        if not self.projective:
            return geometry[:, : self.outputs], own[:, : self.outputs]
        depth, f = np.maximum(seen[2], self.nearest), self.lens[0]
        u = seen[:2] / depth
        r2 = (u**2).sum(axis=0)
        slope = np.empty((2, 3, n))
        for a in range(2):
            for b in range(2):
                bent = 1.0 + self.lens[3] * r2 if a == b else 0.0
                slope[a, b] = f * (bent + 2.0 * self.lens[3] * u[a] * u[b]) / depth
        slope[:, 2] = -(slope[:, 0] * u[0] + slope[:, 1] * u[1])
        lens = np.zeros((4, 2, n))
        lens[0], lens[3] = u * (1.0 + self.lens[3] * r2), f * u * r2
        lens[1, 0] = lens[2, 1] = 1.0
        geometry, own = (np.einsum("abn,dbn->dan", slope, part) for part in (geometry, own))
        return np.concatenate([geometry, lens]), own


def _curves(structure: Any, beta: Array) -> Array:
    """Curves (dof, 96) of all joints; (0, 96) where there are none."""
    out = np.zeros((structure.dof, 2 * HARMONICS))
    for k in range(structure.dof):
        own = structure.groups.get(f"curve.{k}", ())
        if len(own):
            out[k] = beta[own]
    return out if out.any() else out[:0]


def _spatial(structure: Any, beta: Array) -> KernelArm:
    """An arm in space."""
    chain, groups, sensor = structure.chain, structure.groups, structure.sensor(beta)
    elastic = beta[groups["elastic"]]
    return KernelArm(
        np.asarray(chain.revolute, dtype=float), chain.axes,
        chain.placements(structure.deviations(beta)), chain.coupling, chain.bias,
        beta[groups["gain"]], beta[groups["offset"]], sensor.scale * sensor.rotation,
        sensor.shift, sensor.rotation, min(structure.outputs, 3), sensor.lens,
        LEAST_DEPTH, structure.outputs == 2, _curves(structure, beta),
        bending=elastic, loaded=chain if len(elastic) else None,
        gravity=np.asarray(structure.gravity) / structure.torque if len(elastic) else np.zeros(3),
    )  # fmt: skip


def _planar(structure: Any, beta: Array) -> KernelArm:
    """A planar arm: axes along z, links along x; a slide's direction is turned there and back."""
    groups, dof = structure.groups, structure.dof
    turns, way = np.asarray(structure.revolute), np.asarray(structure.signs, dtype=float)
    part = {name: beta[groups[name]] for name in ("length", "offset", "gain")}
    axis = np.where(turns[:, None], (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    about = exponential(np.outer(np.where(turns, 0.0, part["offset"]), (0.0, 0.0, 1.0)))
    back = np.concatenate([np.eye(3)[None], np.swapaxes(about, 1, 2)])
    strides = np.zeros((dof + 1, 3))
    strides[1:, 0] = part["length"]
    links = Placements(strides[:-1], back[:-1] @ about, strides[-1], back[-1])
    elastic = beta[groups["elastic"]] if "elastic" in groups else np.zeros(0)
    flex = np.zeros((2, dof, dof))
    places = [(i, k) for i in range(dof) for k in range(i, dof) if turns[i] and turns[k]]
    for (i, k), pair in zip(places, elastic.reshape(-1, 2), strict=False):
        flex[:, i, k] = pair
    a, b = beta[groups["view.shear"]]
    (turn,), (scale,) = beta[groups["view.rotation"]], beta[groups["view.scale"]]
    linear = np.exp(scale) * exponential(np.array([0.0, 0.0, turn]))
    linear[:2, :2] = linear[:2, :2] @ [[1 + a, b], [b, 1 - a]] @ np.diag([1.0, structure.mirror])
    shift, tilt = np.append(beta[groups["view.shift"]], 0.0), beta[groups["view.tilt"]]
    lens = beta[groups["lens"]]
    projective = bool(tilt.any() or lens[0]) or structure.view == "homography"
    focal = np.array([1.0, 0.0, 0.0, 0.0])
    if projective:  # the picture's plane before a camera whose lens has its own centre and size
        size = 1.5 * structure.extent
        centre = np.asarray(structure.centre) + size * lens[1:]
        focal = np.array([size, *centre, lens[0]])
        start = (shift[:2] - centre) / size
        linear = linear / size
        linear[2] = *tilt, 0.0
        linear[:2] += np.outer(start, linear[2])
        shift = np.append(start, 1.0)
    return KernelArm(
        turns.astype(float), axis, links, np.eye(dof), np.zeros(dof),
        part["gain"] * way * np.where(turns, 1.0, structure.slide),
        np.where(turns, part["offset"], 0.0), linear, shift, np.eye(3), 2, focal,
        projective=projective, curves=_curves(structure, beta), flex=flex,
        way=np.where(turns, way, 0.0),
    )  # fmt: skip
