"""The smooth part of a correction: few coefficients, so that few samples settle it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.robust import solve
from .features import Chain, Frame

Array = NDArray[np.float64]
Folds = list[NDArray[np.intp]]
Old = Callable[[Array], Array]
"""The old map: joints of the unit box (n, dof) to positions (n, 2)."""


@dataclass(frozen=True, eq=False)
class Smooth:
    """An old map and a linear correction of it.

    Attributes
    ----------
    name : str
        What is corrected.
    old : callable
        The old map.
    frame : Frame or None
        Polynomials of the old map's positions that replace them; None keeps them.
    moved : (terms, 2) array
        Coefficients of the frame.
    chain : Chain or None
        Links whose change is added.
    added : (terms, 2) array
        Coefficients of the chain.
    gram : (p, p) array
        Inverse of the features' second moments, all features side by side.
    noise : float [unit]
        Standard deviation per axis of what is left over.
    shift : float [unit]
        Root mean square correction where there were samples.
    errors : (n,) array [unit]
        Distance of each sample to what is said of it without its fold.
    leverage : (n,) array
        How much each sample determines what is said of it.
    """

    name: str
    old: Old
    frame: Frame | None
    moved: Array
    chain: Chain | None
    added: Array
    gram: Array
    noise: float
    shift: float
    errors: Array
    leverage: Array

    @property
    def terms(self) -> int:
        """Number of coefficients per axis."""
        return len(self.gram)

    def value(self, u: Array) -> Array:
        """Positions (n, 2) at the points `u` (n, dof) of the unit box.

        Where samples are far the coefficients may say little; the correction is then
        shrunk by the share of it that is no error (a Wiener filter), so that in the worst
        case the old map stays.
        """
        old = self.old(u)
        new = self._fitted(u, old)
        if not self.terms:
            return new
        doubt = self.doubt(u)[:, None]
        # what is far beyond any sample cannot count more than what was seen
        keep = self.shift**2 / (self.shift**2 + 2.0 * doubt**2 + 1e-300)
        return np.asarray(old + keep * (new - old))

    def doubt(self, u: Array) -> Array:
        """Standard deviation per axis of the correction at `u`, (n,)."""
        if not self.terms:
            return np.zeros(len(u))
        features = self._features(u, self.old(u))
        power = np.einsum("ni,ij,nj->n", features, self.gram, features)
        return np.asarray(self.noise * np.sqrt(np.maximum(power, 0.0)))

    def _fitted(self, u: Array, old: Array) -> Array:
        new = old if self.frame is None else self.frame.values(old) @ self.moved
        return new if self.chain is None else new + self.chain.values(u) @ self.added

    def _features(self, u: Array, old: Array) -> Array:
        parts = [] if self.frame is None else [self.frame.values(old)]
        parts += [] if self.chain is None else [self.chain.values(u)]
        return np.concatenate(parts, axis=1)


def fit_smooth(
    old: Old,
    frame: Frame | None,
    chain: Chain | None,
    u: Array,
    x: Array,
    folds: Folds,
) -> Smooth:
    """Fit the frame, then what a change of the links explains of the rest.

    Parameters
    ----------
    old : callable
        The old map.
    frame, chain : Frame, Chain or None
        What may have changed.
    u, x : (n, dof), (n, 2) array
        Joints in the unit box and positions, without outliers.
    folds : list of (m,) int array
        Rows that are held out together.
    """
    said = old(u)
    name = " and ".join(
        n
        for n, part in (
            ("nothing", frame is None and chain is None),
            ("sensor frame", frame is not None and frame.degree == 1),
            (
                f"sensor frame bent (degree {frame.degree if frame else 0})",
                frame is not None and frame.degree > 1,
            ),
            ("links", chain is not None),
        )
        if part
    )
    n = len(u)
    loo = x - said
    moved = added = np.zeros((0, 2))
    leverage = np.zeros(n)
    parts = []
    fitted = said
    if frame is not None:
        features = frame.values(said)
        moved = solve(features, x)
        fitted = features @ moved
        loo, leverage = _held_out(features, x, folds)
        parts.append(features)
    if chain is not None:
        features = chain.values(u)
        rest = x - fitted
        added = solve(features, rest)
        fitted = fitted + features @ added
        # the same folds for both steps: features of both, side by side
        parts.append(features)
        together = np.concatenate(parts, axis=1)
        loo, leverage = _held_out(together, x - (said if frame is None else 0.0), folds)
    features = np.concatenate(parts, axis=1) if parts else np.zeros((n, 0))
    gram, rank = _inverse_gram(features)
    left = x - fitted
    noise = float(np.sqrt(np.sum(left**2) / (2.0 * max(n - rank, 1))))
    shift = float(np.sqrt(np.mean(np.sum((fitted - said) ** 2, axis=1))))
    return Smooth(
        name,
        old,
        frame,
        moved,
        chain,
        added,
        gram,
        noise,
        shift,
        np.linalg.norm(loo, axis=1),
        leverage,
    )


def _inverse_gram(features: Array) -> tuple[Array, int]:
    if not features.shape[1]:
        return np.zeros((0, 0)), 0
    values, vectors = np.linalg.eigh(features.T @ features)
    keep = values > _COLLINEAR * values[-1]
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    return inverse, int(np.count_nonzero(keep))


_COLLINEAR = 1e-9


def _held_out(features: Array, x: Array, folds: Folds) -> tuple[Array, Array]:
    """Residuals (n, 2) of each fold from a fit to the others, and the leverages (n,)."""
    left, size, _ = np.linalg.svd(
        features / np.maximum(np.linalg.norm(features, axis=0), 1e-300), full_matrices=False
    )
    basis = left[:, size > np.sqrt(_COLLINEAR) * size[0]]
    residual = x - basis @ (basis.T @ x)
    result = np.empty_like(residual)
    for rows in folds:
        part = basis[rows]
        # (I - B B')^-1 r = r + B (I - B' B)^-1 B' r
        within = np.eye(part.shape[1]) - part.T @ part
        result[rows] = (
            residual[rows] + part @ np.linalg.lstsq(within, part.T @ residual[rows], rcond=1e-12)[0]
        )
        # a row that alone determines a coefficient has no answer
        worst = np.sum(part**2, axis=1) > 1 - 1e-9
        result[rows[worst]] = x[rows[worst]]
    return result, np.sum(basis**2, axis=1)
