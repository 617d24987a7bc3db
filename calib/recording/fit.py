"""Fit: unknowns and all sizes of noise from corners, by Levenberg-Marquardt and the evidence.

The errors of each motion are eliminated motion by motion; sizes of noise follow MacKay (1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index
from .bundle import POSE, Bundle, Sight, Unknowns


@dataclass(frozen=True)
class Settings:
    """What a fit is tuned by."""

    steps: int = 40  # at most
    # with all noise as it is: such a fit begins near its end
    few_steps: int = 5
    huber: float = 4.0  # noise sd, beyond which a corner counts less
    stiff: float = 1e6  # damping from which no step is tried any more
    # [px], noise that corners are credited with at least
    least_corner: float = 0.01
    least_error: float = 1e-6  # [rad, m, 1], the same of the motions' errors
    # [m]; joints that shift the flange turn it as well, which few pictures do not tell: with five,
    # the fit saw turns in one of 40 worlds, and intervals covered 88 % of the camera's
    reach: float = 1.0
    # sd of the log of a focal length: less is below the noise of corners, and cost .003 mm of .032
    least_focus: float = 1e-4
    most_focus: float = 0.01  # beyond, a lens was zoomed
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
    scales: Sequence[Scale]


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
class Step:
    """A step of a fit, and how far it is certain."""

    unknowns: Array  # (s,)
    errors: Array  # (n, e), of each motion
    covariance: Array  # (s, s), of the unknowns
    variances: Array  # (n, e), of the errors


@dataclass(frozen=True, eq=False)
class Fit:
    """Unknowns and noise: where a fit begins, or ends."""

    unknowns: Unknowns
    noise: Noise
    covariance: Array  # (s, s)
    # degrees of freedom that the noise of the motions is known with
    freedom: float = np.inf


def solve(
    bundle: Bundle, prior: Prior, start: Fit, *, learn: bool = True
) -> Fit:
    """Fit the unknowns, and where `learn` the noise at each step.

    Raises LinAlgError where the corners do not determine the unknowns.
    """
    fit = start
    before = fit.noise
    sight = bundle.look(fit.unknowns)
    damping = 1e-4
    for count in range(SETTINGS.steps if learn else SETTINGS.few_steps):
        step = _step(bundle, prior, fit, sight, damping)
        if not np.isfinite(step.unknowns).all():
            raise np.linalg.LinAlgError("the fit of corners diverged")
        unknowns = fit.unknowns.moved(step.unknowns, step.errors)
        ahead = replace(fit, unknowns=unknowns)
        sight_ahead = bundle.look(ahead.unknowns)
        cost = _cost(bundle, prior, fit, sight)
        if _cost(bundle, prior, ahead, sight_ahead) > (1 + 1e-9) * cost:
            if damping > SETTINGS.stiff:
                break
            damping = max(damping, 1e-6) * 10.0
            continue
        damping *= 0.1
        before = fit.noise
        fit = replace(ahead, covariance=step.covariance)
        sight = sight_ahead
        if learn:
            fit = _learn(bundle, prior, fit, sight, step.variances)
        if count > 4 and _is_settled(before, fit.noise):
            break
    # by the noise of the last step: priors that still shrink say too much
    error = before.error.copy()
    error[:3] = np.maximum(error[:3], error[3] / SETTINGS.reach)
    careful = replace(fit, noise=replace(before, error=error))
    step = _step(bundle, prior, careful, sight, 0.0)
    return replace(fit, covariance=step.covariance)


def information(
    bundle: Bundle, noise: Noise, sight: Sight
) -> tuple[Array, Array]:
    """What corners tell of unknowns and errors at each motion.

    Returns weighed products of slopes (n, s + e, s + e), and of slopes and residuals (n, s + e).
    """
    residuals, weights = _residuals(bundle, noise, sight)
    root = np.sqrt(weights) / noise.corner[bundle.camera]
    slopes = sight.slopes * root[:, None, None]
    residuals = residuals * root[:, None]
    columns = slopes.shape[2]
    products = np.zeros((len(bundle.motions.rows), columns, columns))
    pulls = np.zeros(products.shape[:2])
    for rows in bundle.pictures:
        motion = bundle.motion[rows[0]]
        flat = slopes[rows].reshape(-1, columns)
        products[motion] += flat.T @ flat
        pulls[motion] += residuals[rows].ravel() @ flat
    return products, pulls


def _residuals(
    bundle: Bundle, noise: Noise, sight: Sight
) -> tuple[Array, Array]:
    """Residuals (N, 2) [px] of corners, and Huber's weights (N,)."""
    residuals = bundle.pixels - sight.pixels
    far = SETTINGS.huber * noise.corner[bundle.camera]
    lengths = np.maximum(np.linalg.norm(residuals, axis=1), 1e-12)
    return residuals, np.minimum(1.0, far / lengths)


def _step(
    bundle: Bundle, prior: Prior, fit: Fit, sight: Sight, damping: float
) -> Step:
    """Eliminate the motions' errors and solve for the free unknowns."""
    noise = fit.noise
    size = bundle.layout.size
    products, pulls = information(bundle, noise, sight)
    free = np.flatnonzero(noise.prior > 0.0)
    both_free = np.ix_(free, free)
    # the errors (n, e) of each motion by themselves
    error_precision = noise.error**-2.0
    error_products = products[:, size:, size:]
    error_products = error_products + np.diag(error_precision)
    spread = np.linalg.inv(error_products)
    pull = pulls[:, size:] - error_precision * fit.unknowns.errors
    # what of the free unknowns (k,) they take away
    across = products[:, free, size:]
    gain = across @ spread
    pull_lost = np.einsum("nij,nj->i", gain, pull)
    precision = noise.prior[free] ** -2.0
    normal = products.sum(axis=0)[both_free] + np.diag(precision)
    least = 1e-12 * np.diag(normal)
    normal -= np.tensordot(gain, across, ([0, 2], [0, 2]))
    target = pulls[:, free].sum(axis=0) - pull_lost
    away = fit.unknowns.values - prior.mean
    target -= precision * away[free]
    step, covariance = _solved(normal, least, target, damping)
    # and back to the errors
    errors = (spread @ pull[:, :, None])[:, :, 0]
    errors -= step @ gain
    follows = gain * (covariance @ gain)
    variances = np.einsum("nii->ni", spread) + follows.sum(axis=1)
    unknowns = np.zeros(size)
    unknowns[free] = step
    covariances = np.zeros((size, size))
    covariances[both_free] = covariance
    return Step(unknowns, errors, covariances, variances)


def _solved(
    normal: Array, least: Array, target: Array, damping: float
) -> tuple[Array, Array]:
    """Damped solution (k,) of normal equations (k, k) and undamped inverse, each in its scale.

    least : (k,), of the diagonal
    """
    diagonal = np.maximum(np.diag(normal), least)
    scale = np.sqrt(diagonal)
    scales = np.outer(scale, scale)
    normal = normal / scales
    covariance = np.linalg.pinv(normal, rcond=1e-13, hermitian=True)
    damped = normal + damping * np.eye(len(scale))
    solution = np.linalg.solve(damped, target / scale)
    return solution / scale, covariance / scales


def _cost(bundle: Bundle, prior: Prior, fit: Fit, sight: Sight) -> float:
    noise = fit.noise
    residuals, weights = _residuals(bundle, noise, sight)
    weights = weights / noise.corner[bundle.camera] ** 2
    corners = weights[:, None] * residuals**2
    free = noise.prior > 0.0
    away = fit.unknowns.values - prior.mean
    away = away[free] / noise.prior[free]
    errors = fit.unknowns.errors / noise.error
    total = corners.sum() + (away**2).sum()
    return float(total + (errors**2).sum())


def _learn(
    bundle: Bundle, prior: Prior, fit: Fit, sight: Sight, variances: Array
) -> Fit:
    """The fit with the noise that its residuals show.

    variances : (n, e), of the motions' errors
    """
    error, freedom = _error_noise(fit, variances)
    corner = _corner_noise(bundle, fit, sight, freedom)
    noise = Noise(corner, error, _prior_noise(prior, fit))
    return replace(fit, noise=noise, freedom=freedom)


def _error_noise(fit: Fit, variances: Array) -> tuple[Array, float]:
    """Sd (e,) of the motions' errors, and the degrees of freedom of their turns and shifts."""
    noise = fit.noise
    columns = len(noise.error)
    starts = [0, 3, *range(POSE, columns)]  # of turn, shift, each focal length
    # what corners tell of an error beyond its prior counts as known numbers
    shares = 1.0 - variances / noise.error**2
    numbers = np.add.reduceat(shares.sum(axis=0), starts)
    counts = np.maximum(numbers, 0.5)
    squares = fit.unknowns.errors**2
    sums = np.add.reduceat(squares.sum(axis=0), starts)
    sizes = _grown(noise.error[starts], sums / counts, 1.7)
    focus = sizes[2:]
    focus[focus < SETTINGS.least_focus] = 0.0
    sizes[2:] = np.minimum(focus, SETTINGS.most_focus)
    sizes = np.maximum(sizes, SETTINGS.least_error)
    widths = np.diff([*starts, columns])
    return np.repeat(sizes, widths), float(counts[:2].sum())


def _prior_noise(prior: Prior, fit: Fit) -> Array:
    """Prior sd (s,) of the unknowns."""
    sizes = fit.noise.prior.copy()
    squares = (fit.unknowns.values - prior.mean) ** 2
    variances = np.diag(fit.covariance)
    for scale in prior.scales:
        free = sizes[scale.indices] > 0.0
        some = scale.indices[free]
        if len(some):
            sd = sizes[some]
            shares = 1.0 - variances[some] / sd**2
            number = max(shares.sum(), 0.05)
            size = _grown(sd, squares[some].sum() / number, 2.0)
            sizes[some] = np.clip(size, scale.lowest, scale.highest)
    return sizes


def _corner_noise(
    bundle: Bundle, fit: Fit, sight: Sight, freedom: float
) -> Array:
    """Sd (c,) [px] of corners.

    Errors of a picture's corners hang together: what is left of them in its pose counts.
    """
    noise = fit.noise
    residuals, weights = _residuals(bundle, noise, sight)
    root = np.sqrt(weights)[:, None]
    residuals = residuals * root
    scenes = sight.by_scene * root[:, :, None]
    cameras = len(noise.corner)
    together = np.zeros(cameras)
    directions = np.zeros(cameras)
    for rows in bundle.pictures:
        camera = bundle.camera[rows[0]]
        scene = scenes[rows].reshape(-1, POSE)
        rest = residuals[rows].ravel()
        along = np.linalg.lstsq(scene, rest, rcond=1e-9)[0]
        together[camera] += float(rest @ scene @ along)
        directions[camera] += POSE
    squares = np.bincount(bundle.camera, (residuals**2).sum(axis=1))
    counts = 2 * np.bincount(bundle.camera)
    fitted = (freedom + np.count_nonzero(noise.prior)) / cameras
    white = squares / np.maximum(counts - fitted, 0.2 * counts)
    left = np.maximum(directions - freedom - 12, 0.1 * directions)
    square = np.maximum(white, together / left)
    return np.maximum(_grown(noise.corner, square, 1.0), SETTINGS.least_corner)


def _grown(sd: Array, squares: ArrayLike, rate: float) -> Array:
    """Sizes that squares draw to themselves, by a factor of at most e^rate."""
    change = 0.5 * np.log(np.maximum(squares, 1e-300) / sd**2)
    return np.asarray(sd * np.exp(rate * np.clip(change, -1.0, 1.0)))


def _is_settled(before: Noise, after: Noise) -> bool:
    """Whether no size changes much."""
    is_sized = (before.prior > 0.0) & np.isfinite(before.prior)
    slow = np.log(after.prior[is_sized] / before.prior[is_sized])
    fast = np.log([*after.corner / before.corner, *after.error / before.error])
    is_fast_settled = np.abs(fast).max() < SETTINGS.settled
    return bool(is_fast_settled and np.abs(slow).max() < SETTINGS.nearly)
