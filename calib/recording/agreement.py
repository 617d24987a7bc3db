"""Which pictures agree: the fit is of these, the others are left out by name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..errors import LogError
from .bundle import LENS, Bundle, Fit, Layout, Motions, Noise, Scale, Shots, Unknowns

LEAST = 4
"""Motions that a fit needs."""

# of chi-squared with six numbers; 1.5 times its quantile of 1e-5
_MEDIAN = 5.35
_RARE = 50.0
_HALF = 8  # motions that one half of the pictures has at least
_ROUNDS = 5
_BETTER = 0.15  # of the misses: one half of the pictures fits so much better by itself
_SHARP = 0.5  # px, from which one half of the pictures may fit better
_LEAST_SHARE = 0.4  # of the pictures that must agree
_FOLDS = 5
_FINAL_STEPS = 8
_WORST_CORNER = 5.0  # [px], and
_WORST_POSE = np.array(
    [np.radians(3.0), 0.03]
)  # [rad, m]: noise that no camera and no arm has


@dataclass(frozen=True, eq=False)
class Problem:
    """All pictures, and where their fit begins."""

    shots: tuple[Shots, ...]  # of each camera
    motions: Motions
    scales: tuple[Scale, ...]
    start: Unknowns
    noise: Noise
    mean: Array  # (v,), prior mean of the values

    @property
    def layout(self) -> Layout:
        """Where the unknowns stand."""
        return Bundle(self.shots, self.motions, self.scales).layout

    def bundle(self, rows: Index) -> Bundle:
        """The pictures of some motions."""
        shots = [each.take(rows) for each in self.shots]
        return Bundle(shots, self.motions.take(rows), self.scales)

    def solve(self, rows: Index, near: Fit | None = None, *, learn: bool = True) -> Fit:
        """The fit to the pictures of some motions."""
        unknowns = self.start if near is None else near.unknowns
        unknowns = replace(unknowns, errors=np.zeros((len(rows), 6)))
        noise = self.noise if near is None else near.noise
        steps = {} if learn else {"steps": _FINAL_STEPS}
        return self.bundle(rows).solve(unknowns, noise, self.mean, learn=learn, **steps)

    def misses(self, fit: Fit, rows: Index) -> Array:
        """Rms distance [px] of each motion's corners from where the motion alone puts them."""
        bundle = self.bundle(rows)
        still = replace(fit.unknowns, errors=np.zeros((len(rows), 6)))
        squares = np.zeros(len(rows))
        counts = np.zeros(len(rows))
        for camera, pixels in zip(bundle.cameras, bundle.predict(still), strict=True):
            away = ((camera.corners - pixels) ** 2).sum(axis=1)
            squares += np.bincount(camera.motion, away, len(rows))
            counts += np.bincount(camera.motion, minlength=len(rows))
        return np.sqrt(squares / np.maximum(counts, 1))

    def distances(self, fit: Fit) -> Array:
        """Squared distance (n,) of each motion's errors from none, over what is usual."""
        rows = np.arange(self.motions.count)
        bundle = self.bundle(rows)
        still = replace(
            fit, unknowns=replace(fit.unknowns, errors=np.zeros((len(rows), 6)))
        )
        errors, covariance = bundle.motion_errors(still)
        covariance = covariance + np.diag(np.repeat(fit.noise.pose**2, 3))
        pull = np.linalg.solve(covariance, errors[:, :, None])[:, :, 0]
        return np.asarray((errors * pull).sum(axis=1))


def agreed(problem: Problem) -> tuple[Fit, Mask]:
    """The fit of the pictures that agree, and which these are (n,).

    Raises LogError if too few do.
    """
    number = np.arange(problem.motions.count)
    half = len(number) // 2
    found: list[tuple[Fit, Mask]] = []
    # a board that was moved once leaves one half whole
    for start in (number >= 0, number < half, number >= half):
        if len(found) and (half < _HALF or _sharp(problem, *found[0])):
            break
        grown = _grown(problem, start)
        if (
            grown is not None
            and grown[1].mean() >= _LEAST_SHARE
            and _possible(grown[0])
        ):
            found.append(grown)
    if not found:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row is of its "
            "picture, whether it is this robot, and that camera and board were not moved"
        )
    # one half by itself has to fit far better, since few pictures always fit well
    scores = [_miss(problem, fit, kept) / kept.mean() for fit, kept in found]
    best = int(np.argmin(scores))
    if scores[best] > _BETTER * scores[0]:
        best = 0
    return found[best]


def _sharp(problem: Problem, fit: Fit, kept: Mask) -> bool:
    """Whether most pictures agree, and well."""
    return bool(kept.mean() > 0.5) and _miss(problem, fit, kept) < _SHARP


def _miss(problem: Problem, fit: Fit, kept: Mask) -> float:
    """The median picture's miss [px]."""
    return float(np.median(problem.misses(fit, np.flatnonzero(kept))))


def _possible(fit: Fit) -> bool:
    """Whether some camera and some arm are as noisy."""
    return bool(
        (fit.noise.corner < _WORST_CORNER).all()
        and (fit.noise.pose < _WORST_POSE).all()
    )


def _grown(problem: Problem, kept: Mask) -> tuple[Fit, Mask] | None:
    """The fit of all that agree with those that it begins with; None where it fails."""
    found = None
    for _ in range(_ROUNDS):
        rows = np.flatnonzero(kept)
        if len(rows) < LEAST:
            break
        try:
            fit = problem.solve(rows)
            distances = problem.distances(fit)
        except np.linalg.LinAlgError:
            break
        found = fit, kept
        usual = max(float(np.median(distances[kept])) / _MEDIAN, 1.0)
        before = kept
        kept = distances < _RARE * usual
        if (kept == before).all():
            break
    return found


def held_out(problem: Problem, fit: Fit, kept: Mask) -> Array:
    """Rms misses (n,) [px] of the pictures kept, each predicted by a fit to the other folds."""
    rows = np.flatnonzero(kept)
    misses = np.full(len(rows), np.nan)
    folds = np.arange(len(rows)) % min(_FOLDS, len(rows))
    for fold in range(folds.max() + 1):
        others = rows[folds != fold]
        out = np.flatnonzero(folds == fold)
        misses[out] = problem.misses(problem.solve(others, fit, learn=False), rows[out])
    return misses


def lens_scales(camera: int, focal: float, reach: float, least: Array) -> list[Scale]:
    """Priors of a lens whose sizes the evidence finds.

    reach : distance of the picture's corner from its centre [px]
    least : (9,), how sure a lens is that is known
    """
    edge = reach / focal
    first = LENS * camera
    groups = {
        "focal": (np.arange(2), 0.3 * focal),
        "centre": (np.arange(2, 4), 0.1 * reach),
        "k1": (np.array([4]), 1.0 / edge**2),
        "k2": (np.array([5]), 1.0 / edge**4),
        "tangential": (np.array([6, 7]), 0.05 / edge),
        "k3": (np.array([8]), 1.0 / edge**6),
    }
    scales = []
    for name, (places, most) in groups.items():
        lowest = float(max(least[places].max(), 1e-6 * most))
        scales.append(Scale(name, first + places, lowest, float(most)))
    return scales
