"""The bound: how many rows of a log are beyond it, and the chance of so many by noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Mask
from .rows import LogRows
from .settings import FALSE_ALARM
from .significance import GroupTest, GroupTests

# Share of rows beyond a 95 % bound that fails for sure: halves of A and C have 13 % at most
BEYOND = 0.2
LASTING = 10  # rows over which noise may last


@dataclass(frozen=True)
class BoundTest:
    """The rows that are beyond the model's own 95 % bound."""

    beyond: float  # share of them
    usual: float  # median of the bounds [unit]
    test: GroupTest  # the chance of so many by noise

    @property
    def fails(self) -> bool:
        """Whether they are too many, noise or not."""
        return self.beyond > BEYOND

    @property
    def holds(self) -> bool:
        """Whether they are about as many as usual."""
        return not self.fails and self.test.score <= 1.0

    def words(self, *, noisier: bool) -> str:
        """The share in words; `noisier` if noise may be all there is to it."""
        cause = "a noisier sensor or encoder, " if noisier else ""
        return (
            f"{100 * self.beyond:.0f} % of the rows are further from the prediction than its "
            f"bound, where 5 % should be: {cause}the bound does not hold"
        )


def bound_test(
    rows: LogRows,
    limit: Array,
    shared_variance: Array | float,
    tests: GroupTests,
) -> BoundTest:
    """Count the rows beyond the 95 % bound, beside what a noisier sensor or encoder would do.

    rows : n of them that do not contradict all others
    limit : (n,), the bound of each row [unit]
    shared_variance : (n,), of what all rows share [unit^2]
    """
    from scipy.special import chdtri

    residual = rows.x - rows.predicted
    square = (residual**2).sum(axis=1)
    usual = float(np.median(limit))
    # squared, of 95 % of a Gaussian, in deviations
    radius = float(chdtri(residual.shape[1], 0.05))
    noise = _noise_of_sensor(square, residual.shape[1], tests)
    # rows of like joints that err alike are no noisier sensor
    if noise > 0.0 and variance_of_places(rows, residual) * radius > usual**2:
        noise = 0.0
    by_noise = noise + _noise_of_joint(rows, tests)
    expected = limit**2 + radius * shared_variance
    is_beyond = square > expected
    is_beyond_noise = square > expected + radius * by_noise
    test = GroupTest("bound", _chance(is_beyond_noise))
    return BoundTest(float(np.mean(is_beyond)), usual, test)


def _chance(beyond: Mask) -> float:
    """Chance (binomial) of so many rows (n,) beyond a bound that as many as usual may exceed.

    Rows that err together count once.
    """
    from scipy.special import bdtrc

    if not beyond.any():
        return 1.0
    time = autocorrelation_time(beyond[:, None].astype(float))
    count = int(beyond.sum() / time)
    independent = math.ceil(len(beyond) / time)
    return float(bdtrc(count - 1, independent, BEYOND)) if count else 1.0


def _noise_of_sensor(square: Array, outputs: int, tests: GroupTests) -> float:
    """Variance of an axis [unit^2] beyond the usual one, of squared distances (n,)."""
    from scipy.special import chdtri

    # half of the rows of a noisier sensor are nearer than its median
    median = float(np.median(square)) / float(chdtri(outputs, 0.5))
    return max(max(tests.noise**2, median) - tests.usual**2, 0.0)


def _noise_of_joint(rows: LogRows, tests: GroupTests) -> Array:
    """Variance (n,) [unit^2] of the rows by a joint whose encoder is noisy."""
    if tests.noisy is None:
        return np.zeros(len(rows))
    joint, sd = tests.noisy
    body = rows.body
    slope = body.structure.slope(rows.q, body.beta)
    moves = slope[..., joint] ** 2
    variance: Array = sd**2 * moves.sum(axis=1)
    return variance


def variance_of_places(rows: LogRows, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    # of so many rows at least one is no neighbour in time: noise may last over some rows
    lasting = LASTING
    count = min(2 * lasting + 2, len(rows))
    _, neighbours = cKDTree(rows.u).query(rows.u, count)
    near = np.asarray(neighbours)
    index = np.arange(len(rows))
    later = np.abs(near - index[:, None]) > lasting
    row = np.flatnonzero(later.any(axis=1))
    if not len(row):
        return 0.0
    other = near[row, later[row].argmax(axis=1)]
    pairs = np.sort(np.stack([row, other], axis=1), axis=1)
    first, second = np.unique(pairs, axis=0).T
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0
