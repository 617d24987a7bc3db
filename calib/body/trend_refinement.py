"""Refining: what all rows of a long log say of a trend that was fitted to some of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale
from .trend import Trend

Array = NDArray[np.float64]

_PIECE = 4096  # rows whose functions are held at once
_RIDGE = 1e-9  # of the mean power of a function: what no row tells stays as it was


@dataclass(frozen=True)
class Refined:
    """A trend that all rows have had their say in.

    Attributes
    ----------
    trend : Trend
    rows, left_out : int
        Rows that it rests on, and rows that were too far off to be believed.
    """

    trend: Trend
    rows: int
    left_out: int


def refine(
    trend: Trend, scale: Scale, batches: Iterable[tuple[Array, Array]], limit: float
) -> Refined:
    """Correct a trend by the least squares of what it leaves over of all rows.

    The normal equations are summed up piece by piece, so that the error of a trend that
    noise alone keeps off goes on falling with the root of the number of rows, whatever
    the memory. They are those of the correction, which is small: their rounding is too.

    Parameters
    ----------
    trend : Trend
        Fitted to some of the rows.
    scale : Scale
        Range of the joints.
    batches : iterable of ((n, dof) array, (n, 2) array)
        Joint values [rad or m] and positions. The sums do not depend on their lengths.
    limit : float [unit]
        Rows further from the trend are left out.
    """
    terms = trend.terms
    gram, moment = np.zeros((terms, terms)), np.zeros((terms, 2))
    rows = left_out = 0
    for q, x in _pieces(batches, _PIECE):
        u = scale.to_unit(q)
        features = trend.basis.values(u)
        residual = x - features @ trend.coefficients
        good = np.linalg.norm(residual, axis=1) <= limit
        if not good.all():
            features, residual = features[good], residual[good]
        gram += features.T @ features
        moment += features.T @ residual
        rows += len(residual)
        left_out += len(q) - len(residual)
    if not rows:
        return Refined(trend, 0, left_out)
    diagonal = np.einsum("ii->i", gram)
    diagonal += _RIDGE * diagonal.mean()
    correction = np.linalg.solve(gram, moment)
    return Refined(replace(trend, coefficients=trend.coefficients + correction), rows, left_out)


def _pieces(batches: Iterable[tuple[Array, Array]], size: int) -> Iterator[tuple[Array, Array]]:
    """Yield the rows of all batches in pieces of the same length, but for the last."""
    held: list[tuple[Array, Array]] = []
    count = 0
    for q, x in batches:
        held.append((q, x))
        count += len(q)
        if count < size:
            continue
        q, x = (np.concatenate(part) for part in zip(*held, strict=True))
        whole = count - count % size
        for first in range(0, whole, size):
            yield q[first : first + size], x[first : first + size]
        held, count = [(q[whole:], x[whole:])], count - whole
    if count:
        q, x = (np.concatenate(part) for part in zip(*held, strict=True))
        yield q, x
