"""Leave-block-out predictions in closed form: downdate the information by the block's rows."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .covariance import radius_95
from .fit import Fit
from .normal import Factor, slices
from .parameters import Indices
from .settings import LEAST_ROWS_OF_A_QUANTILE, OUTLIER, UNKNOWN_KAPPA

_WORK = 5e5
"""Rows times parameters beyond which only some rows, evenly spaced, get a predicted spread."""

_PARTITIONS = (0, 2, 5, 10)


def _spread(fit: Fit, factor: Factor, x: Array) -> Array:
    """Covariances (n, p, p) of readings whose derivatives are `x` (n, p, k)."""
    n, p, k = x.shape
    y = factor.whiten(x.reshape(-1, k).T).reshape(k, n, p)
    return np.asarray(np.einsum("kni,knj->nij", y, y) + np.diag(fit.noise[:p] ** 2))


@dataclass(frozen=True)
class HeldOut:
    """What a fit predicts for each contiguous block of rows from the others."""

    # (n, m), held-out residuals of ten blocks; NaN where the others do not determine the body
    residual: Array
    # (n,), negative log predictive density, up to a constant; NaN for rows without a spread
    score: Array
    edges: Indices  # (b + 1,), limits of the blocks
    # dict of int to (n,) array, error over the 95 % radius, for partitions into 2, 5 and 10 blocks,
    # and 0: of the fit itself, whose own residuals may contradict what it states there
    ratios: dict[int, Array]
    # (n,), rows that are no outliers of the fit itself; the others do not enter `kappa`
    common: NDArray[np.bool_]

    def blockwise(self, values: Array) -> Array:
        """Mean in each block of the `values` (n,) that are finite, NaN where none is."""
        parts = [values[a:b][np.isfinite(values[a:b])] for a, b in pairwise(self.edges)]
        return np.array([part.mean() if len(part) else np.nan for part in parts])

    def ratio(self) -> float:
        """The largest 95 % quantile of error over radius among the partitions.

        Or, if that is more, the mean of the single blocks' quantiles and one standard deviation
        beyond it, since the place that is asked next may be one of the worse. `UNKNOWN_KAPPA`
        where there are too few rows.
        """
        found = []
        for ratio in self.ratios.values():
            known = ratio[np.isfinite(ratio) & self.common]
            if len(known) > LEAST_ROWS_OF_A_QUANTILE:
                found.append(float(np.quantile(known, 0.95)))
        finest = np.where(self.common, self.ratios[max(self.ratios)], np.nan)
        single = [
            np.nanquantile(part, 0.95)
            for part in np.split(finest, self.edges[1:-1])
            if np.isfinite(part).sum() > LEAST_ROWS_OF_A_QUANTILE
        ]
        if len(single) > 1:
            found.append(float(np.mean(single) + np.std(single)))
        return max(found) if found else UNKNOWN_KAPPA

    def tau(self, noise: Array, blocks: tuple[int, ...]) -> Array:
        """Residual sd (m,) of the body itself: held-out errors beyond the noise."""
        out = np.empty(len(noise))
        for part in slices(blocks):
            p = part.stop - part.start
            e = np.linalg.norm(self.residual[:, part], axis=1)
            e = e[np.isfinite(e)]
            s = noise[part.start]
            limited = np.minimum(e, 4 * np.median(e)) if len(e) else np.array([s])
            beyond = float((limited**2).mean()) / p - 1.3 * s**2
            out[part] = np.sqrt(max(beyond, (0.05 * s) ** 2))
        return out


def leave_blocks_out(fit: Fit, partitions: tuple[int, ...] = _PARTITIONS) -> HeldOut:
    """Held-out predictions of a fit, linearised, with its noise and scales kept."""
    (n, m), k, p = fit.residual.shape, len(fit.active), fit.blocks[0]
    edges, every, total = fit.edges, max(1, round(n * k / _WORK)), fit.grams.sum(axis=0)
    residual, score, probes = np.full((n, m), np.nan), np.full(n, np.nan), []
    for (rows, x), gram, moment in zip(fit.by_blocks(), fit.grams, fit.moments, strict=True):
        probes.append(x[::every, :p])
        with suppress(np.linalg.LinAlgError):
            residual[rows] = fit.residual[rows] - x @ _step(fit, gram, moment)
    ratios: dict[int, Array] = {}
    for parts in partitions:
        limits = np.linspace(0, len(probes), max(min(parts, len(probes)), 1) + 1).round()
        ratio = np.full(n, np.nan)
        for first, last in pairwise(limits.astype(int)):
            gram = (parts > 0) * fit.grams[first:last].sum(axis=0)
            try:
                step = _step(fit, gram, (parts > 0) * fit.moments[first:last].sum(axis=0))
                softer = fit.softer(total - gram)
            except np.linalg.LinAlgError:  # the other blocks leave the parameters open
                continue
            for block in range(first, last):
                rows, x = slice(edges[block], edges[block + 1], every), probes[block]
                length = np.linalg.norm(fit.residual[rows, :p] - x @ step, axis=1)
                spread = _spread(fit, softer, x)
                ratio[rows] = length / radius_95(spread)
                if last - first == 1:
                    v = np.einsum("nii->n", spread) / p  # of a Student with 4 degrees of freedom
                    score[rows] = 0.5 * (p * np.log(v) + (4 + p) * np.log1p(length**2 / (4 * v)))
        ratios[parts] = ratio
    return HeldOut(residual, score, edges, ratios, fit.weight[:, 0] > OUTLIER)


def _step(fit: Fit, gram: Array, moment: Array) -> Array:
    """How the parameters (k,) move without rows of this information and moment."""
    return Factor(fit.precision - gram).solve(fit.gradient - moment)
