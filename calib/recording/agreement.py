"""Agreement: the fit of the pictures that agree; the others are left out by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Mask
from ..errors import LogError
from .board_pictures import LEAST
from .fit import Fit
from .problem import Problem


@dataclass(frozen=True)
class Settings:
    """When pictures agree."""

    # times the median miss of a picture, or the noise of corners: a picture of another motion
    far: float = 6.0
    rounds: int = 5
    half: int = 8  # motions that one half of the pictures has at least
    # [rad, m], noise of motions from which each half is tried by itself
    doubtful: tuple[float, float] = (float(np.radians(0.2)), 1e-3)
    # of the misses: one half by itself fits so much better
    better: float = 0.3
    share: float = 0.4  # of the pictures that must agree
    folds: int = 5
    # noise that no camera and no arm has [px, rad, m]
    corner: float = 5.0
    turn: float = float(np.radians(3.0))
    shift: float = 0.03


SETTINGS = Settings()


def consensus(problem: Problem) -> tuple[Fit, Mask]:
    """The fit of the pictures that agree, and which these are (n,).

    Raises LogError if too few do.
    """
    number = np.arange(len(problem.rows))
    half = len(number) // 2
    fits = _fits_from(problem, number >= 0)
    if not fits:  # begin without those that the closed form contradicts
        misses = problem.bundle.misses(problem.predict(problem.start))
        fits = _fits_from(problem, misses < SETTINGS.far * np.median(misses))
    is_doubtful = not fits
    if fits and half >= SETTINGS.half:
        noise = fits[0][0].noise.error
        turn, shift = SETTINGS.doubtful
        is_doubtful = noise[0] > turn or noise[3] > shift
    if is_doubtful:  # a board that was moved once leaves one half whole
        fits += _fits_from(problem, number < half)
        fits += _fits_from(problem, number >= half)
    if not fits:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row is of its "
            "picture, that it is this robot and its tip carries what is in the hand, and that "
            "camera and board were not moved"
        )
    scores = []
    for fit, agreeing in fits:
        misses = problem.bundle.misses(problem.predict(fit))
        squares = misses[agreeing] ** 2
        rms = np.sqrt(np.mean(squares))
        scores.append(rms / agreeing.mean())
    # one half by itself has to fit far better, since few pictures always fit well
    best = int(np.argmin(scores))
    is_better = scores[best] < SETTINGS.better * scores[0]
    return fits[best if is_better else 0]


def _fits_from(problem: Problem, agreeing: Mask) -> list[tuple[Fit, Mask]]:
    """The fit of all motions that agree with some (n,), and which agree; none where it fails."""
    for _ in range(SETTINGS.rounds):
        if agreeing.sum() < LEAST:
            return []
        try:
            fit = problem.solve(np.flatnonzero(agreeing), problem.start)
        except np.linalg.LinAlgError:
            return []
        misses = problem.bundle.misses(problem.predict(fit))
        usual = max(np.median(misses[agreeing]), fit.noise.corner.max())
        before = agreeing
        agreeing = misses < SETTINGS.far * usual
        if (agreeing == before).all():
            break
    noise = fit.noise
    is_arm = noise.error[0] < SETTINGS.turn and noise.error[3] < SETTINGS.shift
    is_camera = noise.corner.max() < SETTINGS.corner
    if is_arm and is_camera and before.mean() >= SETTINGS.share:
        return [(fit, before)]
    return []


def held_out_pixels(problem: Problem, fit: Fit, agreeing: Mask) -> Array:
    """Pixels (N, 2) of all corners by fits that did not use their motions.

    Motions that do not agree are predicted by the fit itself.
    """
    rows = np.flatnonzero(agreeing)
    pixels = problem.predict(fit)
    folds = np.arange(len(rows)) % min(SETTINGS.folds, len(rows))
    for fold in np.unique(folds):
        is_out = folds == fold
        others = problem.solve(rows[~is_out], fit, learn=False)
        corners = np.isin(problem.bundle.motion, rows[is_out])
        pixels[corners] = problem.predict(others)[corners]
    return pixels
