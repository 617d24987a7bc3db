"""A start of a fit: parameters that damped steps carry on from."""

from __future__ import annotations

from dataclasses import dataclass, replace

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

    def run(self, rows: Rows, prior: Prior, steps: int) -> Start:
        """Return the start carried on by damped steps, with Student noise."""
        floor = SIMULATED_FLOOR * self.structure.extents
        rows = replace(rows, floor=floor)
        fit = Fit(self.structure, [rows], self.beta, prior, nu=STUDENT)
        return Start(self.structure, *fit.settle(steps))
