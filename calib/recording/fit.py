"""Fit: unknowns and all sizes of noise from corners, by Levenberg-Marquardt and the evidence.

The errors of each motion are eliminated motion by motion; sizes of noise follow MacKay (1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..common.arrays import Array, Index
from .bundle import SCENE, Bundle, Corners, Sight, Unknowns

STEPS = 40
"""Steps of a fit, at most."""


@dataclass(frozen=True)
class Settings:
    """What a fit is tuned by."""

    huber: float = 4.0  # noise sd, beyond which a corner counts less
    stiff: float = 1e6  # damping from which no step is tried any more
    # [px], noise that corners are credited with at least
    least_corner: float = 0.01
    least_error: float = 1e-6  # [rad, m, 1], the same of the motions' errors
    # sd of the log of a focal length: less is below the noise of corners, and cost .003 mm of .032
    least_focus: float = 1e-4
    most_focus: float = 0.01  # beyond, a lens was zoomed
    # exponents of the steps of corners', errors' and priors' sizes: with 1 it takes twice as long
    faster: tuple[float, float, float] = (1.0, 1.7, 2.0)
    settled: float = 0.01  # change of the log of corners' and motions' noise
    nearly: float = 0.1  # the same of priors


SETTINGS = Settings()


@dataclass(frozen=True, eq=False)
class Scale:
    """Unknowns that share a prior sd, which the evidence finds between two limits."""

    indices: Index
    start: float
    lowest: float
    highest: float


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before any picture; an unknown of no scale is free."""

    mean: Array  # (s,)
    scales: tuple[Scale, ...]

    @property
    def sd(self) -> Array:
        """Prior sd (s,), where it begins."""
        sd = np.full(len(self.mean), np.inf)
        for scale in self.scales:
            sd[scale.indices] = scale.start
        return sd


@dataclass(frozen=True, eq=False)
class Noise:
    """Sizes that the evidence finds."""

    corner: Array  # (c,), sd of a corner of each camera [px]
    # (e,), sd of a motion's turn about each axis [rad], of its shift along each [m], and of the
    # log of each camera's focal length
    error: Array
    # (s,), prior sd of the unknowns: infinite of frames, 0 holds one
    prior: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """Unknowns and noise: where a fit begins, or ends."""

    unknowns: Unknowns
    noise: Noise
    covariance: Array = field(
        default_factory=lambda: np.zeros((0, 0))
    )  # (s, s)
    # degrees of freedom that the noise of the motions is known with
    freedom: float = np.inf


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over the corners of each motion for one camera [px^2]."""

    lengths: Array  # (N,), of the residuals [px]
    squares: float  # sum of squares, weighed by Huber
    together: float  # the part of it along the poses of pictures
    products: Array  # (n, s + e, s + e), of slopes by unknowns and the motion's errors
    pulls: Array  # (n, s + e), of slopes and residuals


def solve(
    bundle: Bundle,
    prior: Prior,
    start: Fit,
    steps: int = STEPS,
    *,
    learn: bool = True,
) -> Fit:
    """Fit the unknowns, and where `learn` the noise at each step.

    Raises LinAlgError where the corners do not determine the unknowns.
    """
    fit = start
    sums = _sums(bundle, fit)
    damping = 1e-4
    for count in range(steps):
        step, errors, covariance, variances = _step(fit, prior, sums, damping)
        if not np.isfinite(step).all():
            raise np.linalg.LinAlgError(
                "the fit of corners and motions diverged"
            )
        ahead = replace(fit, unknowns=fit.unknowns.moved(step, errors))
        sums_ahead = _sums(bundle, ahead)
        cost = _cost(ahead, prior, sums_ahead)
        if cost > (1 + 1e-9) * _cost(fit, prior, sums):
            if damping > SETTINGS.stiff:
                break
            damping = max(damping, 1e-6) * 10.0
            continue
        damping *= 0.1
        before = fit.noise
        fit = replace(ahead, covariance=covariance)
        sums = sums_ahead
        if learn:
            fit = _learn(fit, prior, sums, bundle.cameras, variances)
        if count > 4 and _is_settled(before, fit.noise):
            break
    return fit


def information(bundle: Bundle, fit: Fit) -> Array:
    """What corners tell of unknowns and errors at each motion (n, s + e, s + e)."""
    return _weighed(fit.noise, _sums(bundle, fit))[0]


def _sums(bundle: Bundle, fit: Fit) -> list[_Sums]:
    sights = bundle.sights(fit.unknowns)
    triples = zip(bundle.cameras, sights, fit.noise.corner, strict=True)
    count = len(fit.unknowns.errors)
    return [_camera_sums(*triple, count) for triple in triples]


def _camera_sums(
    corners: Corners, sight: Sight, sd: float, count: int
) -> _Sums:
    residuals = corners.pixels - sight.pixels
    lengths = np.linalg.norm(residuals, axis=1)
    root = np.sqrt(_huber(lengths, sd))
    residuals = residuals * root[:, None]
    slopes = sight.slopes * root[:, None, None]
    by_scene = sight.by_scene * root[:, None, None]
    columns = slopes.shape[2]
    products = np.zeros((count, columns, columns))
    pulls = np.zeros((count, columns))
    together = 0.0
    for number, part in enumerate(corners.parts(count)):
        flat = slopes[part].reshape(-1, columns)
        rest = residuals[part].ravel()
        scene = by_scene[part].reshape(-1, SCENE)
        products[number] = flat.T @ flat
        pulls[number] = flat.T @ rest
        along = np.linalg.lstsq(scene, rest, rcond=1e-9)[0]
        together += float(rest @ scene @ along)
    squares = float((residuals**2).sum())
    return _Sums(lengths, squares, together, products, pulls)


def _weighed(noise: Noise, sums: Sequence[_Sums]) -> tuple[Array, Array]:
    """Products (n, s + e, s + e) and pulls (n, s + e) of all cameras, over their noise."""
    pairs = list(zip(noise.corner**-2.0, sums, strict=True))
    products = sum(weight * camera.products for weight, camera in pairs)
    pulls = sum(weight * camera.pulls for weight, camera in pairs)
    return np.asarray(products), np.asarray(pulls)


def _step(
    fit: Fit, prior: Prior, sums: Sequence[_Sums], damping: float
) -> tuple[Array, Array, Array, Array]:
    """Eliminate the motions' errors and solve for the free unknowns.

    Returns steps of the unknowns (s,) and of the errors (n, e), their covariance (s, s) and
    variances (n, e).
    """
    size = len(fit.noise.prior)
    products, pulls = _weighed(fit.noise, sums)
    free = np.flatnonzero(fit.noise.prior > 0.0)
    precision = fit.noise.prior[free] ** -2.0
    certain = fit.noise.error**-2.0
    spread = np.linalg.inv(products[:, size:, size:] + np.diag(certain))
    pull = pulls[:, size:] - certain * fit.unknowns.errors
    across = products[:, free, size:]
    gain = across @ spread
    whole = products[:, :size, :size].sum(axis=0)[np.ix_(free, free)]
    whole += np.diag(precision)
    before = np.diag(whole).copy()
    whole -= np.einsum("nie,nje->ij", gain, across, optimize=True)
    target = pulls[:, free].sum(axis=0) - np.einsum("nij,nj->i", gain, pull)
    target -= precision * (fit.unknowns.values - prior.mean)[free]
    ruler = np.sqrt(np.maximum(np.diag(whole), 1e-12 * before))
    normal = whole / np.outer(ruler, ruler)
    known = np.linalg.pinv(normal, rcond=1e-13, hermitian=True)
    known /= np.outer(ruler, ruler)
    damped = normal + damping * np.eye(len(free))
    step = np.zeros(size)
    step[free] = np.linalg.solve(damped, target / ruler) / ruler
    errors = np.einsum("nij,nj->ni", spread, pull)
    errors -= np.einsum("nji,j->ni", gain, step[free])
    variances = np.einsum("nii->ni", spread)
    variances = variances + (gain * (known @ gain)).sum(axis=1)
    covariance = np.zeros((size, size))
    covariance[np.ix_(free, free)] = known
    return step, errors, covariance, variances


def _cost(fit: Fit, prior: Prior, sums: Sequence[_Sums]) -> float:
    free = fit.noise.prior > 0.0
    away = (fit.unknowns.values - prior.mean)[free] / fit.noise.prior[free]
    total = float((away**2).sum())
    total += float(((fit.unknowns.errors / fit.noise.error) ** 2).sum())
    for camera, sd in zip(sums, fit.noise.corner, strict=True):
        weights = _huber(camera.lengths, sd)
        total += float((weights * camera.lengths**2).sum()) / sd**2
    return total


def _learn(
    fit: Fit,
    prior: Prior,
    sums: Sequence[_Sums],
    cameras: Sequence[Corners],
    variances: Array,
) -> Fit:
    """The fit with the noise that its residuals show.

    variances : (n, e), of the motions' errors
    """
    noise = fit.noise
    corner_rate, error_rate, prior_rate = SETTINGS.faster
    squares = (fit.unknowns.errors**2).sum(axis=0)
    # what corners tell of an error beyond its prior counts as known numbers
    numbers = (1.0 - variances / noise.error**2).sum(axis=0)
    freedom = 0.0
    error = noise.error.copy()
    for group in np.split(np.arange(len(error)), [3, *range(6, len(error))]):
        count = max(float(numbers[group].sum()), 0.5)
        square = float(squares[group].sum()) / count
        size = _grown(error[group[0]], square, error_rate)
        error[group] = max(size, SETTINGS.least_error)
        if group[0] < SCENE:
            freedom += count
    focus = np.minimum(error[SCENE:], SETTINGS.most_focus)
    is_small = focus < SETTINGS.least_focus
    error[SCENE:] = np.where(is_small, SETTINGS.least_error, focus)
    corner = noise.corner.copy()
    fitted = (freedom + int((noise.prior > 0.0).sum())) / len(sums)
    for k, (camera, corners) in enumerate(zip(sums, cameras, strict=True)):
        count = 2 * len(camera.lengths)
        directions = SCENE * len(np.unique(corners.motion))
        white = camera.squares / max(count - fitted, 0.2 * count)
        # errors of a picture's corners hang together: what is left of them in its pose counts
        open_directions = max(directions - freedom - 12, 0.1 * directions)
        square = max(white, camera.together / open_directions)
        size = _grown(corner[k], square, corner_rate)
        corner[k] = max(size, SETTINGS.least_corner)
    prior_sd = noise.prior.copy()
    away = (fit.unknowns.values - prior.mean) ** 2
    spread = np.diag(fit.covariance)
    for scale in prior.scales:
        some = scale.indices[prior_sd[scale.indices] > 0.0]
        if not len(some):
            continue
        sd = float(prior_sd[some[0]])
        number = max(float((1.0 - spread[some] / sd**2).sum()), 0.05)
        size = _grown(sd, float(away[some].sum()) / number, prior_rate)
        prior_sd[some] = np.clip(size, scale.lowest, scale.highest)
    return replace(fit, noise=Noise(corner, error, prior_sd), freedom=freedom)


def _grown(sd: float, square: float, rate: float) -> float:
    """A size that a square draws to itself, by a factor of at most e^rate."""
    change = 0.5 * np.log(max(square, 1e-300) / sd**2)
    return sd * float(np.exp(rate * np.clip(change, -1.0, 1.0)))


def _is_settled(before: Noise, after: Noise) -> bool:
    """Whether no size changes much."""
    is_sized = (before.prior > 0.0) & np.isfinite(before.prior)
    slow = np.log(after.prior[is_sized] / before.prior[is_sized])
    fast = np.log([*after.corner / before.corner, *after.error / before.error])
    is_fast_settled = np.abs(fast).max() < SETTINGS.settled
    return bool(is_fast_settled and np.abs(slow).max() < SETTINGS.nearly)


def _huber(lengths: Array, sd: float) -> Array:
    """Weights (N,) of residuals of lengths (N,) [px]."""
    return np.asarray(
        np.minimum(1.0, SETTINGS.huber * sd / np.maximum(lengths, 1e-12))
    )
