"""Held-out predictions: what a fit predicts for each block of rows from the others.

The fit is linear near its maximum, so that no block needs another fit: the information and the
gradient of the other rows give the step to their maximum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..common.arrays import Array
from ..common.rows import row_lengths
from .covariance import Factor, radius_95
from .fit import Fit
from .rows import FitReadings, RowBlock, edges_of
from .settings import FIT

_PARTITIONS = (2, 5, 10)
"""Numbers of blocks that the bound counts with."""


@dataclass(frozen=True)
class HeldOut:
    """How well a fit predicts each contiguous block of a sensor's rows from the others."""

    # (n, m), NaN where the other blocks do not determine the body
    residual: Array
    ratio: float  # errors over their 95 % radius, see `_largest_ratio`
    tau: Array  # (m,), sd of the body's own error: held-out errors beyond the noise
    # (n,), 95 % radius by the other blocks over that of the fit itself, 1 where it was not computed
    widening: Array


@dataclass(frozen=True)
class HeldOutPrediction:
    """The errors of a fit's predictions of rows, and how large it expects them to be."""

    # (n, m); NaN where the other rows do not determine the body
    residual: Array
    spread: Array  # (n, p, p), covariance of positions' errors; NaN where it was not computed

    @property
    def error(self) -> Array:
        """Lengths (n,) of the positions' errors."""
        p = self.spread.shape[1]
        return row_lengths(self.residual[:, :p])

    @property
    def radius(self) -> Array:
        """Radius (n,) that should hold 95 % of the errors."""
        return radius_95(self.spread)

    def negative_log_density(self) -> Array:
        """Negative log density (n,) of the errors, as a Student's with 4 degrees of freedom.

        Up to a constant (p log v + (4 + p) log(1 + e^2 / 4 v)) / 2, with v the mean variance.
        """
        p = self.spread.shape[1]
        variance = np.einsum("nii->n", self.spread) / p
        square = self.error**2 / (4 * variance)
        tail = (4 + p) * np.log1p(square)
        volume = p * np.log(variance)
        density: Array = 0.5 * (volume + tail)
        return density


def leave_blocks_out(fit: Fit, *, sensor: int = 0) -> HeldOut:
    """Predict one sensor's rows of a fit from other blocks, linearised, noise and scales kept.

    A block of rows is left out together with that of the other sensors.
    """
    readings = fit.readings[sensor]
    blocks = list(readings.by_blocks(fit.beta, fit.active))
    in_sample = _prediction(fit, readings, blocks, 1, held_out=False)
    by_others = [_prediction(fit, readings, blocks, n) for n in _PARTITIONS]
    finest = by_others[-1]
    wider = finest.radius / in_sample.radius
    return HeldOut(
        residual=finest.residual,
        # the fit's own residuals, too, may be larger than it expects
        ratio=_largest_ratio(readings, [in_sample, *by_others]),
        tau=_tau(readings, finest.residual),
        widening=np.where(wider > 1.0, wider, 1.0),
    )


def block_scores(fit: Fit) -> Array:
    """Mean negative log density (b,) of all sensors' rows in each block by the others.

    Up to a constant; NaN where the others do not determine the body.
    """
    count = len(fit.readings[0].edges) - 1
    total = np.zeros(count)
    rows = np.zeros(count)
    for readings in fit.readings[: len(fit.structure.sensors)]:
        blocks = list(readings.by_blocks(fit.beta, fit.active))
        prediction = _prediction(fit, readings, blocks, FIT.blocks)
        density = prediction.negative_log_density()
        for k, block in enumerate(blocks):
            of_block = density[block.rows]
            finite = of_block[np.isfinite(of_block)]
            total[k] += finite.sum()
            rows[k] += len(finite)
    return total / np.where(rows > 0, rows, np.nan)


def _prediction(
    fit: Fit,
    readings: FitReadings,
    blocks: Sequence[RowBlock],
    count: int,
    *,
    held_out: bool = True,
) -> HeldOutPrediction:
    """Predict the rows of each of `count` groups of blocks from the others, or from all rows."""
    positions = readings.outputs[0]
    noise = np.diag(readings.noise[positions] ** 2)
    work = len(readings.z) * len(fit.active)
    every = max(1, round(work / FIT.spread_work))
    residual = np.full_like(readings.residual, np.nan)
    shape = (len(residual), *noise.shape)
    spread = np.full(shape, np.nan)
    groups = min(count, len(blocks))
    limits = edges_of(len(blocks), groups)
    for first, last in pairwise(limits.tolist()):
        left_out = slice(first, last) if held_out else slice(0)
        try:
            gram, step = fit.without(left_out)
            precision = fit.posterior_precision(gram)
        except np.linalg.LinAlgError:  # the others are too few
            continue
        for rows, at_maximum, slope in blocks[first:last]:
            residual[rows] = at_maximum - slope @ step
            position_slope = slope[::every, positions]
            predicted = _predicted_covariance(precision, position_slope)
            thinned = spread[rows]
            thinned[::every] = predicted + noise
    return HeldOutPrediction(residual, spread)


def _predicted_covariance(precision: Factor, slope: Array) -> Array:
    """Covariance (n, p, p) of predictions that move with parameters by (n, p, k)."""
    n, p, k = slope.shape
    flat = slope.reshape(n * p, k)
    white = precision.whiten(flat.T)
    white = white.reshape(k, n, p)
    covariance: Array = np.einsum("kni,knj->nij", white, white)
    return covariance


def _largest_ratio(
    readings: FitReadings, predictions: Sequence[HeldOutPrediction]
) -> float:
    """The largest 95 % quantile of error over radius among predictions, the finest the last.

    If it is larger, the mean plus one standard deviation of the blocks' quantiles, since the next
    query may be at one of the worse places; `FIT.unknown_kappa` where there are too few rows.
    Outliers of the fit do not count.
    """
    outlier = readings.weight[:, 0] <= FIT.outlier
    ratios = [
        np.where(outlier, np.nan, prediction.error / prediction.radius)
        for prediction in predictions
    ]
    quantiles = _quantiles(ratios)
    blocks = np.split(ratios[-1], readings.edges[1:-1])
    of_blocks = _quantiles(blocks)
    if len(of_blocks) > 1:
        beyond = np.mean(of_blocks) + np.std(of_blocks)
        quantiles.append(float(beyond))
    return max(quantiles, default=FIT.unknown_kappa)


def _quantiles(samples: Sequence[Array]) -> list[float]:
    """The 95 % quantile of each sample (n,) that has enough finite values."""
    finite = [sample[np.isfinite(sample)] for sample in samples]
    least = FIT.least_rows_of_a_quantile
    return [float(np.quantile(s, 0.95)) for s in finite if len(s) > least]


def _tau(readings: FitReadings, residual: Array) -> Array:
    """The sd (m,) of the body's own error, by held-out residuals (n, m) beyond the noise."""
    tau = np.empty(len(readings.noise))
    for columns in readings.outputs:
        p = columns.stop - columns.start
        variance = readings.noise[columns.start] ** 2
        lengths = row_lengths(residual[:, columns])
        lengths = lengths[np.isfinite(lengths)]
        square = variance
        if len(lengths):
            limited = np.minimum(lengths, FIT.limit * np.median(lengths))
            square = (limited**2).mean()
        beyond = square / p - FIT.noise_margin * variance
        least = FIT.least_tau**2 * variance
        tau[columns] = np.sqrt(max(beyond, least))
    return tau
