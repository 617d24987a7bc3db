"""Derivatives of what a spatial body predicts: by its parameters, and by its joints."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

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
    groups, layout, chain = structure.groups, structure.layout, structure.chain
    place, wanted = np.full((2, structure.size), -1)
    place[active] = np.arange(len(active))
    curves = [groups[f"curve.{k}"] for k in range(structure.dof)]
    bare = np.flatnonzero(~np.isin(active, np.concatenate(curves)))
    wanted[active[bare]] = np.arange(len(bare))
    out = np.zeros((n, outputs, len(bare)))

    def put(indices: Indices, columns: Callable[[], Array]) -> None:
        """Set the columns (..., outputs, n) of parameters, if one of them is asked for."""
        stands = wanted[indices.ravel()]
        if (stands >= 0).any():
            found = columns().reshape(len(stands), outputs, n)
            out[:, :, stands[stands >= 0]] = found[stands >= 0].transpose(2, 1, 0)

    put(groups["view.rotation"], view.turned)
    put(groups["view.shift"], view.shifted)
    put(groups["view.scale"], view.scaled)
    if structure.camera:
        put(groups["lens"], view.refocused)
    put(groups["tool"], lambda: view.push(_axes(motion.flange), _STILL))
    put(
        groups["tool.rotation"],
        lambda: view.push(np.zeros((3, *motion.position.shape)), _axes(motion.rotation)),
    )
    put(layout.shifts, lambda: view.push(_axes(np.stack(motion.frames[:-1])), _STILL))
    put(layout.turns, lambda: view.push(*motion.turns()))
    chained = _chained(structure, motion, view)
    put(groups["elastic"], lambda: chained * structure.loads(q)[:, None])
    led = np.tensordot(chain.coupling.T, chained, axes=1)
    put(groups["offset"], lambda: led)
    put(groups["gain"], lambda: led * q.T[:, None])
    waved: list[Waves] = []
    for k, curve in enumerate(curves):
        stands = place[curve]
        if not (stands >= 0).any():
            continue
        chosen, waves = np.flatnonzero(stands >= 0), powers(q[:, k])
        factors = np.concatenate([waves.real, waves.imag], axis=1)
        gaps = np.flatnonzero(np.diff(stands[chosen]) != 1) + 1
        for run in np.split(chosen, gaps):  # of harmonics in a row, mostly all of them
            at = slice(int(stands[run[0]]), int(stands[run[-1]]) + 1)
            waved.append(Waves(at, np.ascontiguousarray(led[k].T), factors[:, run]))
    return view.values, Derivative(out, bare, tuple(waved))


def _axes(rotation: Array) -> Array:
    """Axes (..., 3, 3, n) of frames (..., 3, 3, n): their columns first."""
    return np.swapaxes(rotation, -3, -2)


def by_joints(structure: SpatialStructure, q: Array, beta: Array) -> tuple[Array, Array]:
    """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
    motion, view = structure.seen(q, beta)
    chained = _chained(structure, motion, view)
    led = np.tensordot(structure.chain.coupling.T, chained, axes=1)
    elastic = beta[structure.groups["elastic"]]
    bent = elastic[:, None, None] * structure.load_slopes(q) if elastic.any() else None
    out = np.empty((len(q), structure.outputs, structure.dof))
    for k, gain in enumerate(beta[structure.groups["gain"]]):
        curve = structure.groups[f"curve.{k}"]
        moved = led[k] * (gain + (curve_slope(q[:, k], beta[curve]) if len(curve) else 0.0))
        if bent is not None:
            moved = moved + np.einsum("imn,in->mn", chained, bent[:, k])
        out[:, :, k] = moved.T
    return view.values, out


def _chained(structure: SpatialStructure, motion: Motion, view: View) -> Array:
    """How outputs move with each joint of the chain: (m, outputs, n)."""
    turning = structure.chain.revolute
    return np.stack([view.push(*motion.joint(i, turns)) for i, turns in enumerate(turning)])
