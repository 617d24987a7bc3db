"""Backlash: half the play of each joint, learned from the side from which it came.

A joint that comes from below is lower than its encoder reads, one that comes from above
higher, so that a position x is off by h times a derivative::

    theta = q - h s,    x(theta) = x(q) - (dx/dq) h s

with h half the play and s = 1, -1 the sign of the joint's last motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..common.arrays import Array, Mask, Shape
from .settings import PLAY


@dataclass(frozen=True, eq=False)
class Approach:
    """Half the play h of each joint."""

    # half the play h [rad or m], 0 where the log shows none
    play: Annotated[Array, Shape("dof")]

    def effective(self, q: Array, side: Array) -> Array:
        """True values (n, dof) of joints by the sign of their last motion, 0 where unknown."""
        return q - self.play * side

    def has_sides(self, side: Array) -> Mask:
        """Whether the side (n, dof) of all joints with play is known, (n,)."""
        is_known = side != 0.0
        is_tight = self.play == 0.0
        is_enough: Mask = (is_known | is_tight).all(axis=1)
        return is_enough


class OtherColumns(NamedTuple):
    """k parameters that are estimated together with the plays."""

    columns: Array  # (n, m, k), derivatives of the position by them, in noises
    precision_root: Array  # (k,), one over their prior standard deviations
    pull: Array  # (k,), their prior means minus their values


def learn_half_play(
    residual: Array,
    slope: Array,
    side: Array,
    others: OtherColumns,
    known: Array,
) -> Array | None:
    """Half the play of each joint (dof,), or None where no joint surely has play.

    Once one joint surely has play, others that only likely have play count, too.

    residual : (n, m), measured less predicted position in noises, in the order of motion
    slope : (n, m, dof) [1 / rad or m], derivative of the position in noises by the joint values
    side : (n, dof), sign of the last motion of each joint
    others : parameters that are estimated together with the plays
    known : (dof,), half the play that the joint values are already without [rad or m]
    """
    n, outputs, dof = slope.shape
    features = -slope * side[:, None, :]
    residual = residual + features @ known
    # the prior adds a row for each parameter
    count = len(others.pull)
    row_columns = others.columns.reshape(n * outputs, count)
    columns = np.vstack([row_columns, np.diag(others.precision_root)])
    target = np.append(residual, others.precision_root * others.pull)
    features = features.reshape(n * outputs, dof)
    plays = np.vstack([features, np.zeros((count, dof))])
    # the parts that the parameters do not explain
    basis, _ = np.linalg.qr(columns)
    target -= basis @ (basis.T @ target)
    plays -= basis @ (basis.T @ plays)

    half, error = _least_squares(plays, target, outputs)
    is_sure = half > PLAY.sure * error
    if not is_sure.any():
        return None
    is_likely = half > PLAY.likely * error
    half, _ = _least_squares(plays[:, is_likely], target, outputs)
    if (half < 0.0).any():
        return None
    half_play = np.zeros(len(is_likely))
    half_play[is_likely] = half
    return half_play


def _least_squares(
    features: Array, target: Array, outputs: int
) -> tuple[Array, Array]:
    """Solution (k,) of ``features @ solution = target`` in noises, and its standard errors (k,).

    features, target : (N, k) and (N,)
    outputs : coordinates of a row, which are one measurement
    Where the rows do not determine it, the solution is zero and its errors are infinite.
    """
    count = features.shape[1]
    gram = features.T @ features
    if not len(target) or np.linalg.cond(gram) > 1e12:
        errors = np.full(count, np.inf)
        return np.zeros(count), errors
    inverse = np.linalg.inv(gram)
    solution = inverse @ features.T @ target
    misfit = target - features @ solution
    # robust to errors that the coordinates of a row share
    starts = np.arange(0, len(target), outputs)
    scores = np.add.reduceat(features * misfit[:, None], starts, axis=0)
    errors = np.linalg.norm(scores @ inverse, axis=0)
    # where rows hardly separate a play from the parameters, the prior limits its error
    white = np.sqrt(np.diag(inverse))
    return solution, np.maximum(errors, white)
