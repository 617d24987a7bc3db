"""The gate: which member of a structure the rows support, from simple to rich.

A member frees some blocks of parameters.  Each is fitted, and two members are compared by the
evidence, and by what each predicts of every block of rows from the others (`leave_blocks_out`).
The fit is linear near its maximum, so that no block needs another fit: without its rows
information and gradient give the step to where that fit would end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..common.arrays import Array
from .covariance import radius_95
from .fit import Fit
from .normal import Factor
from .parameters import Indices
from .rows import Part, Rows, edges_of
from .settings import FIT, NATS, STUDENT
from .start import Start

_PARTITIONS = (0, 2, 5, 10)


@dataclass(frozen=True)
class HeldOut:
    """What a fit predicts for each contiguous block of a sensor's rows from the others."""

    residual: Array  # (n, m); NaN where the other blocks leave the body open
    score: Array  # (n,), negative log predictive density, up to a constant; NaN without a spread
    edges: Indices  # (b + 1,), limits of the blocks
    # errors over the 95 % radius (n,), NaN for outliers of the fit, by the number of blocks: 2, 5
    # and 10, and 0 of the fit itself, whose own residuals may contradict what it states there
    ratios: dict[int, Array]
    # (n,), 95 % radius by the other blocks over that of the fit itself, 1 where it was not computed
    widening: Array

    def blockwise(self) -> Array:
        """Mean score of each block, NaN where there is none."""
        means = np.full(len(self.edges) - 1, np.nan)
        for k, (first, last) in enumerate(pairwise(self.edges)):
            scores = self.score[first:last]
            scores = scores[np.isfinite(scores)]
            if len(scores):
                means[k] = scores.mean()
        return means

    def ratio(self) -> float:
        """The largest 95 % quantile of error over radius among the partitions.

        Or, if that is more, the mean of the single blocks' quantiles and one standard deviation
        beyond it, since the place that is asked next may be one of the worse. `UNKNOWN_KAPPA`
        where there are too few rows.
        """
        quantiles = _quantiles([*self.ratios.values()])
        finest = self.ratios[max(self.ratios)]
        blocks = np.split(finest, self.edges[1:-1])
        of_blocks = _quantiles(blocks)
        if len(of_blocks) > 1:
            beyond = np.mean(of_blocks) + np.std(of_blocks)
            quantiles.append(float(beyond))
        return max(quantiles, default=FIT.unknown_kappa)

    def tau(self, part: Part) -> Array:
        """Residual sd (m,) of the body itself: held-out errors beyond the noise."""
        tau = np.empty(len(part.noise))
        for columns in part.outputs:
            p = columns.stop - columns.start
            noise = part.noise[columns.start]
            residual = self.residual[:, columns]
            lengths = np.linalg.norm(residual, axis=1)
            lengths = lengths[np.isfinite(lengths)]
            square = float(noise**2)
            if len(lengths):
                limited = np.minimum(lengths, 4 * np.median(lengths))
                square = float((limited**2).mean())
            beyond = square / p - 1.3 * noise**2
            least = (0.05 * noise) ** 2
            tau[columns] = np.sqrt(max(beyond, least))
        return tau


def _quantiles(parts: Sequence[Array]) -> list[float]:
    """The 95 % quantile of each part (n,) that has enough finite values."""
    quantiles: list[float] = []
    for part in parts:
        finite = part[np.isfinite(part)]
        if len(finite) > FIT.least_rows_of_a_quantile:
            quantiles.append(float(np.quantile(finite, 0.95)))
    return quantiles


def leave_blocks_out(
    fit: Fit, partitions: tuple[int, ...] = _PARTITIONS, *, sensor: int = 0
) -> HeldOut:
    """Held-out predictions of one sensor's rows of a fit, linearised, noise and scales kept.

    A block of rows is left out together with that of the other sensors.
    """
    part = fit.parts[sensor]
    derivatives = list(part.by_blocks(fit.beta, fit.active))
    outlier = part.weight[:, 0] <= FIT.outlier
    ratios: dict[int, Array] = {}
    radii: dict[int, Array] = {}
    for count in sorted(partitions):
        residual, spread = _from_others(fit, part, derivatives, count)
        positions = residual[:, part.outputs[0]]
        lengths = np.linalg.norm(positions, axis=1)
        radii[count] = radius_95(spread)
        ratios[count] = lengths / radii[count]
        ratios[count][outlier] = np.nan
    # residual, lengths and spread are now of the finest partition
    score = _negative_log_density(lengths, spread)
    widening = np.ones(len(residual))
    if 0 in radii:
        finest = max(partitions)
        wider = np.maximum(radii[finest] / radii[0], 1.0)
        is_computed = np.isfinite(wider)
        widening[is_computed] = wider[is_computed]
    return HeldOut(residual, score, part.edges, ratios, widening)


def _from_others(
    fit: Fit, part: Part, derivatives: list[tuple[slice, Array]], count: int
) -> tuple[Array, Array]:
    """Predict the rows of each of `count` groups of blocks from the others; of none from all.

    derivatives : rows of each block, and how their predictions move (n, m, k)
    Returns residual : (n, m), NaN where the others leave the body open
    Returns spread : (n, p, p), covariance of positions' residuals; NaN where it was not computed
    """
    positions = part.outputs[0]
    noise = np.diag(part.noise[positions] ** 2)
    work = len(part.z) * len(fit.active)
    every = max(1, round(work / FIT.spread_work))
    residual = np.full_like(part.residual, np.nan)
    spread = np.full((len(residual), *noise.shape), np.nan)
    groups = max(min(count, len(derivatives)), 1)
    limits = edges_of(len(derivatives), groups).tolist()
    for first, last in pairwise(limits):
        left_out = slice(first, last) if count else slice(0)
        try:
            gram, step = fit.without(left_out)
            precision = fit.softer(gram)
        except np.linalg.LinAlgError:  # the others leave parameters open
            continue
        for rows, derivative in derivatives[first:last]:
            residual[rows] = part.residual[rows] - derivative @ step
            some = derivative[::every, positions]
            spread[rows][::every] = _predicted_covariance(precision, some)
            spread[rows][::every] += noise
    return residual, spread


def _predicted_covariance(precision: Factor, derivative: Array) -> Array:
    """Covariance (n, p, p) of predictions with derivatives (n, p, k) by parameters."""
    n, p, k = derivative.shape
    flat = derivative.reshape(n * p, k)
    white = precision.whiten(flat.T).reshape(k, n, p)
    covariance: Array = np.einsum("kni,knj->nij", white, white)
    return covariance


def _negative_log_density(length: Array, spread: Array) -> Array:
    """Of errors (n,) under covariances (n, p, p), of a Student with 4 degrees of freedom.

    Up to a constant (p log v + (4 + p) log(1 + e^2 / 4 v)) / 2, with v the mean variance.
    """
    p = spread.shape[1]
    variance = np.einsum("nii->n", spread) / p
    square = length**2 / (4 * variance)
    tail = (4 + p) * np.log1p(square)
    volume = p * np.log(variance)
    density: Array = 0.5 * (volume + tail)
    return density


@dataclass(frozen=True)
class Member:
    """A member as rows fit it, with its held-out predictions."""

    name: str
    free: tuple[str, ...]  # blocks
    fit: Fit
    held_out: HeldOut
    # nats of evidence against joint curves; 0 where they were not tried
    against_curves: float = 0.0


def _wins(richer: Member, simpler: Member) -> bool:
    """Whether a richer member is better in both currencies.

    Either its held-out score gains more than one paired standard error over the blocks and the
    evidence agrees, or the evidence gains three nats and the score agrees.  The blocks of few rows
    are too noisy to tell alone; the evidence alone trusts the noise model too much.  Correlated
    residuals count once for their autocorrelation time.
    """
    new = richer.held_out.blockwise()
    old = simpler.held_out.blockwise()
    has_new = np.isfinite(new)
    has_old = np.isfinite(old)
    if has_new.sum() < has_old.sum():
        return False
    has_both = has_new & has_old
    if not has_both.any():
        return bool(has_new.any())
    gains = (old - new)[has_both]
    gain = gains.mean()
    evidence = richer.fit.evidence - simpler.fit.evidence
    evidence /= richer.fit.autocorrelation
    if gain <= 0 or evidence <= 0:
        return False
    error = np.inf
    if len(gains) > 1:
        error = gains.std(ddof=1) / np.sqrt(len(gains))
    return bool(gain > error or evidence > NATS)


def pass_gate(
    start: Start, chain: tuple[str, ...], rows: Sequence[Rows]
) -> Member:
    """Fit members from simple to rich, each with what has passed; return the last that wins.

    Samples of a simulation have Gaussian noise, a log's is Student.  Nothing richer is tried where
    samples reach their least noise.

    start : the structure, whose members they are, and parameters to begin with
    chain : blocks of the simplest member that is a start for richer ones
    """
    structure = start.structure
    nu = np.inf if structure.simulated else STUDENT
    names = {frozenset(blocks): name for name, blocks in structure.members()}
    best: Member | None = None
    tried: dict[frozenset[str], Member | None] = {}
    for rung, blocks in structure.members():
        name = rung
        free = blocks
        begin = start.beta
        # what has passed stays: a lens stays beneath the curves
        if best is not None:
            free = tuple(dict.fromkeys((*best.free, *blocks)))
            name = names.get(frozenset(free), f"{best.name} and {rung}")
            if set(chain) <= set(best.free):
                begin = best.fit.beta
        if frozenset(free) in tried:
            continue
        member = _member_of(name, free, rows, Start(structure, begin), nu)
        tried[frozenset(free)] = member
        if member is None:
            continue
        if best is None or _wins(member, best):
            best = member
        if structure.simulated and _is_exact(member.fit):
            break
    if best is None:
        raise np.linalg.LinAlgError("no member of the body could be fitted")
    return _with_doubt_of_curves(best, tried.values())


def _is_exact(fit: Fit) -> bool:
    """Whether a fit's noise is next to the least that rows have."""
    least = 1.5 * fit.parts[0].floor
    return bool((fit.noise <= least).all())


def _with_doubt_of_curves(
    best: Member, tried: Iterable[Member | None]
) -> Member:
    """The best member with its evidence against those that have joint curves."""
    with_curves = -np.inf
    for member in tried:
        if member is not None and "curve" in member.free:
            with_curves = max(with_curves, member.fit.evidence)
    gain = best.fit.evidence - with_curves
    if not np.isfinite(gain):
        return best
    return replace(best, against_curves=gain / best.fit.autocorrelation)


def _member_of(
    name: str,
    free: tuple[str, ...],
    rows: Sequence[Rows],
    begin: Start,
    nu: float,
) -> Member | None:
    """Return a member with some blocks free, None where the rows leave them open."""
    structure = begin.structure
    try:
        prior = structure.prior(free)
        fit = Fit(structure, rows, begin.beta, prior, nu=nu)
        if np.isfinite(nu):
            fit.maximise(steps=10, tolerance=FIT.settled)
        else:
            # exact rows may be far along a curved valley, such as that of a lens
            fit.settle(60)
            fit.maximise(steps=20, tolerance=1e-3)
        held_out = leave_blocks_out(fit, (FIT.blocks,))
    except np.linalg.LinAlgError:
        return None
    return Member(name, free, fit, held_out)
