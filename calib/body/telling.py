"""Telling: what rows cannot tell of an arm, and which poses would tell most beside them.

Poses are chosen by the gain of information, the logarithm of the predicted covariance over the
noise (D-optimal; maximum entropy sampling, Shewry and Wynn 1987).  The residual that the body
leaves over keeps them apart from each other and from those that were measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.rows import thinned
from .belief import Body

_SMOOTH = 0.5  # length [rad] over which the residual of a log is alike (Matern 5/2)
_MEASURED = 300  # measured rows that the residual is compared with, evenly spread
_STILL = 1e-6  # [rad or m], motion of a joint that is constant
_LITTLE = float(np.radians(1.0))  # [rad], motion of a joint that tells little
_SHARE = 1e-3  # of the largest spread: joint directions that never moved
_CELLS = 24  # along each span, that tell a path from an area
_AREA_ROWS = 300  # rows from which they do


def warnings_of(
    q: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    travel: Array | None = None,
) -> tuple[str, ...]:
    """Short sentences on what rows cannot tell of an arm; empty where they can.

    q : (n, dof), joint values [rad or m]
    joint_names, revolute : names of the joints; which of them turn
    travel : (dof,), joint ranges; a joint that moved through less than a tenth of its is named
    """
    span = np.ptp(q, axis=0)
    ranges = np.full(q.shape[1], np.inf) if travel is None else travel
    notes: list[str] = []
    for name, turns, moved, most in zip(
        joint_names, revolute, span, ranges, strict=True
    ):
        if moved < _STILL:
            notes.append(
                f"{name} never moves: the rows cannot tell its length, offset or sign"
            )
        elif turns and moved < _LITTLE:
            notes.append(f"{name} moves by {np.degrees(moved):.2g} deg only")
        elif np.isfinite(most) and moved < 0.1 * most:
            notes.append(
                f"{name} moves through {100 * moved / most:.2g} % of its range only"
            )
    moving = np.flatnonzero(span >= _STILL)
    if len(moving) > 1:
        names = [joint_names[k] for k in moving.tolist()]
        notes += _coupled(
            (q[:, moving] - q[:, moving].min(axis=0)) / span[moving], names
        )
    if len(q) < 3 * q.shape[1] + 2:
        notes.append(f"{len(q)} rows are few for {q.shape[1]} joints")
    return tuple(notes)


def _coupled(share: Array, names: Sequence[str]) -> list[str]:
    """Say where joints move together; `share` (n, k) is how far each is through its span."""
    values = np.linalg.svd(share - share.mean(axis=0), compute_uv=False)
    rank = int((values > _SHARE * values[0]).sum())
    if rank < len(names):
        return [
            f"{', '.join(names)} move together along {rank} of {len(names)} directions: the rows "
            "cannot tell them apart"
        ]
    cells = np.minimum((share * _CELLS).astype(int), _CELLS - 1).T
    visited = max(len(np.unique(a * _CELLS + b)) for a, b in combinations(cells, 2))
    if (
        len(share) >= _AREA_ROWS and visited < 7 * _CELLS
    ):  # no more than a few curves would
        return [
            "the joints move along a path, not over an area: beside it the bound is wide"
        ]
    return []


def matern(q: Array, other: Array, lengths: Array) -> Array:
    """Matern 5/2 correlation (n, k) of joints (n, dof) and (k, dof)."""
    a = q / lengths
    b = other / lengths
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    d = np.sqrt(5.0 * np.maximum(square, 0.0))
    return np.asarray((1 + d + d * d / 3) * np.exp(-d))


def lengths_of(body: Body, q: Array) -> Array:
    """Correlation lengths (dof,) [rad or m] of a log's own residual."""
    turning = np.asarray(body.structure.revolute)
    span = np.maximum(np.ptp(q, axis=0), 1e-9)
    smooth = _SMOOTH * np.sqrt(body.structure.dof / 2)
    return np.asarray(np.where(turning, smooth, 0.3 * span))


def most_telling(body: Body, q: Array, n: int, measured: Array) -> NDArray[np.intp]:
    """Choose poses one by one, each the most informative beside those chosen before.

    body : its posterior holds the measured rows already
    q : (k, dof) [rad or m], poses to choose from
    n : how many, at most k
    measured : (l, dof) [rad or m], joints of rows that were measured
    Returns (n,), rows of `q`, in the order of choice.
    """
    p = body.structure.blocks[0]
    noise = body.noise[:p]
    _, x = body.structure.linearise(q, body.beta, body.active)
    directions = (
        x[:, :p] @ body.root * (body.kappa / noise[:, None])
    )  # (k, p, parameters)
    variance = np.diag((body.tau[:p] / noise) ** 2)
    lengths = lengths_of(body, q)
    rows = measured[thinned(len(measured), _MEASURED)]
    alike = matern(rows, rows, lengths) + np.eye(len(rows)) / max(
        float(variance.max()), 1e-12
    )
    seen = np.linalg.solve(
        np.linalg.cholesky(alike), matern(rows, q, lengths)
    ).T  # (k, l)
    unexplained = np.maximum(1.0 - (seen**2).sum(axis=1), 0.0)

    def common(best: int) -> Array:
        alike = matern(q, q[best : best + 1], lengths)[:, 0] - seen @ seen[best]
        return np.asarray(alike[:, None, None] * variance)

    return greedy(directions, n, unexplained[:, None, None] * variance, common)


def greedy(
    directions: Array,
    n: int,
    more: Array | float = 0.0,
    common: Callable[[int], Array] | None = None,
) -> NDArray[np.intp]:
    """Choose rows one by one, each of the largest gain of information beside those before.

    directions : (k, p, r), in which each row tells of the belief, in units of the noise: products
        of two rows' directions are the covariance of their readings
    n : how many, at most k
    more : (k, p, p), covariance of each row that the belief has no part in
    common : of one row its covariances of that kind with all rows (k, p, p)
    """
    p = directions.shape[1]
    spread = directions @ np.swapaxes(directions, 1, 2) + more
    factor = np.zeros((len(directions), p, n * p))  # a growing Cholesky factor
    chosen = np.empty(n, dtype=np.intp)
    for k in range(n):
        gain = np.linalg.slogdet(np.eye(p) + spread)[1]
        gain[chosen[:k]] = -1.0
        best = int(gain.argmax())
        chosen[k] = best
        between = directions @ directions[best].T
        if common is not None:
            between = between + common(best)
        between -= factor[:, :, : k * p] @ factor[best, :, : k * p].T
        root = np.linalg.cholesky(np.eye(p) + spread[best])
        new = np.swapaxes(np.linalg.solve(root, np.swapaxes(between, 1, 2)), 1, 2)
        factor[:, :, k * p : (k + 1) * p] = new
        spread -= new @ np.swapaxes(new, 1, 2)
    return chosen
