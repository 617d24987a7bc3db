"""Screening: rows of a log that contradict their neighbours, before anything learns from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..body.basis import Basis, largest_harmonic
from ..common.arrays import Array
from ..common.robust import robust_solve
from ..common.scale import Scale
from ..maps.map import search_tree
from ..samples.samples import Samples

_GROSS = 10.0  # medians of a residual beyond which a row is suspect
_SPREAD = 4.0  # and beyond so many times what seven in ten rows stay below
_FLOOR = 1e-4  # share of the extent that is no gross error
_AROUND = 15  # neighbours that a suspect row is compared with
_NEAR = 2.5  # times as far as usual; in a corner of the range neighbours are twice as far
_APART = 10.0  # times their own scatter by which it has to differ from them
_MOST = 0.25  # share of the rows that can be wrong; beyond it the fit is
_FITTED = 1500  # rows that a robust fit rests on
_TERMS = 90  # functions of a robust fit beyond those of a rigid chain
_PER_TERM = (5, 10)  # rows for each function of a rigid chain, of the others
_CHUNK = 50_000  # rows whose functions are held at once


def screen(samples: Samples) -> tuple[NDArray[np.bool_], list[str]]:
    """Find the rows whose position is grossly wrong.

    A row is left out if it is far from a robust fit of smooth functions of the joints, by
    the standard of all rows, and if its residual is also far from those of the rows around
    it, by their own standard: a misfit of the functions, or a corner where the sensor is
    worse, concerns neighbours alike. A row that has no neighbours contradicts none.

    samples : a log. Where the rows are too few to fit all that a chain of rigid links can do (45
        for two joints, 135 for three) nothing is left out.
    Returns kept : (n,), False for a gross outlier
    Returns notes : what the user should be told
    """
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    u, x = scale.to_unit(samples.q), samples.x
    kept = np.ones(len(u), dtype=bool)
    residual = _residual(scale, samples.revolute, u, x)
    if residual is None:
        return kept, []
    size = np.linalg.norm(residual, axis=1)
    low, high = np.quantile(x, (0.05, 0.95), axis=0)
    limit = max(
        _GROSS * float(np.median(size)),
        _SPREAD * float(np.quantile(size, 0.7)),
        _FLOOR * float(np.linalg.norm(high - low)),
    )
    suspects = np.flatnonzero(size > limit)
    if not len(suspects):
        return kept, []
    around = min(_AROUND, len(u) - 1)
    tree = search_tree(u, scale)
    some = np.linspace(0, len(u) - 1, min(len(u), _FITTED)).astype(np.intp)
    usual = float(np.median(tree.query(u[some], k=[around + 1])[0]))
    reach, near = tree.query(u[suspects], k=np.arange(1, around + 2))
    close = np.asarray(reach)[:, -1] <= _NEAR * usual
    suspects, near = suspects[close], np.asarray(near, dtype=np.intp)[close]
    if not len(suspects):
        return kept, []
    others = residual[near]
    # a row is no neighbour of its own, wherever ties have put it
    others[near == suspects[:, None]] = np.nan
    middle = np.nanmedian(others, axis=1)
    scatter = np.nanmedian(np.linalg.norm(others - middle[:, None], axis=2), axis=1)
    away = np.linalg.norm(residual[suspects] - middle, axis=1)
    wrong = suspects[away > np.maximum(limit, _APART * scatter)]
    if not 0 < len(wrong) <= _MOST * len(u):
        return kept, []
    kept[wrong] = False
    one = len(wrong) == 1
    count = "1 row of" if one else f"{len(wrong):,} of"
    verb = "contradicts its neighbours and was" if one else "contradict their neighbours and were"
    told = f"{count} {len(kept):,} rows {verb} left out, of learning and of the errors"
    return kept, [told]


def _residual(scale: Scale, turning: tuple[bool, ...], u: Array, x: Array) -> Array | None:
    """What the best of some robust fits leaves over of `x`, (n, 2); None for too few rows."""
    rows = np.arange(len(u))
    if len(u) > _FITTED:
        rows = np.sort(np.random.default_rng(0).choice(len(u), _FITTED, replace=False))

    def left_over(basis: Basis) -> Array:
        coefficients = robust_solve(basis.values(u[rows]), x[rows])
        parts = [slice(first, first + _CHUNK) for first in range(0, len(u), _CHUNK)]
        return np.concatenate([x[p] - basis.values(u[p]) @ coefficients for p in parts])

    return min(
        map(left_over, _bases(scale, turning, len(rows))),
        key=lambda residual: float(np.median(np.linalg.norm(residual, axis=1))),
        default=None,
    )


def _bases(scale: Scale, turning: tuple[bool, ...], rows: int) -> list[Basis]:
    """All that a rigid chain of links can do, and what more of harmonics or polynomials fits.

    None where the rows are too few for the first: its misfit could not be told from outliers.
    """
    turns = tuple(float(s) if t else 0.0 for s, t in zip(scale.span, turning, strict=True))
    rigid = Basis(turns, len(turns), each=1)
    if _PER_TERM[0] * len(rigid.orders) > rows:
        return []
    highest = min([8, *(max(1, largest_harmonic(t)) for t in turns if t)])
    smooth = [Basis(turns, degree) for degree in range(2, highest + 1)]
    smooth = [basis for basis in smooth if len(basis.orders) <= min(rows // _PER_TERM[1], _TERMS)]
    return [rigid, *(b for b in smooth if b.degree == 4 or b is smooth[-1])]
