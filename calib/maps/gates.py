"""Gates: where a defect ends within the reach of a node's local model.

Rows tell the edge of a sharp defect to about their distance, but a polynomial that follows the
defect swings in the gaps between the calm rows beside it.  So a node may have a gate, a half-space
beyond which it says nothing (the gating network of a mixture of experts, Jacobs et al. 1991).  One
line through the rows on both sides of an edge is known better than any of the gaps along it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .map import Map, nearest_points

_MOST = 200  # rows around a node that tell where a defect ends
_FEWEST = 30  # of them at least, also beyond its cell
_WIDE = 2.0  # spacings within which they lie: where the node speaks, at most
_WRONG, _CALM = 12, 4  # rows of either kind that a gate is told by at least
_DIRECTIONS = 32  # that are tried
_SURE = 8.0  # log-likelihood by which a gate has to explain the rows better than none
_ROW = 40.0  # of one row at most: an outlier is no defect
_SOFT = 0.05  # spacings over which a gate opens at least
_SCALES = 4  # variances between that of noise and that of the wrong rows
_AT_ONCE = 200  # nodes, so that the projections stay within some megabytes


def find_gates(
    motor: Map, u: Array, square: Array, calm: NDArray[np.bool_], outputs: int
) -> Array | None:
    """The half-space of each node in which its rows are wrong, (nodes, d + 1), None without any.

    A row is wrong with a variance between noise's and that of the wrong ones around its node, or
    calm with that of noise.
    The gate maximises the sum of the log-likelihood ratios of the rows that it lets through.

    u : (n, d), rows in the unit box
    square, calm : (n,), squared held-out residuals, and where the smooth part is right
    outputs : coordinates of a residual
    Returns a and b of each node's factor, see :func:`opening`; 0 and 1 where it is open everywhere.
    """
    dof = u.shape[1]
    distance, index = nearest_points(u, motor.scale, motor.units, _MOST)
    used = distance <= _WIDE * motor.spacings[:, None]
    used[:, :_FEWEST] = True
    wrong = used & ~calm[index]
    count = wrong.sum(axis=1)
    edge = np.flatnonzero((count >= _WRONG) & ((used & calm[index]).sum(axis=1) >= _CALM))
    if not len(edge):
        return None
    used, index, r2 = used[edge], index[edge], square[index[edge]]
    noise = max(float(square[calm].mean()) / outputs, 1e-300)
    mean = (r2 * wrong[edge]).sum(axis=1) / count[edge] / outputs
    ratio = np.maximum(mean / noise - 1.0, 1.0)[:, None]  # of the variances, less one
    # a smooth defect fades towards its edge: with the variance of its middle alone, a residual of
    # three standard deviations there would be called calm, so several variances share the prior
    several = ratio[..., None] ** np.linspace(0.0, 1.0, _SCALES)
    each = (r2 / noise)[..., None] * several / (1.0 + several) - outputs * np.log1p(several)
    gain = np.logaddexp.reduce(0.5 * each, axis=-1) - np.log(_SCALES)
    gain = np.where(used, np.clip(gain, -_ROW, _ROW), 0.0)

    directions = _directions(dof)
    gates = np.zeros((motor.size, dof + 1))
    gates[:, -1] = 1.0
    for first in range(0, len(edge), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        nodes = edge[part]
        gap = motor.scale.difference(u[index[part]], motor.units[nodes, None])
        along = np.where(used[part, :, None], gap @ directions.T, -np.inf)
        order = np.argsort(-along, axis=1)
        along = np.take_along_axis(along, order, axis=1)
        # [node, m, direction]: the evidence of a gate that lets the first m + 1 rows through
        kept = np.cumsum(np.take_along_axis(gain[part, :, None], order, axis=1), axis=1)
        kept = np.where(np.isfinite(along[:, 1:]), kept[:, :-1], -np.inf)
        best = kept.reshape(len(nodes), -1).argmax(axis=1)
        row, way = np.divmod(best, len(directions))
        each = np.arange(len(nodes))
        won = kept[each, row, way] - np.maximum(gain[part].sum(axis=1), 0.0)
        last, beyond = along[each, row, way], along[each, row + 1, way]
        width = np.maximum(last - beyond, _SOFT * motor.spacings[nodes])
        normal = directions[way] / width[:, None]
        found = np.column_stack([normal, 0.5 - 0.5 * (last + beyond) / width])
        gates[nodes] = np.where((won >= _SURE)[:, None], found, gates[nodes])
    return gates


def opening(gates: Array, gap: Array) -> Array:
    """How far gates (..., d + 1) are open, 0 to 1, at the offsets (..., d) from their nodes.

    t^2 (3 - 2 t) with t = a . gap + b within 0 and 1.
    """
    t = np.clip(np.einsum("...d,...d->...", gates[..., :-1], gap) + gates[..., -1], 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _directions(dof: int) -> Array:
    """Unit vectors (k, dof) all around; even ones in one and two dimensions."""
    if dof == 1:
        return np.array([[1.0], [-1.0]])
    if dof == 2:
        angle = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    drawn = np.random.default_rng(0).standard_normal((2 * _DIRECTIONS, dof))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))
