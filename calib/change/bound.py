"""The test of the bound: whether more rows than chance lie beyond what a model tells of itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..common.arrays import Array
from .score import GroupTest, Tested
from .settings import BEYOND, FALSE_ALARM, FEW

_LASTING = 10  # rows over which noise may last


@dataclass(frozen=True, eq=False)
class Bounded:
    """Rows of a log that count, beside the 95 % bound of a model."""

    rows: Indices  # (n,), their numbers in the log
    u: Array  # (n, dof), joints in the unit box
    residual: Array  # (n, m) [unit], measured less predicted positions
    bound: Array  # (n,) [unit], infinite where the model tells none
    shared: Array  # (n,), variance of an axis by what all rows share

    def beyond(self, more: Array | float = 0.0) -> Array:
        """Which rows (n,) lie beyond, where noise has `more` variance on each axis."""
        allowed = self.bound**2 + self._radius * (self.shared + more)
        return np.asarray((self.residual**2).sum(axis=1) > allowed)

    def test(self, tested: Tested, slope: Array | None) -> GroupTest:
        """How surely too many rows lie beyond.

        Even if all of the log's own scatter is noise of the sensor or of one encoder, which is no
        drift; but what rows of like joints share is no noise.

        slope : (n, m), motion of the tip by a joint whose encoder is noisy
        """
        from scipy.special import bdtrc, chdtri

        more = max(tested.noise**2 - tested.usual**2, 0.0)
        if len(self.rows) < FEW:  # half of the rows of a noisier sensor are nearer than its median
            half = float(np.median((self.residual**2).sum(axis=1)))
            more = max(more, half / float(chdtri(self.residual.shape[1], 0.5)) - tested.usual**2)
        noise = np.full(len(self.rows), 0.0 if more and self._alike else more)
        if tested.noisy is not None and slope is not None:
            noise += tested.noisy[1] ** 2 * (slope**2).sum(axis=1)
        over = self.beyond(noise)
        # rows that err together count once
        alike = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
        count, n = int(over.sum() / alike), math.ceil(len(over) / alike)
        p = float(bdtrc(count - 1, n, BEYOND)) if count else 1.0
        return GroupTest("bound", p, -2.0 * math.log(max(p, 1e-300)))

    @cached_property
    def _radius(self) -> float:
        """Squared radius of 95 % of a Gaussian, in units of a deviation."""
        from scipy.special import chdtri

        return float(chdtri(self.residual.shape[1], 0.05))

    @property
    def _alike(self) -> bool:
        """Whether rows of like joints err alike, by more than the model told: that is no noise.

        A ripple of 2 mm, too short for the smooth residual of a log, passed for noise.  Pairs lie
        apart in time, so that noise that lasts over some rows is not taken for it.
        """
        from scipy.spatial import cKDTree
        from scipy.special import ndtri

        # of so many rows at least one is no neighbour in time
        near = np.asarray(cKDTree(self.u).query(self.u, min(2 * _LASTING + 2, len(self.u)))[1])
        later = np.abs(self.rows[near] - self.rows[:, None]) > _LASTING
        row = np.flatnonzero(later.any(axis=1))
        if not len(row):
            return False
        pairs = np.stack([row, near[row, later[row].argmax(axis=1)]], axis=1)
        first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
        product = (self.residual[first] * self.residual[second]).sum(axis=1)
        # whatever its size, noise makes either sign as likely
        sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
        variance = float(product.mean()) / self.residual.shape[1]  # per axis
        return bool(sure and self._radius * variance > float(np.median(self.bound)) ** 2)
