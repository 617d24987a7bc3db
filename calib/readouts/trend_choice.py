"""Choice of the trend: functions, degree and ridge that cross-validation prefers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..scale import TURN, Scale
from .basis import Basis, largest_degree, largest_harmonic
from .trend import Trend

Array = NDArray[np.float64]
Folds = list[NDArray[np.intp]]

_TERMS = (90, 300)  # most functions of two joints, of more
_RIDGES = (1e-12, 1e-6)  # of the mean power of a term, at total degree 3
_FLOOR = 1e-6  # share of the extent that counts as exact for a trend


@dataclass(frozen=True)
class TrendChoice:
    """A trend and its twins that have not seen one fold each.

    Attributes
    ----------
    trend : Trend
        Fitted to all samples.
    without : list of Trend
        Fitted to all samples but those of one fold, in the order of the folds.
    """

    trend: Trend
    without: list[Trend]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Second moments of one basis, in all and per fold."""

    basis: Basis
    features: Array
    folds: list[tuple[Array, Array]]

    @staticmethod
    def of(basis: Basis, u: Array, x: Array, folds: Folds) -> _Moments:
        features = basis.values(u)
        return _Moments(
            basis, features, [(features[b].T @ features[b], features[b].T @ x[b]) for b in folds]
        )

    @cached_property
    def _all(self) -> tuple[Array, Array]:
        gram, moment = (np.sum(part, axis=0) for part in zip(*self.folds, strict=True))
        return gram, moment

    def solve(self, degree: int, ridge: float, without: int | None = None) -> Array:
        """Coefficients of the functions up to a total degree, by ridge regression.

        The ridge is steep in the degree of a function: a smooth trend is likelier.
        """
        gram, moment = self._all
        if without is not None:
            gram, moment = gram - self.folds[without][0], moment - self.folds[without][1]
        t = self.basis.terms(degree)
        a = gram[:t, :t].copy()
        diagonal = np.einsum("ii->i", a)
        diagonal += ridge * diagonal.mean() * (np.maximum(self.basis.totals[:t], 1) / 3.0) ** 4
        return np.asarray(np.linalg.solve(a, moment[:t]))

    def errors(self, x: Array, folds: Folds) -> dict[tuple[int, float], Array]:
        """Mean distance in each held-out fold for each (degree, ridge)."""
        result = {}
        for degree in range(1, self.basis.degree + 1):
            t = self.basis.terms(degree)
            for ridge in _RIDGES:
                said = [
                    self.features[b, :t] @ self.solve(degree, ridge, f) for f, b in enumerate(folds)
                ]
                result[degree, ridge] = np.array(
                    [
                        float(np.linalg.norm(x[b] - y, axis=1).mean())
                        for b, y in zip(folds, said, strict=True)
                    ]
                )
        return result


def choose_trends(
    scale: Scale, turning: tuple[bool, ...], u: Array, x: Array, folds: Folds
) -> list[TrendChoice]:
    """Fit the simplest trends that predict held-out folds as well as the best, or nearly.

    The first may be half again as far off as the best, which local models often mend
    without its risk between and beyond the samples; the second is as good as the best
    but for chance.

    Parameters
    ----------
    scale : Scale
        Range of the joints.
    turning : tuple of bool
        Joints that turn: their harmonics are tried beside polynomials.
    u, x : (n, dof), (n, 2) array
        Joints in the unit box and positions.
    folds : list of (m,) int array
        Rows that are held out together.
    """
    floor = _FLOOR * float(np.linalg.norm(np.ptp(x, axis=0)))
    tried: list[tuple[_Moments, int, float, Array]] = []
    for turns in _families(scale, turning):
        most = _TERMS[len(turns) > 2]
        moments = _Moments.of(_largest_basis(turns, min(most, len(u) // 2)), u, x, folds)
        for choice, error in moments.errors(x, folds).items():
            tried.append((moments, *choice, np.maximum(error, floor)))
    choices = []
    for moments, degree, ridge in dict.fromkeys((_simplest(tried, 0.5), _simplest(tried, 0.0))):
        small = Basis(moments.basis.turns, degree, moments.basis.each)
        without = [Trend(small, moments.solve(degree, ridge, fold)) for fold in range(len(folds))]
        choices.append(TrendChoice(Trend(small, moments.solve(degree, ridge)), without))
    return choices


def _families(scale: Scale, turning: tuple[bool, ...]) -> list[tuple[float, ...]]:
    """What each coordinate is made of: polynomials (0) or harmonics of an angle [rad]."""
    whole = tuple(TURN if p else 0.0 for p in scale.periodic)
    harmonic = tuple(float(s) if t else 0.0 for s, t in zip(scale.span, turning, strict=True))
    return list(dict.fromkeys([harmonic, whole]))


def _largest_basis(turns: tuple[float, ...], terms: int) -> Basis:
    """Largest basis with at most so many terms."""
    degree = max(1, largest_degree(len(turns), max(3, terms)))
    degree = min([degree, *(max(1, largest_harmonic(t)) for t in turns if t)])
    basis = Basis(turns, degree)
    while basis.degree > 1 and len(basis.orders) > terms:
        basis = Basis(turns, basis.degree - 1)
    return basis


def _simplest(
    tried: list[tuple[_Moments, int, float, Array]], slack: float
) -> tuple[_Moments, int, float]:
    """Fewest terms that are as good as the best but for slack and chance (standard error)."""
    best = min(tried, key=lambda c: float(c[3].mean()))[3]

    def as_good(error: Array) -> bool:
        worse = error - best
        chance = worse.std() / np.sqrt(len(worse))
        return bool(worse.mean() <= slack * best.mean() + chance)

    good = [c for c in tried if as_good(c[3])]
    moments, degree, ridge, _ = min(
        good, key=lambda c: (c[0].basis.terms(c[1]), float(c[3].mean()))
    )
    return moments, degree, ridge
