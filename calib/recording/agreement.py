"""Agreement: the fit of the pictures that agree; the names of the others are reported."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import rms
from ..errors import LogError
from .board import LEAST_PICTURES
from .fit import CornerFit
from .problem import Problem
from .start import agreeing_pictures


@dataclass(frozen=True)
class AgreementSettings:
    """When pictures agree."""

    # error of a picture, over the median one or the noise of corners, beyond which it is of another
    # motion
    far: float = 6.0
    rounds: int = 5
    half: int = 8  # motions that one half of the pictures has at least
    # noise of motions' turns [rad] and shifts [m] beyond which parts of the pictures are fitted
    doubtful: tuple[float, float] = (radians(0.2), 1e-3)
    # score of a part, over that of all pictures, below which the part is taken
    better: float = 0.3
    share: float = 0.4  # of the pictures that must agree
    folds: int = 5
    # motions below which held-out pictures do not choose between fits
    few: int = 8
    # [rad], initial noise of turns in a second fit.  Noise has several optima: on a real KUKA the
    # one of largest evidence missed held-out pictures by 1.24 px, another one by .96.
    small_turn: float = 3e-4
    # held-out error of the second fit over that of the first, below which it is taken; at 1 the
    # camera's turns were 2 % worse
    clearly: float = 0.9
    # log of the ratio of both fits' noise of turns, below which they are the same
    same: float = 0.1
    # largest plausible noise of corners [px], turns [rad] and shifts [m]
    corner: float = 5.0
    turn: float = radians(3.0)
    shift: float = 0.03


AGREEMENT = AgreementSettings()


@dataclass(frozen=True, eq=False)
class Agreement:
    """A fit, and the motions that agree with it."""

    fit: CornerFit
    agreeing: Mask  # (n,)
    score: float  # rms error of these [px] over their share of all

    @property
    def is_doubtful(self) -> bool:
        """Whether motions are so noisy that some pictures may contradict the others."""
        turn, shift = AGREEMENT.doubtful
        return self.fit.noise.turn > turn or self.fit.noise.shift > shift


def consensus(problem: Problem) -> tuple[CornerFit, Mask]:
    """The fit of the pictures that agree, and their mask (n,); LogError if too few agree."""
    number = np.arange(problem.count)
    agreements = _agreements(problem, [number >= 0])
    if not agreements or agreements[0].is_doubtful:
        some = [_agreeing_start(problem)]
        # a board that was moved once leaves one half whole
        half = problem.count // 2
        if half >= AGREEMENT.half:
            some += [number < half, number >= half]
        agreements += _agreements(problem, some)
    if not agreements:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row is of its "
            "picture, that it is this robot and its tip carries what is in the hand, and that "
            "camera and board were not moved"
        )
    # a part of the pictures has to fit far better, since few always fit well
    first = agreements[0]
    best = min(agreements, key=lambda agreement: agreement.score)
    if best.score >= AGREEMENT.better * first.score:
        best = first
    return _best_predicting(problem, best), best.agreeing


def _best_predicting(problem: Problem, agreement: Agreement) -> CornerFit:
    """The agreement's fit, or one from smaller turns if that predicts pictures clearly better."""
    fit = agreement.fit
    agreeing = agreement.agreeing
    if agreeing.sum() < AGREEMENT.few:
        return fit
    start = problem.start.with_turn(AGREEMENT.small_turn)
    try:
        other = problem.solve(np.flatnonzero(agreeing), start)
    except np.linalg.LinAlgError:
        return fit
    ratio = other.noise.turn / fit.noise.turn
    if abs(np.log(ratio)) < AGREEMENT.same:
        return fit
    miss = rms(held_out_misses(problem, fit, agreeing)[agreeing])
    other_miss = rms(held_out_misses(problem, other, agreeing)[agreeing])
    return other if other_miss < AGREEMENT.clearly * miss else fit


def _agreeing_start(problem: Problem) -> Mask:
    """The motions (n,) that agree with a closed form of few pictures of the fullest camera."""
    view = max(problem.views, key=lambda view: len(view.rows))
    motions = problem.bundle.motions
    flange = motions.poses(
        problem.start.unknowns.values[problem.bundle.layout.arm]
    )
    agreeing = np.ones(problem.count, bool)
    agreeing[view.rows] = agreeing_pictures(flange[view.rows], view)
    return agreeing


def _agreements(problem: Problem, some: list[Mask]) -> list[Agreement]:
    """The fits that succeed of motions that agree with some (n,)."""
    attempts = [_agreement(problem, mask) for mask in some]
    return [attempt for attempt in attempts if attempt is not None]


def _agreement(problem: Problem, agreeing: Mask) -> Agreement | None:
    """The fit of all motions that agree with some (n,); None where it fails."""
    for _ in range(AGREEMENT.rounds):
        if agreeing.sum() < LEAST_PICTURES:
            return None
        try:
            fit = problem.solve(np.flatnonzero(agreeing), problem.start)
        except np.linalg.LinAlgError:
            return None
        misses = problem.bundle.usual_misses(problem.predict(fit))
        usual = max(np.median(misses[agreeing]), fit.noise.corner.max())
        before = agreeing
        agreeing = misses < AGREEMENT.far * usual
        if (agreeing == before).all():
            break
    noise = fit.noise
    is_arm = noise.turn < AGREEMENT.turn and noise.shift < AGREEMENT.shift
    is_of_poses = [view.is_of_poses for view in problem.views]
    is_sharp = (noise.corner < AGREEMENT.corner) | is_of_poses
    share = before.mean()
    if not is_arm or not is_sharp.all() or share < AGREEMENT.share:
        return None
    return Agreement(fit, before, rms(misses[before]) / share)


def held_out_misses(problem: Problem, fit: CornerFit, agreeing: Mask) -> Array:
    """Rms miss (n,) [px] of the corners at each motion by fits that did not use it.

    Motions that do not agree are predicted by the fit itself.
    """
    rows = np.flatnonzero(agreeing)
    pixels = problem.predict(fit)
    folds = np.arange(len(rows)) % min(AGREEMENT.folds, len(rows))
    for fold in np.unique(folds):
        is_out = folds == fold
        others = problem.solve(rows[~is_out], fit, learn=False)
        corners = np.isin(problem.bundle.motion, rows[is_out])
        pixels[corners] = problem.predict(others)[corners]
    return problem.bundle.misses(pixels)
