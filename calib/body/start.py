"""A start of a fit: parameters that damped steps carry on from."""

from __future__ import annotations

from dataclasses import dataclass

from ..common.arrays import Array
from .fit import Fit
from .parameters import Prior
from .rows import Rows
from .settings import SIMULATED_FLOOR, STUDENT
from .structure import Structure


@dataclass(frozen=True)
class Start:
    """A start of the fit."""

    structure: Structure  # with its signs and mirror
    beta: Array  # (d,)
    cost: float = 0.0  # negative log posterior at the start's own noise
    noise: float = 0.0  # share of the extents that the residuals have

    def run(self, q: Array, z: Array, prior: Prior, steps: int) -> Start:
        """Return the start carried on by damped steps, with Student noise."""
        structure = self.structure
        floor = SIMULATED_FLOOR * structure.extents
        rows = Rows(q, z, floor=floor)
        fit = Fit(structure, [rows], self.beta, prior, nu=STUDENT)
        return Start(structure, *fit.settle(steps))
