"""Fit: unknowns and all sizes of noise from corners, by Gauss-Newton steps and the evidence.

The errors of each motion are eliminated motion by motion; sizes of noise follow MacKay (1992).
Steps need no damping, since the closed form starts near enough (of 200 worlds none differed).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index
from ..common.rows import row_lengths
from .bundle import POSE_SIZE, Bundle, PredictedCorners, Unknowns


@dataclass(frozen=True)
class CornerFitSettings:
    """Settings of the fit of corners."""

    steps: int = 40  # at most
    fewest: int = 6  # at least
    # [rad, m, 1]; larger steps mean that the motions do not explain the corners: the fit fails
    farthest: float = 1.0
    huber: float = 4.0  # [sd of the noise], beyond which a corner counts less
    least_corner: float = 0.01  # least noise of corners [px]
    least_error: float = 1e-6  # least sd of the motions' errors [rad, m, 1]
    # [m]; joints that shift the flange turn it as well, which few pictures do not show: with five,
    # the fit found turns in one of 40 worlds, and intervals covered 88 % of the cameras' places
    reach: float = 1.0
    # [m]; joints that turn the flange shift it by a hand's length: with five and six poses,
    # intervals covered 92 % without this, 94 % with it
    lever: float = 0.2
    # sd of the log of a focal length; less is below the noise of corners, and cost .003 mm of .032
    least_focus: float = 1e-4
    most_focus: float = 0.01  # beyond, a lens was zoomed
    settled: float = 0.01  # change of the log of each size
    # over-relaxation of the updates of noise and of prior sd, whose own steps converge slowly
    error_rate: float = 1.7
    prior_rate: float = 2.0
    # least degrees of freedom of a kind of error, and of a prior's parameters
    least_error_freedom: float = 0.5
    least_prior_freedom: float = 0.05
    # least degrees of freedom of corners, over their number, and of boards, over their 6 directions
    least_corner_freedom: float = 0.4
    least_board_freedom: float = 0.1


CORNER_FIT = CornerFitSettings()


@dataclass(frozen=True, eq=False)
class PriorScale:
    """Unknowns that share a prior sd, which the evidence finds between two limits."""

    indices: Index
    start: float
    lowest: float
    highest: float


@dataclass(frozen=True, eq=False)
class CornerPrior:
    """Prior of the unknowns; one that is in no scale is free."""

    mean: Array  # (s,)
    scales: Sequence[PriorScale]

    @property
    def sizes(self) -> Array:
        """Initial sd (s,) of the search by evidence."""
        sizes = np.full(len(self.mean), np.inf)
        for scale in self.scales:
            sizes[scale.indices] = scale.start
        return sizes


@dataclass(frozen=True, eq=False)
class Noise:
    """Sizes that the evidence finds."""

    corner: Array  # (c,), sd of a corner of each camera [px]
    # (e,), sd of a motion's turn about each axis [rad], of its shift along each [m], and of the
    # log of each camera's focal length
    error: Array
    # (s,), prior sd of the unknowns: infinite of frames
    prior: Array

    @property
    def turn(self) -> float:
        """Sd of a motion's turn about each axis [rad]."""
        return float(self.error[0])

    @property
    def shift(self) -> float:
        """Sd of a motion's shift along each axis [m]."""
        return float(self.error[3])


@dataclass(frozen=True, eq=False)
class FitStep:
    """A step of a fit, and its uncertainty."""

    unknowns: Array  # (s,)
    errors: Array  # (n, e), of each motion
    covariance: Array  # (s, s), of the unknowns
    variances: Array  # (n, e), of the errors


@dataclass(frozen=True, eq=False)
class CornerFit:
    """Unknowns and noise, at the start of a fit or at its end."""

    unknowns: Unknowns
    noise: Noise
    covariance: Array  # (s, s)
    # degrees of freedom of the noise of turns or of shifts, the larger one
    freedom: float = np.inf

    def with_turn(self, turn: float) -> CornerFit:
        """The start of a fit with another noise of the motions' turns [rad]."""
        error = self.noise.error.copy()
        error[:3] = turn
        return replace(self, noise=replace(self.noise, error=error))


def fit_corners(
    bundle: Bundle, prior: CornerPrior, start: CornerFit, *, learn: bool = True
) -> CornerFit:
    """Fit the unknowns, and where `learn` the noise at each step.

    Raises LinAlgError where the corners do not determine the unknowns.
    """
    fit = start
    predicted = bundle.predict(fit.unknowns)
    for count in range(1, CORNER_FIT.steps + 1):
        before = fit.noise
        step = _step(bundle, prior, fit, predicted)
        but_lenses = np.delete(step.unknowns, bundle.layout.lenses.ravel())
        moves = np.append(but_lenses, step.errors)
        if not np.abs(moves).max() < CORNER_FIT.farthest:
            raise np.linalg.LinAlgError("the fit of corners diverged")
        unknowns = fit.unknowns.retract(step.unknowns, step.errors)
        fit = replace(fit, unknowns=unknowns, covariance=step.covariance)
        predicted = bundle.predict(unknowns)
        if learn:
            error, freedoms = _error_noise(fit, step.variances)
            corner = _corner_noise(bundle, fit, predicted, freedoms.sum())
            noise = Noise(corner, error, _prior_noise(prior, fit))
            fit = replace(fit, noise=noise, freedom=float(freedoms.max()))
        if count >= CORNER_FIT.fewest and _is_settled(before, fit.noise):
            break
    # by the noise before the last step: prior sds that still shrink make intervals too small
    error = before.error.copy()
    error[:3] = max(before.turn, before.shift / CORNER_FIT.reach)
    error[3:POSE_SIZE] = max(before.shift, before.turn * CORNER_FIT.lever)
    careful = replace(fit, noise=replace(before, error=error))
    step = _step(bundle, prior, careful, predicted)
    return replace(fit, covariance=step.covariance)


def information(
    bundle: Bundle, noise: Noise, predicted: PredictedCorners
) -> tuple[Array, Array]:
    """Normal equations of the unknowns and errors at each motion, by its corners alone.

    Returns weighted products of slopes (n, s + e, s + e), and of slopes and residuals (n, s + e).
    """
    residuals, weights = _residuals(bundle, noise, predicted)
    root = np.sqrt(weights) / noise.corner[bundle.camera]
    slopes = predicted.slopes * root[:, None, None]
    residuals = residuals * root[:, None]
    columns = slopes.shape[2]
    products = np.zeros((bundle.motions.count, columns, columns))
    pulls = np.zeros(products.shape[:2])
    for rows in bundle.pictures:
        motion = bundle.motion[rows[0]]
        slope = slopes[rows].reshape(-1, columns)
        products[motion] += slope.T @ slope
        pulls[motion] += residuals[rows].ravel() @ slope
    return products, pulls


def _residuals(
    bundle: Bundle, noise: Noise, predicted: PredictedCorners
) -> tuple[Array, Array]:
    """Residuals (N, 2) [px] of corners, and Huber's weights (N,)."""
    residuals = bundle.pixels - predicted.pixels
    far = CORNER_FIT.huber * noise.corner[bundle.camera]
    lengths = np.maximum(row_lengths(residuals), 1e-12)
    return residuals, np.minimum(1.0, far / lengths)


def schur_complement(
    products: Array, noise: Noise, size: int
) -> tuple[Array, Array, Array]:
    """Products of the s unknowns at each motion, from which its errors are eliminated.

    products : (n, s + e, s + e), see :func:`information`
    size : number s of unknowns
    Returns these (n, s, s), the gain (n, s, e) and the covariance (n, e, e) of the errors.
    """
    across = products[:, :size, size:]
    precision = np.diag(noise.error**-2.0)
    of_errors = products[:, size:, size:] + precision
    spread = np.asarray(np.linalg.inv(of_errors), float)
    gain: Array = across @ spread
    return products[:, :size, :size] - gain @ across.mT, gain, spread


def _step(
    bundle: Bundle,
    prior: CornerPrior,
    fit: CornerFit,
    predicted: PredictedCorners,
) -> FitStep:
    """A step in which the motions' errors are eliminated."""
    noise = fit.noise
    size = bundle.layout.size
    products, pulls = information(bundle, noise, predicted)
    of_unknowns, gain, spread = schur_complement(products, noise, size)
    error_pulls = pulls[:, size:] - noise.error**-2.0 * fit.unknowns.errors

    # normal equations (s, s) of the unknowns
    precision = noise.prior**-2.0
    normal = of_unknowns.sum(axis=0) + np.diag(precision)
    target = pulls[:, :size].sum(axis=0)
    target -= np.einsum("nij,nj->i", gain, error_pulls)
    target -= precision * (fit.unknowns.values - prior.mean)
    covariance = _inverse(normal)
    step = covariance @ target

    # errors where the unknowns take that step
    errors = np.einsum("nij,nj->ni", spread, error_pulls) - step @ gain
    by_unknowns = gain * (covariance @ gain)
    variances = np.einsum("nii->ni", spread) + by_unknowns.sum(axis=1)
    return FitStep(step, errors, covariance, variances)


def _inverse(normal: Array) -> Array:
    """Inverse of normal equations (s, s), computed with each unknown in its own scale."""
    scale = np.sqrt(np.abs(np.diag(normal)))
    scales = np.outer(scale, scale)
    inverse = np.linalg.pinv(normal / scales, rcond=1e-13, hermitian=True)
    return np.asarray(inverse / scales)


def _error_noise(fit: CornerFit, variances: Array) -> tuple[Array, Array]:
    """Sd (e,) of the motions' errors, and the degrees of freedom (2,) of their turns and shifts.

    variances : (n, e), of the errors
    """
    noise = fit.noise
    columns = len(noise.error)
    starts = [
        0,
        3,
        *range(POSE_SIZE, columns),
    ]  # of turn, shift, each focal length
    # an error counts by the share of its prior variance that corners remove
    shares = 1.0 - variances / noise.error**2
    counts = np.add.reduceat(shares.sum(axis=0), starts)
    counts = np.maximum(counts, CORNER_FIT.least_error_freedom)
    squares = (fit.unknowns.errors**2).sum(axis=0)
    square = np.add.reduceat(squares, starts) / counts
    sizes = _next_size(noise.error[starts], square, CORNER_FIT.error_rate)
    focus = sizes[2:]
    focus[focus < CORNER_FIT.least_focus] = 0.0
    np.minimum(focus, CORNER_FIT.most_focus, out=focus)
    sizes = np.maximum(sizes, CORNER_FIT.least_error)
    widths = np.diff([*starts, columns])
    return np.repeat(sizes, widths), counts[:2]


def _prior_noise(prior: CornerPrior, fit: CornerFit) -> Array:
    """Prior sd (s,) of the unknowns."""
    sizes = fit.noise.prior.copy()
    squares = (fit.unknowns.values - prior.mean) ** 2
    variances = np.diag(fit.covariance)
    for scale in prior.scales:
        indices = scale.indices
        sd = sizes[indices]
        shares = 1.0 - variances[indices] / sd**2
        freedom = max(shares.sum(), CORNER_FIT.least_prior_freedom)
        square = squares[indices].sum() / freedom
        size = _next_size(sd, square, CORNER_FIT.prior_rate)
        sizes[indices] = np.clip(size, scale.lowest, scale.highest)
    return sizes


def _corner_noise(
    bundle: Bundle, fit: CornerFit, predicted: PredictedCorners, freedom: float
) -> Array:
    """Sd (c,) [px] of corners, the larger of two estimates.

    One takes the errors of corners as independent.  The other takes the part of each picture's
    errors that moves its board as a whole, since errors of neighbouring corners are correlated.
    freedom : degrees of freedom of the motions
    """
    noise = fit.noise
    residuals, weights = _residuals(bundle, noise, predicted)
    root = np.sqrt(weights)[:, None]
    residuals = residuals * root
    # by turn and shift of the flange, which move the board as a whole
    size = bundle.layout.size
    by_flange = (
        predicted.slopes[:, :, size : size + POSE_SIZE] * root[:, :, None]
    )
    cameras = len(noise.corner)

    # variance along the turns and shifts of each picture's board
    pose_squares = np.zeros(cameras)
    directions = np.zeros(cameras)
    for rows in bundle.pictures:
        camera = bundle.camera[rows[0]]
        slope = by_flange[rows].reshape(-1, POSE_SIZE)
        residual = residuals[rows].ravel()
        move = np.linalg.lstsq(slope, residual, rcond=1e-9)[0]
        pose_squares[camera] += float(residual @ slope @ move)
        directions[camera] += POSE_SIZE
    # each camera determines the motions by as much as its corners weigh
    counts = np.bincount(bundle.camera)
    shares = counts / noise.corner**2
    freedoms = freedom * shares / shares.sum()
    # two poses, of camera and board, follow the pictures
    numbers = np.maximum(
        directions - freedoms - 2 * POSE_SIZE,
        CORNER_FIT.least_board_freedom * directions,
    )

    # variance where corners err independently
    squares = np.bincount(bundle.camera, (residuals**2).sum(axis=1))
    parameters = freedoms + len(noise.prior) / cameras
    least = CORNER_FIT.least_corner_freedom * counts
    independent = squares / np.maximum(2 * counts - parameters, least)
    square = np.maximum(independent, pose_squares / numbers)
    sizes = _next_size(noise.corner, square)
    return np.maximum(sizes, CORNER_FIT.least_corner)


def _next_size(sd: Array, squares: ArrayLike, rate: float = 1.0) -> Array:
    """Sd (k,) after a step, of at most a factor of e^rate, to the roots of squares."""
    change = 0.5 * np.log(np.maximum(squares, 1e-300) / sd**2)
    return sd * np.exp(rate * np.clip(change, -1.0, 1.0))


def _is_settled(before: Noise, after: Noise) -> bool:
    """Whether no size changes much."""
    is_sized = np.isfinite(before.prior)
    priors = after.prior[is_sized] / before.prior[is_sized]
    ratios = [priors, after.corner / before.corner, after.error / before.error]
    changes = np.abs(np.log(np.concatenate(ratios)))
    return bool(changes.max() < CORNER_FIT.settled)
