"""What a user would otherwise take: one class each, all with fit, forward and inverse.

Every peer learns from the same rows.  Those that have no inverse of their own learn
joints from positions as a second function, which works because the arm has one branch.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

import calib

Array = NDArray[np.float64]

GP_ROWS = 5000
GP_TUNED_ON = 400


def _held(a: Array) -> NDArray[np.bool_]:
    """A contiguous block of at most 500 rows that hyperparameters are chosen on."""
    rows = np.arange(len(a)) - int(0.4 * len(a))
    return (rows >= 0) & (rows < min(500, len(a) // 10))


class Regression:
    """Two functions learned from the same rows: joints to position, position to joints."""

    name = ""

    def fit(self, q: Array, x: Array, _log: calib.Samples | None = None) -> "Regression":
        self.there, self.back = self._learn(q, x), self._learn(x, q)
        return self

    def fit_forward(self, q: Array, x: Array, _log: calib.Samples | None = None) -> "Regression":
        self.there = self._learn(q, x)
        return self

    def _learn(self, a: Array, b: Array) -> Any:
        """A function of rows, learned with zero mean and unit deviation in and out."""
        ma, sa, mb, sb = a.mean(0), a.std(0), b.mean(0), b.std(0)
        learned = self.make((a - ma) / sa, (b - mb) / sb)
        return lambda rows: self.say(learned, (rows - ma) / sa) * sb + mb

    def make(self, a: Array, b: Array) -> Any:
        raise NotImplementedError

    def say(self, learned: Any, a: Array) -> Array:
        return np.asarray(learned.predict(a))

    def forward(self, q: Array) -> Array:
        return self.there(q)

    def inverse(self, x: Array, _near: Array) -> Array:
        return self.back(x)


class Neighbours(Regression):
    name = "k-nearest neighbours"

    def make(self, a: Array, b: Array) -> Any:
        from sklearn.neighbors import KNeighborsRegressor

        return KNeighborsRegressor(5, weights="distance").fit(a, b)


class Gaussian(Regression):
    name = "Gaussian process"

    def make(self, a: Array, b: Array) -> Any:
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

        kernel = ConstantKernel(10.0, (1e-2, 1e5)) * RBF([2.0] * a.shape[1], (0.3, 50.0))
        kernel = kernel + WhiteKernel(1e-4, (1e-12, 1.0))
        some = slice(None, None, max(1, len(a) // GP_TUNED_ON))
        tuned = GaussianProcessRegressor(kernel, alpha=1e-12, random_state=0).fit(a[some], b[some])
        rows = slice(None, None, -(-len(a) // GP_ROWS))
        return GaussianProcessRegressor(tuned.kernel_, alpha=1e-11, optimizer=None).fit(
            a[rows], b[rows]
        )


class Radial(Regression):
    name = "RBFInterpolator"

    def make(self, a: Array, b: Array) -> Any:
        held = _held(a)

        def gap(smoothing: float) -> float:
            said = self.say((a[~held], b[~held], smoothing), a[held])
            return float(np.abs(said - b[held]).mean())

        return a, b, min((0.0, 1e-3, 1e-1), key=gap)

    def say(self, learned: Any, a: Array) -> Array:
        for kernel, degree in (("thin_plate_spline", 1), ("linear", 0)):
            try:
                x, y, smoothing = learned
                smoothing = smoothing if degree else max(smoothing, 1e-6)
                f = RBFInterpolator(
                    x, y, neighbors=60, smoothing=smoothing, kernel=kernel, degree=degree
                )
                return np.asarray(f(a))
            except np.linalg.LinAlgError:
                continue
        return np.full((len(a), 2), np.nan)


class Perceptron(Regression):
    name = "MLP"

    def make(self, a: Array, b: Array) -> Any:
        from sklearn.neural_network import MLPRegressor

        how = {"activation": "tanh", "solver": "lbfgs", "max_iter": 150, "alpha": 1e-6}
        return MLPRegressor((64, 64), random_state=0, **how).fit(a, b)


class Polynomial(Regression):
    name = "global polynomial"

    def make(self, a: Array, b: Array) -> Any:
        # into [-1, 1], Chebyshev terms of the total degree
        low, high = a.min(0), a.max(0)
        held = _held(a)

        def terms(z: Array, degree: int) -> Array:
            t = 2 * (z - low) / (high - low) - 1
            u, v = (np.polynomial.chebyshev.chebvander(c, degree) for c in t.T)
            pairs = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
            return np.stack([u[:, i] * v[:, j] for i, j in pairs], axis=1)

        def gap(degree: int) -> float:
            c = np.linalg.lstsq(terms(a[~held], degree), b[~held], rcond=None)[0]
            return float(np.abs(terms(a[held], degree) @ c - b[held]).mean())

        most = max(d for d in range(1, 13) if (d + 1) * (d + 2) / 2 < len(a) / 3)
        degree = min(range(1, most + 1), key=gap)
        return terms, degree, np.linalg.lstsq(terms(a, degree), b, rcond=None)[0]

    def say(self, learned: Any, a: Array) -> Array:
        terms, degree, c = learned
        return np.asarray(terms(a, degree) @ c)


class Refit:
    """Least squares of the true kinematic model: what a perfect model can give."""

    name = "kinematic model, refitted"

    def fit(self, q: Array, x: Array, _log: calib.Samples | None = None) -> "Refit":
        # the lengths times the sine and cosine of their offsets, and the base, are linear
        fits = []
        for sign in (1.0, -1.0):
            first, both = sign * q[:, 0], sign * (q[:, 0] + q[:, 1])
            zero, one = np.zeros(len(q)), np.ones(len(q))
            c, s, d, e = np.cos(first), np.sin(first), np.cos(both), np.sin(both)
            rows = [c, -s, d, -e, one, zero], [s, c, e, d, zero, one]
            a = np.concatenate([np.stack(each, axis=1) for each in rows])
            b = np.concatenate([x[:, 0], x[:, 1]])
            p = np.linalg.lstsq(a, b, rcond=None)[0]
            fits.append((float(np.sum((a @ p - b) ** 2)), sign, p))
        _, self.sign, p = min(fits, key=lambda f: f[0])
        self.lengths = np.hypot(p[[0, 2]], p[[1, 3]])
        turned = np.arctan2(p[[1, 3]], p[[0, 2]])
        self.offsets = np.array([turned[0], turned[1] - turned[0]])
        self.base = p[4:]
        return self

    fit_forward = fit

    def forward(self, q: Array) -> Array:
        angle = np.cumsum(self.sign * q + self.offsets, axis=1)
        tip = np.stack([np.cos(angle) @ self.lengths, np.sin(angle) @ self.lengths], axis=1)
        return tip + self.base

    def inverse(self, x: Array, near: Array) -> Array:
        a, b = self.lengths
        d = x - self.base
        c = np.clip((np.sum(d**2, axis=1) - a * a - b * b) / (2 * a * b), -1.0, 1.0)
        wanted = self.sign * near + self.offsets
        bend = np.arccos(c) * np.where(np.sin(wanted[:, 1]) < 0, -1.0, 1.0)
        turn = np.arctan2(d[:, 1], d[:, 0]) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
        q = self.sign * (np.stack([turn, bend], axis=1) - self.offsets)
        return q + 2 * np.pi * np.round((near - q) / (2 * np.pi))


class Calib:
    """The model that ``calib train`` leaves."""

    name = "calib"

    def fit(self, _q: Array, _x: Array, log: calib.Samples | None = None) -> "Calib":
        self.model = calib.train(log)
        return self

    fit_forward = fit

    def forward(self, q: Array) -> Array:
        return np.asarray(self.model.forward(q))

    def inverse(self, x: Array, near: Array) -> Array:
        return np.asarray(self.model.inverse(x, near=near, nearest=True))


PEERS = (Calib, Refit, Polynomial, Gaussian, Radial, Perceptron, Neighbours)
