"""What a sensor sees of a planar arm: rotation, scale, shear, shift, tilt, lens.

Equation 6 of :mod:`calib.body.planar`::

    y = A p / (1 + h.p),  A = exp(s) R(alpha) [[1+a, b], [b, 1-a]] mirror
    u = (y + t - middle) / size - c,  z = y + t + size b(k, |u|^2) u

The lens is radial with a free centre `c`; with ``k = 0`` it does nothing and its centre is unknown.
Its law `b` is that of the view (:mod:`calib.body.views`), as a rule k |u|^2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .structure import Indices

if TYPE_CHECKING:
    from .planar import PlanarStructure

_Complex = NDArray[np.complex128]


def view_rotation(beta: Array) -> Array:
    """Rotation (2, 2) of the view."""
    c, s = np.cos(beta[0]), np.sin(beta[0])
    return np.array([[c, -s], [s, c]])


def matrix(beta: Array, mirror: int) -> Array:
    """Linear part A (2, 2) of the view, with the mirror."""
    a, b = beta[2], beta[3]
    shear = np.array([[1 + a, b], [b, 1 - a]])
    out: Array = np.exp(beta[1]) * view_rotation(beta) @ shear @ np.diag([1.0, float(mirror)])
    return out


def seen(structure: PlanarStructure, p: _Complex, beta: Array) -> Array:
    """Sensor positions (n, 2) of tips (n,) given as complex numbers."""
    x = np.stack([p.real, p.imag], axis=1)
    y = x @ matrix(beta, structure.mirror).T
    if beta[6] or beta[7]:
        y /= (1 + x @ beta[6:8])[:, None]
    z = y + beta[4:6]
    return _through_lens(structure, z, beta) if beta[8] else z


def _from_centre(structure: PlanarStructure, z: Array, beta: Array) -> Array:
    """Positions (n, 2) from the lens's centre, in its own size."""
    return np.asarray((z - structure.centre) / structure.size_of_lens - beta[9:11])


def _through_lens(structure: PlanarStructure, z: Array, beta: Array) -> Array:
    """Positions (n, 2) as the lens shows them."""
    u = _from_centre(structure, z, beta)
    r2 = (u**2).sum(axis=1, keepdims=True)
    slope, ratio, _ = structure.seen_as.bend(float(beta[8]), r2)
    return np.asarray(z + structure.size_of_lens * slope * ratio * u)


def columns(
    structure: PlanarStructure, p: _Complex, beta: Array, place: Indices, k: int
) -> tuple[Array, Array, Array]:
    """Positions, their derivative (n, 2, 2) by the tip, and (n, 2, k) with the view's columns.

    p : (n,) complex array, tips
    beta : (d,)
    place : (d,), column of each parameter, -1 where it has none
    k : number of columns
    """
    n = len(p)
    out = np.zeros((n, 2, k))
    x = np.stack([p.real, p.imag], axis=1)
    linear = matrix(beta, structure.mirror)
    depth = 1 + x @ beta[6:8]
    y = (x @ linear.T) / depth[:, None]
    view = (linear - y[:, :, None] * beta[6:8]) / depth[:, None, None]
    if not k and not beta[8]:
        return y + beta[4:6], view, out
    mirrored = x * [1.0, float(structure.mirror)]
    turn = np.exp(beta[1]) * view_rotation(beta)
    one, zero = np.ones(n), np.zeros(n)
    before = {
        0: np.stack([-y[:, 1], y[:, 0]], axis=1),
        1: y,
        2: mirrored @ (turn @ np.diag([1.0, -1.0])).T / depth[:, None],
        3: mirrored[:, ::-1] @ turn.T / depth[:, None],
        4: np.stack([one, zero], axis=1),
        5: np.stack([zero, one], axis=1),
        6: -y * (x[:, :1] / depth[:, None]),
        7: -y * (x[:, 1:] / depth[:, None]),
    }
    z = y + beta[4:6]
    u = _from_centre(structure, z, beta)
    r2 = (u**2).sum(axis=1)
    slope, ratio, by_k = structure.seen_as.bend(float(beta[8]), r2)
    slope = np.reshape(slope, (-1, 1, 1))
    grow = ratio[:, None, None] * np.eye(2) + 2 * u[:, :, None] * u[:, None, :]
    lens = np.eye(2) + slope * grow
    bent = bool(beta[8])
    for index, column in before.items():
        if place[index] >= 0:
            out[:, :, place[index]] = np.einsum("nij,nj->ni", lens, column) if bent else column
    size = structure.size_of_lens
    if place[8] >= 0:
        out[:, :, place[8]] = size * u * by_k[:, None]
    for axis in range(2):
        if place[9 + axis] >= 0:
            out[:, :, place[9 + axis]] = (-size * slope * grow)[:, :, axis]
    z = _through_lens(structure, z, beta) if bent else z
    return z, lens @ view if bent else view, out
