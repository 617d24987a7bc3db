"""Backlash: half the play of each joint, learned from the side from which it came.

A joint that comes from below stands lower than its encoder reads, one that comes from above
higher: theta = q - h s, with h half the play and s the sign of the last motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Mask, Shape
from .settings import PLAY


@dataclass(frozen=True, eq=False)
class Approach:
    """What the direction of approach tells."""

    # [rad or m], half the play of each joint, 0 where the log shows none
    play: Annotated[Array, Shape("dof")]

    def effective(self, q: Array, direction: Array) -> Array:
        """Where joints (n, dof) stand that came from a direction, 1, -1 or 0 (unknown)."""
        values: Array = q - self.play * direction
        return values

    def has_direction(self, direction: Array) -> Mask:
        """Whether the direction (n, dof) is known of all joints with play, (n,)."""
        tells = (direction != 0.0) | (self.play == 0.0)
        has_direction: Mask = tells.all(axis=1)
        return has_direction


def learn_play(residual: Array, slope: Array, direction: Array) -> Array | None:
    """Half the play of each joint, None where the direction of approach does not pay.

    residual : (n, m) [unit], measured less predicted position, in the order of motion
    slope : (n, m, dof) [unit / rad or m], derivative of the position by the joint values
    direction : (n, dof), sign of the last motion of each joint
    Returns (dof,): one joint has to be sure of its play; beside it others count that are likely.
    """
    features = -slope * direction[:, None, :]
    half, error = _least_squares(features, residual)
    is_sure = half > PLAY.sure * error
    if not is_sure.any():
        return None
    likely = half > PLAY.likely * error
    play = np.zeros(len(half))
    likely_features = features[:, :, likely]
    play[likely], _ = _least_squares(likely_features, residual)
    if (play < 0.0).any():
        return None
    return play


def _least_squares(features: Array, residual: Array) -> tuple[Array, Array]:
    """Least squares (k,) of features (n, m, k), and the standard errors (k,)."""
    n, _, k = features.shape
    flat = features.reshape(-1, k)
    gram = flat.T @ flat
    if not n or np.linalg.cond(gram) > 1e12:
        return np.zeros(k), np.full(k, np.inf)
    inverse = np.linalg.inv(gram)
    solution = inverse @ flat.T @ residual.ravel()
    misfit = residual - features @ solution
    # one row's coordinates are one measurement: robust to what they share
    products = features * misfit[:, :, None]
    scores = products.sum(axis=1)
    errors = np.linalg.norm(scores @ inverse, axis=0)
    return solution, errors
