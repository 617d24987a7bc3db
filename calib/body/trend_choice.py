"""Choice of the trend: functions, degree and ridge that cross-validation prefers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.scale import TURN, Scale
from .basis import Basis, largest_degree, largest_harmonic
from .trend import Trend

_Folds = list[NDArray[np.intp]]

_TERMS = (90, 300)  # most functions of two joints, of more
_RIGID = 2200  # most functions of a chain of rigid links: seven joints that turn
_LARGE = 500  # functions from which on only a few choices are tried, on fewer rows
_RIDGES = (1e-12, 1e-6)  # of the mean power of a term, at total degree 3
_FLOOR = 1e-6  # share of the extent that counts as exact for a trend


@dataclass(frozen=True)
class TrendChoice:
    """A trend and its twins that have not seen one fold each."""

    trend: Trend  # fitted to all samples
    without: list[Trend]  # fitted to all samples but those of one fold, in the order of the folds


@dataclass(frozen=True, eq=False)
class _Moments:
    """Second moments of one basis, in all and per fold."""

    basis: Basis
    u: Array
    folds: list[tuple[Array, Array]]

    @staticmethod
    def of(basis: Basis, u: Array, x: Array, folds: _Folds) -> _Moments:
        parts = []
        for rows in folds:
            if len(basis.orders) > _LARGE:  # four rows a term are enough
                few = max(1, len(u) // (4 * len(basis.orders)))
                rows = rows[::few]
            features = basis.values(u[rows])
            parts.append((features.T @ features, features.T @ x[rows]))
        return _Moments(basis, u, parts)

    @cached_property
    def _all(self) -> tuple[Array, Array]:
        gram, moment = (np.sum(part, axis=0) for part in zip(*self.folds, strict=True))
        return gram, moment

    def solve(self, degree: int, ridge: float, without: int | None = None) -> Array:
        """Coefficients of the functions up to a total degree, by ridge regression.

        The ridge is steep in the degree of a function: a smooth trend is likelier.
        """
        key = degree, ridge, without
        if key in self._solved:
            return self._solved[key]
        gram, moment = self._all
        if without is not None:
            gram, moment = gram - self.folds[without][0], moment - self.folds[without][1]
        t = self.basis.terms(degree)
        a = gram[:t, :t].copy()
        diagonal = np.einsum("ii->i", a)
        diagonal += ridge * diagonal.mean() * (np.maximum(self.basis.totals[:t], 1) / 3.0) ** 4
        self._solved[key] = found = np.asarray(np.linalg.solve(a, moment[:t]))
        return found

    @cached_property
    def _solved(self) -> dict[tuple[int, float, int | None], Array]:
        return {}

    def errors(self, x: Array, folds: _Folds) -> dict[tuple[int, float], Array]:
        """Mean distance in each held-out fold for each (degree, ridge)."""
        large = len(self.basis.orders) > _LARGE
        degrees = [self.basis.degree] if large else range(1, self.basis.degree + 1)
        ridges = _RIDGES[:1] if large else _RIDGES
        result: dict[tuple[int, float], list[float]] = {(d, r): [] for d in degrees for r in ridges}
        for fold, rows in enumerate(folds):
            features = self.basis.values(self.u[rows])
            for (degree, ridge), errors in result.items():
                predicted = features[:, : self.basis.terms(degree)] @ self.solve(
                    degree, ridge, fold
                )
                errors.append(float(np.linalg.norm(x[rows] - predicted, axis=1).mean()))
        return {choice: np.array(errors) for choice, errors in result.items()}


def choose_trends(
    scale: Scale, turning: tuple[bool, ...], u: Array, x: Array, folds: _Folds
) -> list[TrendChoice]:
    """Fit the simplest trends that predict held-out folds as well as the best, or nearly.

    The first may be half again as far off as the best, which local models often mend
    without its risk between and beyond the samples; the second is as good as the best
    but for chance.

    scale : range of the joints
    turning : joints that turn: their harmonics are tried beside polynomials
    u, x : (n, dof), (n, 2), joints in the unit box and positions
    folds : list of (m,) int array, rows that are held out together
    """
    floor = _FLOOR * float(np.linalg.norm(np.ptp(x, axis=0)))
    tried: list[tuple[_Moments, int, float, Array]] = []
    for basis in _bases(scale, turning, len(u) // 2):
        moments = _Moments.of(basis, u, x, folds)
        for choice, error in moments.errors(x, folds).items():
            tried.append((moments, *choice, np.maximum(error, floor)))
    choices = []
    for moments, degree, ridge in dict.fromkeys((_simplest(tried, 0.5), _simplest(tried, 0.0))):
        small = Basis(moments.basis.turns, degree, moments.basis.each)
        without = [Trend(small, moments.solve(degree, ridge, fold)) for fold in range(len(folds))]
        choices.append(TrendChoice(Trend(small, moments.solve(degree, ridge)), without))
    return choices


def _bases(scale: Scale, turning: tuple[bool, ...], terms: int) -> list[Basis]:
    """What a trend may be made of: polynomials, harmonics, and a chain of rigid links.

    Of many joints the harmonics that fit are few.  But whatever hangs on a joint that turns
    moves on a circle and is affine in the cosine and sine of its angle, on a slide in its
    position; the products of such functions are all that a rigid chain needs.
    """
    dof, most = len(turning), min(_TERMS[len(turning) > 2], terms)
    whole = tuple(TURN if p else 0.0 for p in scale.periodic)
    harmonic = tuple(float(s) if t else 0.0 for s, t in zip(scale.span, turning, strict=True))
    bases = [_largest_basis(turns, most) for turns in dict.fromkeys([harmonic, whole])]
    if dof > 3 and 3 ** sum(turning) * 2 ** (dof - sum(turning)) <= min(terms, _RIGID):
        bases.append(Basis(harmonic, dof, each=1))
    return bases


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
