"""Observations: the rows of a log that do not contradict all others, as a body speaks of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows
from ..body.settings import STUDENT
from ..common.arrays import Array, Mask
from ..common.rows import spread_rows
from .causes import changeable, sd_if_changed, sd_of_creep
from .frame import Reference, offset_after
from .rows import LogRows
from .settings import OUTLIER


@dataclass(frozen=True)
class ObservationSettings:
    """How rows are found that contradict all others."""

    # 12 took exact rows of a longer link for outliers
    robust_steps: int = 60
    # of the fit that finds outliers: enough for every parameter
    robust_rows: int = 400


OBSERVING = ObservationSettings()


@dataclass(frozen=True)
class Observations:
    """Rows of a log that do not contradict all others."""

    q: Array  # (n, dof), joints [rad or m]
    z: Array  # (n, m), outputs, without what maps add to the body [unit]
    # (n, dof), sign of each joint's last motion, 0 where it is not known
    side: Array
    # [unit], standard deviation that all rows share, such as that of a board that was found again
    shared: float = 0.0

    def some(self, most: int) -> Observations:
        """Return at most so many rows, evenly spread."""
        rows = spread_rows(len(self.q), most)
        return Observations(
            self.q[rows], self.z[rows], self.side[rows], self.shared
        )


def sound_rows(reference: Reference, q: Array, z: Array) -> Mask:
    """Return which rows (n, dof), (n, m) are near a robust fit of all that may have changed."""
    structure = reference.structure
    body = reference.body
    start = reference.beta
    size = reference.sizes
    sd = sd_if_changed(body, changeable(structure))
    prior = Prior(start, np.hypot(sd, sd_of_creep(body)))
    rows = spread_rows(len(q), OBSERVING.robust_rows)
    measured = [Rows(q[rows], z[rows], floor=size)]
    fit = Fit(structure, measured, start, prior, nu=STUDENT)
    fit.maximise(steps=OBSERVING.robust_steps)
    predicted = structure.predict(q, fit.beta)
    residual = structure.residual(z, predicted) / size
    square = (residual**2).sum(axis=1)
    outputs = residual.shape[1]
    median = float(np.median(square[rows]))
    noise = max(median / (outputs - 2 / 3), 1.0)
    return np.asarray(square <= OUTLIER**2 * outputs * noise)


def sound_observations(
    rows: LogRows, reference: Reference
) -> tuple[LogRows, Observations]:
    """Return the rows that do not contradict all others, and what a body has to say of them."""
    added = rows.map_offset
    if reference.has_discrete_cause:
        body = reference.body
        added = offset_after(rows.body, body, reference.beta, rows.q, added)
    z = rows.x - added
    sound = sound_rows(reference, rows.q, z)
    rows = rows.sound(sound)
    # that of the model's own log and of this one
    shared = math.sqrt(2.0) * rows.shared
    return rows, Observations(rows.q, z[sound], rows.side, shared)
