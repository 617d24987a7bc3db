"""Derivatives of what a spatial body predicts: by its parameters, and by its joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arm.motion import Motion
from ..common.arrays import Array
from .curves import curve_slope, powers
from .derivative import Derivative, Waves
from .spatial_view import View
from .structure import Indices

if TYPE_CHECKING:
    from .spatial import SpatialStructure

_STILL = np.zeros((3, 1))


def by_parameters(
    structure: SpatialStructure, q: Array, beta: Array, active: Indices
) -> tuple[Array, Derivative]:
    """Outputs (n, m) and their derivative by some parameters (k,)."""
    motion, view = structure.seen(q, beta)
    n, outputs = view.values.shape
    groups, layout = structure.groups, structure.layout
    place = np.full(structure.size, -1)
    place[active] = np.arange(len(active))
    curves = [groups[f"curve.{k}"] for k in range(structure.dof)]
    bare = ~np.isin(active, np.concatenate(curves))
    columns = _Columns(n, outputs, structure.size, active[bare])
    waved: list[Waves] = []
    for axis in range(3):
        columns.put(groups["view.rotation"][axis], lambda a=axis: view.turned(a))
        columns.put(groups["view.shift"][axis], lambda a=axis: view.shifted(a))
        columns.put(groups["tool"][axis], lambda a=axis: view.push(motion.flange[:, a], _STILL))
        columns.put(
            groups["tool.rotation"][axis],
            lambda a=axis: view.push(np.zeros_like(motion.position), motion.rotation[:, a]),
        )
        for i in range(structure.chain.joints):
            columns.put(
                layout.shifts[i, axis],
                lambda i=i, a=axis: view.push(motion.frames[i][:, a], _STILL),
            )
            columns.put(layout.turns[i, axis], lambda i=i, a=axis: view.push(*motion.turn(i, a)))
    columns.put(groups["view.scale"][0], view.scaled)
    if structure.camera and columns.any(groups["lens"]):
        lens = view.refocused()
        for k, index in enumerate(groups["lens"]):
            columns.put(index, lambda k=k: lens[:, k])
    chained = _chained(structure, motion, view)
    loads = structure.loads.shares(q) if columns.any(groups["elastic"]) else np.zeros((0, len(q)))
    for i, index in enumerate(groups["elastic"]):
        columns.put(index, lambda i=i: chained[i] * loads[i])
    for k in range(structure.dof):
        own = np.tensordot(structure.chain.coupling[:, k], chained, axes=1)
        columns.put(groups["offset"][k], lambda own=own: own)
        columns.put(groups["gain"][k], lambda own=own, k=k: own * q[:, k])
        stands = place[curves[k]]
        if not (stands >= 0).any():
            continue
        chosen, waves = np.flatnonzero(stands >= 0), powers(q[:, k])
        factors = np.concatenate([waves.real, waves.imag], axis=1)
        gaps = np.flatnonzero(np.diff(stands[chosen]) != 1) + 1
        for run in np.split(chosen, gaps):  # of harmonics in a row, mostly all of them
            at = slice(int(stands[run[0]]), int(stands[run[-1]]) + 1)
            waved.append(Waves(at, np.ascontiguousarray(own.T), factors[:, run]))
    return view.values, Derivative(columns.out, np.flatnonzero(bare), tuple(waved))


def by_joints(structure: SpatialStructure, q: Array, beta: Array) -> tuple[Array, Array]:
    """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
    motion, view = structure.seen(q, beta)
    chained = _chained(structure, motion, view)
    out = np.empty((len(q), structure.outputs, structure.dof))
    elastic = beta[structure.groups["elastic"]]
    bent = None
    if elastic.any():
        bent = elastic[:, None, None] * structure.loads.slopes(q)
    for k in range(structure.dof):
        rate = beta[structure.groups["gain"][k]] + np.zeros(len(q))
        curve = structure.groups[f"curve.{k}"]
        if len(curve):
            rate = rate + curve_slope(q[:, k], beta[curve])
        moved = np.tensordot(structure.chain.coupling[:, k], chained, axes=1) * rate
        if bent is not None:
            moved = moved + np.einsum("imn,in->mn", chained, bent[:, k])
        out[:, :, k] = moved.T
    return view.values, out


def _chained(structure: SpatialStructure, motion: Motion, view: View) -> Array:
    """How outputs move with each joint of the chain: (m, outputs, n)."""
    turning = structure.chain.revolute
    return np.stack([view.push(*motion.joint(i, turns)) for i, turns in enumerate(turning)])


class _Columns:
    """Derivatives that are asked for, each computed only where it is wanted."""

    def __init__(self, n: int, outputs: int, size: int, wanted: Indices) -> None:
        self.out = np.zeros((n, outputs, len(wanted)))
        self._place = np.full(size, -1)
        self._place[wanted] = np.arange(len(wanted))

    def any(self, indices: Indices) -> bool:
        """Whether one of some parameters is asked for."""
        return bool((self._place[indices] >= 0).any())

    def put(self, index: int, column: Any) -> None:
        """Set the column (outputs, n) of a parameter, if it is asked for."""
        place = self._place[index]
        if place >= 0:
            self.out[:, :, place] = column().T
