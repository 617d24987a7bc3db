"""Agreement: the fit is of the pictures that agree, the others are left out by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..errors import LogError
from .bundle import Bundle, rms_by_motion
from .fit import STEPS, Estimate, Fit, Prior, motion_errors, solve


@dataclass(frozen=True)
class Settings:
    """When pictures agree."""

    least: int = 4  # motions that a fit needs
    # of chi-squared with six numbers: its median, and 1.5 times its quantile of 1e-5
    median: float = 5.35
    rare: float = 50.0
    rounds: int = 5
    half: int = 8  # motions that one half of the pictures has at least
    # of the variance of some error, that the halves explain
    split: float = 0.25
    # of the misses: one half by itself fits so much better
    better: float = 0.15
    share: float = 0.4  # of the pictures that must agree
    folds: int = 5
    steps: int = 5  # of a fit to the other folds, which begins at that to all
    # noise that no camera and no arm has [px, rad, m]
    corner: float = 5.0
    turn: float = float(np.radians(3.0))
    shift: float = 0.03


SETTINGS = Settings()


@dataclass(frozen=True, eq=False)
class Problem:
    """All pictures, what is known before them, and where their fit begins."""

    bundle: Bundle
    prior: Prior
    start: Estimate

    def solve(
        self,
        rows: Index,
        start: Estimate,
        steps: int = STEPS,
        *,
        learn: bool = True,
    ) -> Fit:
        """The fit to the pictures of some motions."""
        begin = Estimate(start.unknowns.without_errors(len(rows)), start.noise)
        return solve(
            self.bundle.take(rows), self.prior, begin, steps, learn=learn
        )

    def predict(self, fit: Fit) -> list[Array]:
        """Pixels (N, 2) of each camera's corners where the motions alone put them."""
        count = self.bundle.motions.count
        return self.bundle.predict(fit.unknowns.without_errors(count))

    def distances(self, fit: Fit) -> Array:
        """Squared distance (n,) of each motion's errors from none, over what is usual."""
        count = self.bundle.motions.count
        still = Fit(
            fit.unknowns.without_errors(count),
            fit.noise,
            fit.covariance,
            fit.freedom,
        )
        errors, covariance = motion_errors(self.bundle, still)
        covariance = covariance + np.diag(fit.noise.error[:6] ** 2)
        pull = np.linalg.solve(covariance, errors[:, :, None])[:, :, 0]
        return np.asarray((errors * pull).sum(axis=1))


def agreed(problem: Problem) -> tuple[Fit, Mask]:
    """The fit of the pictures that agree, and which these are (n,).

    Raises LogError if too few do.
    """
    number = np.arange(problem.bundle.motions.count)
    half = len(number) // 2
    fits: list[tuple[Fit, Mask]] = []
    scores: list[float] = []
    # a board that was moved once leaves one half whole
    for start in (number >= 0, number < half, number >= half):
        if fits and not _is_split(problem, *fits[0]):
            break
        fit, agreeing = _grow(problem, start)
        if (
            fit is None
            or agreeing.mean() < SETTINGS.share
            or not _is_possible(fit)
        ):
            continue
        fits.append((fit, agreeing))
        misses = rms_by_motion(problem.bundle.cameras, problem.predict(fit))
        rms = float(np.sqrt(np.mean(misses[agreeing] ** 2)))
        scores.append(rms / float(agreeing.mean()))
    if not fits:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row is of its "
            "picture, whether it is this robot, and that camera and board were not moved"
        )
    # one half by itself has to fit far better, since few pictures always fit well
    best = int(np.argmin(scores))
    return fits[best if scores[best] < SETTINGS.better * scores[0] else 0]


def _is_split(problem: Problem, fit: Fit, agreeing: Mask) -> bool:
    """Whether the errors of the motions differ from one half of the pictures to the other."""
    late = np.flatnonzero(agreeing) >= len(agreeing) // 2
    if len(agreeing) < 2 * SETTINGS.half or late.all() or not late.any():
        return False
    flange = problem.bundle.motions.poses(
        fit.unknowns.values[problem.bundle.layout.arm_values]
    )
    turns = flange[agreeing, :3, :3]
    errors = fit.unknowns.errors
    # a board that moved is the same error in the base's axes, a camera in the flange's
    in_base = np.einsum("nij,nj->ni", turns, errors[:, :3])
    in_flange = np.einsum("nji,nj->ni", turns, errors[:, 3:6])
    errors = np.concatenate([errors, in_base, in_flange], axis=1)
    errors = errors - errors.mean(axis=0)
    along = late - late.mean()
    shares = (along @ errors) ** 2 / (along @ along) / (errors**2).sum(axis=0)
    return bool(shares.max() > SETTINGS.split)


def _grow(problem: Problem, start: Mask) -> tuple[Fit | None, Mask]:
    """The fit of all that agree with those that it begins with; None where it fails."""
    grown: tuple[Fit | None, Mask] = (None, start)
    agreeing = start
    for _ in range(SETTINGS.rounds):
        if agreeing.sum() < SETTINGS.least:
            break
        try:
            fit = problem.solve(np.flatnonzero(agreeing), problem.start)
            distances = problem.distances(fit)
        except np.linalg.LinAlgError:
            break
        grown = fit, agreeing
        usual = max(
            float(np.median(distances[agreeing])) / SETTINGS.median, 1.0
        )
        before = agreeing
        agreeing = distances < SETTINGS.rare * usual
        if (agreeing == before).all():
            break
    return grown


def _is_possible(fit: Fit) -> bool:
    """Whether some camera and some arm are as noisy."""
    noise = fit.noise
    is_arm = noise.turn < SETTINGS.turn and noise.shift < SETTINGS.shift
    return bool(is_arm and noise.corner.max() < SETTINGS.corner)


def held_out(problem: Problem, fit: Fit, agreeing: Mask) -> list[Array]:
    """Pixels (N, 2) of each camera's corners by fits that did not use their motions.

    Motions that do not agree are predicted by the fit itself.
    """
    rows = np.flatnonzero(agreeing)
    pixels = problem.predict(fit)
    folds = np.arange(len(rows)) % min(SETTINGS.folds, len(rows))
    for fold in range(folds.max() + 1):
        others = problem.solve(
            rows[folds != fold], fit, SETTINGS.steps, learn=False
        )
        out = rows[folds == fold]
        cameras = zip(
            problem.bundle.cameras, pixels, problem.predict(others), strict=True
        )
        for camera, whole, predicted in cameras:
            is_out = np.isin(camera.motion, out)
            whole[is_out] = predicted[is_out]
    return pixels
