"""Misfit: where a smooth model of the samples is wrong, by its held-out residuals."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from ..common.scale import Scale
from .map import nearest_points

_AROUND = 30  # rows whose residuals are averaged
_CHANCE = 4.0  # standard errors by which a mean square must exceed the common one
_FEWEST = 5  # rows that tell a mean
_SPREADS = 6.0  # standard deviations of the calm mean squares, the same
_ROUNDING = 1e-9  # share of the extent that is no residual
_MANY = 20_000  # rows that are averaged over; more tell no more


def misfit(scale: Scale, u: Array, held: Array, extent: float, at: Array) -> Array | None:
    """Mean square (k,) of held-out residuals around points beyond noise, None where all is noise.

    The median over the samples is taken for the noise and subtracted.  A mean square that exceeds
    it by no more than chance counts as zero, so that noise draws no nodes.

    u, held : (n, dof), (n, m) [unit], joints in the unit box, and what a smooth model that has not
        seen the row leaves over
    extent : [unit], diagonal of the workspace
    at : (k, dof), the points, in the unit box: what a map will learn from
    """
    floor = (_ROUNDING * extent) ** 2
    square = np.maximum(np.einsum("no,no->n", held, held), floor)
    k = min(_AROUND, len(u) // 4)
    if k < _FEWEST or square.mean() <= 2.0 * floor:
        return None
    some = slice(None, None, -(-len(u) // _MANY))
    seen, square = u[some], square[some]

    def around(points: Array) -> Array:
        index = nearest_points(seen, scale, points, k)[1]
        # without the largest: an outlier is no misfit
        return np.asarray(np.sort(square[index], axis=1)[:, : k - k // 5].mean(axis=1))

    own = around(seen)
    noise = float(np.median(own))
    # a mean of o k squares of noise is noise (1 +- sqrt(2 / (o k)))
    chance = _CHANCE * np.sqrt(2.0 / (held.shape[1] * k))
    # repeated rows tell less than their number: the calm half shows how much
    spread = noise - float(np.quantile(own, 0.16))
    least = noise + max(noise * chance, _SPREADS * spread)
    if np.count_nonzero(own > least) <= k:
        return None
    here = own if at is u and len(own) == len(u) else around(at)
    return np.where(here > least, here - noise, 0.0)
