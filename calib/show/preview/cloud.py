"""Cloud: where the tip of an arm in space can be, and how well the model knows it there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...common.arrays import Array
from ...model.model import Model

_POSTURES, _SHOWN, _CUT = 40_000, 3_000, 1_500
_THICK = 0.01  # half the thickness of a cut, as a share of the cloud's extent


@dataclass(frozen=True, eq=False)
class Cloud:
    """Positions of random postures over the learned range."""

    x: Array  # (n, 3) [unit]
    errors: Array  # (n,) [unit], 95 % bounds on the true position in the sensor's frame
    q: Array  # (m, dof) [rad or m], more postures, for cuts
    positions: Array  # (m, 3) [unit], theirs
    model: Model

    def cuts(self, lift: Callable[[Array], Array], frame: Array) -> tuple[Array, Array]:
        """Points (k, 3) of the scene near two planes through its middle, and their errors (k,).

        One plane faces the viewer, one is level; `frame` has x, y and normal of the first.
        """
        points = lift(self.positions)
        away = points - np.median(points, axis=0)
        half = _THICK * float(np.ptp(away, axis=0).max())
        found, errors = [], []
        for normal in frame[[2, 1]]:
            height = away @ normal
            chosen = np.flatnonzero(np.abs(height) < half)[:_CUT]
            found.append(points[chosen] - np.outer(height[chosen], normal))
            errors.append(self.model.model_error(self.q[chosen]))
        return np.concatenate(found), np.concatenate(errors)


def cloud(model: Model) -> Cloud:
    """Postures spread evenly over the learned range, without those that the model refuses."""
    about = model.about
    rng = np.random.default_rng(0)
    q = rng.uniform(about.lower, about.upper, (_POSTURES, len(about.joint_names)))
    x = model.forward(q)
    known = np.isfinite(x).all(axis=1)
    q, x = q[known], x[known]
    return Cloud(x[:_SHOWN], model.model_error(q[:_SHOWN]), q, x, model)
