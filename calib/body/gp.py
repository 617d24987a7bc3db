"""A Gaussian process: the teacher of a map whose log has fewer rows than the map has nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale

Array = NDArray[np.float64]

MOST_ROWS = 500
"""Rows that the hyperparameters are fitted to: the cost grows with their cube."""

_LINEAR = 30.0  # variance of the constant and of each slope: next to no prior
_OUTLIER = 6.0  # medians of surprise beyond which a row contradicts its neighbours


@dataclass(frozen=True)
class GaussianProcess:
    """Regression of positions on joints (Rasmussen and Williams 2006, chapter 2).

    A linear function plus a squared exponential with one length scale per joint; periodic
    joints enter as the chord of their circle.  Both coordinates share the kernel.

    Attributes
    ----------
    u : (n, d) array
        Rows that it rests on, joints in the unit box.
    mean : (2,) array [unit]
        Subtracted from the positions.
    unit : float [unit]
        Positions are divided by it.
    lengths : (d,) array
        Length scales in the unit box.
    signal, noise : float
        Variances of the function and of a measurement, in units of `unit` squared.
    alpha : (n, 2) array
        K^-1 y.
    inverse : (n, n) array
        K^-1.
    scale : Scale
        Knows the periodic joints.
    """

    u: Array
    mean: Array
    unit: float
    lengths: Array
    signal: float
    noise: float
    alpha: Array
    inverse: Array
    scale: Scale

    def value(self, u: Array) -> Array:
        """Posterior mean at `u` (n, d), (n, 2)."""
        parts = np.array_split(u, max(1, len(u) // 4000))
        return np.concatenate(
            [self.mean + self.unit * (self._cross(p) @ self.alpha) for p in parts]
        )

    def deviation(self, u: Array) -> Array:
        """Posterior standard deviation of a measurement per axis at `u`, (n,)."""
        from scipy.linalg import cholesky, solve_triangular

        root = cholesky(self._cross(self.u) + self.noise * np.eye(len(self.u)), lower=True)
        result = []
        for part in np.array_split(u, max(1, len(u) // 4000)):
            k = self._cross(part)
            prior = self.signal + _LINEAR * (1 + np.sum((part - 0.5) ** 2, axis=1))
            known = np.sum(solve_triangular(root, k.T, lower=True) ** 2, axis=0)
            variance = prior + self.noise - known
            result.append(self.unit * np.sqrt(np.maximum(variance, self.noise)))
        return np.concatenate(result)

    def held_out(self, rows: NDArray[np.intp], x: Array) -> Array:
        """Distance of some rows to what the others say of them, (m,).

        Parameters
        ----------
        rows : (m,) int array
            Rows that are held out together.
        x : (n, 2) array [unit]
            Positions of all rows.
        """
        y = (x - self.mean) / self.unit
        # the residual of rows held out: (K^-1)_bb^-1 (K^-1 y)_b
        gap = np.linalg.solve(self.inverse[np.ix_(rows, rows)], self.inverse[rows] @ y)
        return np.asarray(self.unit * np.linalg.norm(gap, axis=1))

    def _cross(self, u: Array) -> Array:
        square = np.sum(_squares(u, self.u, self.scale) / self.lengths**2, axis=2)
        linear = 1 + (u - 0.5) @ (self.u - 0.5).T
        k: Array = self.signal * np.exp(-0.5 * square) + _LINEAR * linear
        return k


def _squares(u: Array, v: Array, scale: Scale) -> Array:
    """Squared difference of each pair of rows along each joint, (n, m, d)."""
    gap = u[:, None] - v[None]
    if scale.periodic.any():
        gap = np.where(scale.periodic, np.sin(np.pi * gap) / np.pi, gap)
    return gap**2


def fit(
    u: Array, x: Array, scale: Scale, rng: np.random.Generator
) -> tuple[GaussianProcess, NDArray[np.intp]]:
    """Fit a Gaussian process, hyperparameters by marginal likelihood.

    Parameters
    ----------
    u, x : (n, d), (n, 2) array
        Joints in the unit box and measured positions.
    scale : Scale
        Knows the periodic joints.
    rng : Generator
        Draws the rows where there are more than `MOST_ROWS`.

    Returns
    -------
    process : GaussianProcess
    kept : (m,) int array
        Rows that it rests on; those that contradict their neighbours are left out.
    """
    rows = np.arange(len(u))
    if len(rows) > MOST_ROWS:
        rows = np.sort(rng.permutation(rows)[:MOST_ROWS])
    theta = _likeliest(u[rows], x[rows], scale)
    process = _posterior(u[rows], x[rows], scale, theta)
    precision = np.diag(process.inverse)  # one row held out at a time
    error = process.unit * np.linalg.norm(process.alpha, axis=1) / precision
    surprise = error * np.sqrt(precision)  # in predicted standard deviations
    good = (surprise <= _OUTLIER * np.median(surprise)) | (error < 1e-3 * process.unit)
    if len(rows) >= 20 and 0 < np.count_nonzero(~good) <= len(rows) // 5:
        rows = rows[good]
        theta = _likeliest(u[rows], x[rows], scale)
        process = _posterior(u[rows], x[rows], scale, theta)
    return process, rows


def _posterior(u: Array, x: Array, scale: Scale, theta: Array) -> GaussianProcess:
    mean, unit = x.mean(axis=0), float(x.std())
    lengths, signal, noise = np.exp(theta[:-2]), float(np.exp(theta[-2])), float(np.exp(theta[-1]))
    empty = np.zeros((0, 0))
    process = GaussianProcess(u, mean, unit, lengths, signal, noise, empty, empty, scale)
    k = process._cross(u) + noise * np.eye(len(u))
    inverse = np.linalg.inv(k)
    inverse = 0.5 * (inverse + inverse.T)
    return replace(process, alpha=np.linalg.solve(k, (x - mean) / unit), inverse=inverse)


def _likeliest(u: Array, x: Array, scale: Scale) -> Array:
    """Logarithms of length scales, signal and noise variance of the largest likelihood."""
    from scipy.linalg import cho_factor, cho_solve
    from scipy.optimize import minimize

    y = (x - x.mean(axis=0)) / x.std()
    squares = np.moveaxis(_squares(u, u, scale), 2, 0)
    linear = _LINEAR * (1 + (u - 0.5) @ (u - 0.5).T)
    eye = np.eye(len(u))

    def cost(theta: Array) -> tuple[float, Array]:
        lengths, signal, noise = np.exp(theta[:-2]), np.exp(theta[-2]), np.exp(theta[-1])
        smooth = signal * np.exp(-0.5 * np.tensordot(lengths**-2.0, squares, 1))
        try:
            factor = cho_factor(smooth + linear + noise * eye, lower=True)
        except np.linalg.LinAlgError:
            return 1e25, np.zeros_like(theta)
        alpha = cho_solve(factor, y)
        inverse = cho_solve(factor, eye)
        value = 0.5 * np.sum(y * alpha) + y.shape[1] * np.sum(np.log(np.diag(factor[0])))
        # d cost / d theta = -1/2 trace((alpha alpha' - 2 K^-1) dK)
        weight = alpha @ alpha.T - y.shape[1] * inverse
        shared = weight * smooth
        slope = [
            -0.5 * np.sum(shared * s) / length**2
            for s, length in zip(squares, lengths, strict=True)
        ]
        slope += [-0.5 * float(np.sum(shared)), -0.5 * float(noise * np.trace(weight))]
        return float(value), np.array(slope)

    dim = u.shape[1]
    bounds = [(np.log(0.02), np.log(20.0))] * dim + [
        (np.log(1e-4), np.log(1e3)),
        (np.log(1e-12), 0.0),
    ]
    starts = [
        np.array([np.log(length)] * dim + [0.0, np.log(noise)])
        for length, noise in ((0.7, 1e-6), (1.5, 1e-3))
    ]
    runs = [
        minimize(cost, s, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        for s in starts
    ]
    return np.asarray(min(runs, key=lambda r: float(r.fun)).x)
