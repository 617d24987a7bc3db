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

    # [rad or m], 0 where the log shows none
    play: Annotated[Array, Shape("dof")]

    def effective(self, q: Array, direction: Array) -> Array:
        """True values (n, dof) of joints that came from a direction, 1, -1 or 0 (unknown)."""
        return q - self.play * direction

    def has_direction(self, direction: Array) -> Mask:
        """Whether the direction (n, dof) of all joints with play is known, (n,)."""
        is_known = direction != 0.0
        is_tight = self.play == 0.0
        has_direction: Mask = (is_known | is_tight).all(axis=1)
        return has_direction


class Beside(NamedTuple):
    """What rows may err by besides plays: k parameters that are estimated together with them."""

    columns: Array  # (n, m, k), derivatives of the position by them, in noises
    precision_root: Array  # (k,), one over their prior standard deviations
    pull: Array  # (k,), how far they are below their prior mean


def learn_play(
    residual: Array,
    slope: Array,
    direction: Array,
    beside: Beside,
    known: Array,
) -> Array | None:
    """Half the play of each joint (dof,), or None where no joint is sure to have some.

    Once one joint surely has play, others count that are only likely to have some.

    residual : (n, m), measured less predicted position in noises, in the order of motion
    slope : (n, m, dof) [1 / rad or m], derivative of the position in noises by the joint values
    direction : (n, dof), sign of the last motion of each joint
    known : (dof,), half the play that the predictions are free of [rad or m]
    """
    n, outputs, dof = slope.shape
    features = -slope * direction[:, None, :]
    residual = residual + features @ known
    # the prior adds a row for each parameter
    count = len(beside.pull)
    of_rows = beside.columns.reshape(n * outputs, count)
    columns = np.vstack([of_rows, np.diag(beside.precision_root)])
    target = np.append(residual, beside.precision_root * beside.pull)
    features = features.reshape(n * outputs, dof)
    plays = np.vstack([features, np.zeros((count, dof))])
    # less what the parameters explain
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
    play = np.zeros(len(is_likely))
    play[is_likely] = half
    return play


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
    # robust to what the coordinates of a row share
    starts = np.arange(0, len(target), outputs)
    scores = np.add.reduceat(features * misfit[:, None], starts, axis=0)
    errors = np.linalg.norm(scores @ inverse, axis=0)
    # where rows hardly tell a play from the parameters, these are as unsure as their priors
    white = np.sqrt(np.diag(inverse))
    return solution, np.maximum(errors, white)
