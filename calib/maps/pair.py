"""Two maps and their links from any paired samples: what ``calib.SOM.fit_pair`` returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from .association import Association

CURVE = ("samples", "sigma", "zeta_motor", "zeta_sensory", "error")
"""Columns of a curve: samples shown, radius [nodes], distortions (eq. 9, unit box), and the
mean distance from new samples to what the readout ``activity`` says of them [unit]."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two maps that were learned from the same samples.

    Attributes
    ----------
    association : Association
        The maps, their links and the readouts of these, in the unit boxes of both spaces.
    curve : (m, 5) array
        How they developed, columns as :data:`CURVE`; empty with the batch rule.
    """

    association: Association
    curve: Array

    def __repr__(self) -> str:
        return f"Pair({self.association!r}, curve of {len(self.curve)} points)"

    def forward(self, q: Array, readout: str = "activity") -> Array:
        """What the links say of rows (n, d) of the first space, (n, k) in the second's unit."""
        pair = self.association
        u = pair.motor.scale.to_unit(np.atleast_2d(np.asarray(q, dtype=float)))
        return pair.sensory.scale.from_unit(pair.forward(u, readout))
