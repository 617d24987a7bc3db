"""Cloud: where the tip of an arm in space can be, and how well the model knows it there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...common.arrays import Array
from ...model.model import Model
from ..error_scale import ErrorScale, colours
from .canvas import Canvas
from .placement import Placement

_POSTURES, _SHOWN, _CUT = 40_000, 3_000, 1_500
_THICK = 0.01  # half the thickness of a cut, as a share of the cloud's extent


@dataclass(frozen=True, eq=False)
class Cloud:
    """Postures spread evenly over the learned range, without those that the model refuses."""

    model: Model
    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, 3) [unit], their positions
    errors: Array  # (m,) [unit], 95 % bounds on the true position of the first, which are shown

    @staticmethod
    def of(model: Model) -> Cloud:
        """Draw the postures."""
        about, rng = model.about, np.random.default_rng(0)
        q = rng.uniform(about.lower, about.upper, (_POSTURES, len(about.joint_names)))
        x = model.forward(q)
        known = np.isfinite(x).all(axis=1)
        return Cloud(model, q[known], x[known], model.model_error(q[known][:_SHOWN]))

    def draw(self, canvas: Canvas, placement: Placement, scale: ErrorScale, dot: float) -> None:
        """Draw the cloud, and two cuts through its middle: one faces the viewer, one is level."""
        points, n = placement.lift(self.x), len(self.errors)
        canvas.layer("Error cloud", "scale", "bound on the true position, over all postures")
        tints = colours(scale.share(self.errors))
        canvas.add("Error cloud/points", "points", tints, points[:n], size=dot)
        away = points - np.median(points, axis=0)
        half = _THICK * float(np.ptp(away, axis=0).max())
        cut, errors = [], []
        for normal in placement.frame[[2, 1]]:
            height = away @ normal
            chosen = np.flatnonzero(np.abs(height) < half)[:_CUT]
            cut.append(points[chosen] - np.outer(height[chosen], normal))
            errors.append(self.model.model_error(self.q[chosen]))
        canvas.layer("Slices", "scale", "the same, cut upright and level", shown=False)
        tints = colours(scale.share(np.concatenate(errors)))
        canvas.add("Slices/points", "points", tints, np.concatenate(cut), size=1.5 * dot)
