"""A drawing and rows: the body of a simulated arm, fitted to the first rows of the real one.

A model that was trained in simulation knows the arm as it was drawn.  Its update by a log moves the
parameters that the log asks for; a fit with the drawing as prior also learns how far arms of this
kind are from their drawings.  Held-out rows choose between both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..body.fitting import fit_body
from ..body.nominal import nominal_of
from ..common.scale import METRES
from ..errors import CalibError

if TYPE_CHECKING:
    from ..body.posterior import BodyFit
    from .comparison import Comparison

_BETTER = 0.95  # share of the update's held-out error that the fit has to reach


def fit_from_drawing(found: Comparison, after: float) -> BodyFit | None:
    """The body of the rows with a simulated model's geometry as prior, where it serves better.

    found : the log beside the model
    after : [unit], mean held-out error of the update, which the fit has to beat
    Returns BodyFit or None, none for a model of a log, an arm in space, rows of a line or a corner,
    or a fit that is no better.
    """
    body, reference, about = found.model.body, found.reference, found.model.about
    if body is None or not body.simulated or body.structure.outputs != 2:
        return None
    if about.unit not in METRES or reference.turned or reference.locked or not found.spans:
        return None
    try:
        nominal = nominal_of(body.predict, about.lower, about.upper, about.revolute)
        fit = fit_body(
            found.q[found.kept],
            found.x[found.kept],
            joint_names=about.joint_names,
            revolute=about.revolute,
            nominal=nominal,
            unit=about.unit,
            lower=about.lower,
            upper=about.upper,
        )
    except CalibError:  # joints out of the plane, or rows that place no arm
        return None
    error = float(np.linalg.norm(fit.held_out, axis=1).mean())
    return fit if error < _BETTER * after else None
