"""Backlash: half the play of each joint, learned from the side from which it came.

A joint that comes from below is lower than its encoder reads, one that comes from above
higher, so that a position x is off by h times a derivative::

    theta = q - h s,    x(theta) = x(q) - (dx/dq) h s

with h half the play and s = 1, -1 the sign of the joint's last motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

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


def learn_play(residual: Array, slope: Array, direction: Array) -> Array | None:
    """Half the play of each joint (dof,), or None where no joint is sure to have some.

    Once one joint surely has play, others count that are only likely to have some.

    residual : (n, m) [unit], measured less predicted position, in the order of motion
    slope : (n, m, dof) [unit / rad or m], derivative of the position by the joint values
    direction : (n, dof), sign of the last motion of each joint
    """
    features = -slope * direction[:, None, :]
    half, error = _least_squares(features, residual)
    is_sure = half > PLAY.sure * error
    if not is_sure.any():
        return None
    is_likely = half > PLAY.likely * error
    features = features[:, :, is_likely]
    half, _ = _least_squares(features, residual)
    if (half < 0.0).any():
        return None
    play = np.zeros(len(is_likely))
    play[is_likely] = half
    return play


def _least_squares(features: Array, residual: Array) -> tuple[Array, Array]:
    """Solution (k,) of ``features @ solution = residual``, and its standard errors (k,).

    features, residual : (n, m, k) and (n, m)
    Where the rows do not determine it, the solution is zero and its errors are infinite.
    """
    n, _, k = features.shape
    flat = features.reshape(-1, k)
    gram = flat.T @ flat
    if not n or np.linalg.cond(gram) > 1e12:
        errors = np.full(k, np.inf)
        return np.zeros(k), errors
    inverse = np.linalg.inv(gram)
    solution = inverse @ flat.T @ residual.ravel()
    misfit = residual - features @ solution
    # one row's coordinates are one measurement: robust to what they share
    products = features * misfit[:, :, None]
    scores = products.sum(axis=1)
    errors = np.linalg.norm(scores @ inverse, axis=0)
    return solution, errors
