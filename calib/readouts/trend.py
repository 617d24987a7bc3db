"""The trend: one smooth function of all joints that the local models correct."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..scale import TURN

Array = NDArray[np.float64]
Exponents = NDArray[np.int_]


def exponents(dim: int, degree: int) -> Exponents:
    """Exponents of all terms of total degree <= `degree`, (terms, dim), lowest first."""
    terms: list[tuple[int, ...]] = []
    for total in range(degree + 1):
        for bars in itertools.combinations(range(total + dim - 1), dim - 1):
            edges = (-1, *bars, total + dim - 1)
            terms.append(tuple(b - a - 1 for a, b in itertools.pairwise(edges)))
    return np.array(terms, dtype=int).reshape(-1, dim)


def largest_degree(dim: int, terms: int) -> int:
    """Highest total degree that needs at most so many terms."""
    degree = 0
    count = 1
    while True:
        count = count * (dim + degree + 1) // (degree + 1)
        if count > terms:
            return degree
        degree += 1


@dataclass(frozen=True)
class Basis:
    """Products of one-dimensional functions up to a total degree, on the unit box.

    Along a coordinate either Legendre polynomials, or the harmonics of a joint that turns:
    1, cos, sin, cos 2, sin 2, ... of its angle, made orthogonal over its range.  All that
    is known of the arm is that a whole turn brings a joint back to where it was.

    Attributes
    ----------
    turns : tuple of float [rad]
        Angle that each coordinate's unit interval spans, 0 for polynomials.
    degree : int
        Largest total degree; the harmonic k has degree k.
    """

    turns: tuple[float, ...]
    degree: int

    @cached_property
    def orders(self) -> Exponents:
        """Index of the one-dimensional function of each term and coordinate, (terms, d)."""
        rows = []
        for term in exponents(len(self.turns), self.degree):
            # a harmonic has two functions, cos and sin
            choices = [
                ((2 * e - 1, 2 * e) if p and e else (e,))
                for e, p in zip(term.tolist(), self.turns, strict=True)
            ]
            rows += list(itertools.product(*choices))
        return np.array(rows, dtype=int).reshape(-1, len(self.turns))

    def terms(self, degree: int) -> int:
        """Number of terms up to a total degree; they come first."""
        return int(np.count_nonzero(self.totals <= degree))

    @cached_property
    def totals(self) -> Exponents:
        """Total degree of each term, (terms,)."""
        harmonic = np.array(self.turns) > 0
        total = np.where(harmonic, (self.orders + 1) // 2, self.orders).sum(axis=1)
        return np.asarray(total, dtype=int)

    def values(self, u: Array) -> Array:
        """Value of each term at the points `u` (n, d), (n, terms)."""
        parts = [self._along(k, u[:, k])[0] for k in range(len(self.turns))]
        result: Array = np.ones((len(u), len(self.orders)))
        for part, order in zip(parts, self.orders.T, strict=True):
            result *= part[:, order]
        return result

    def gradients(self, u: Array) -> Array:
        """Derivative of each term by each coordinate, (d, n, terms)."""
        columns = []
        for k, order in enumerate(self.orders.T):
            value, slope = self._along(k, u[:, k])
            columns.append((value[:, order], slope[:, order]))
        return np.stack(
            [
                np.prod([c[1 if k == j else 0] for k, c in enumerate(columns)], axis=0)
                for j in range(len(columns))
            ]
        )

    def _along(self, k: int, u: Array) -> tuple[Array, Array]:
        """One-dimensional functions of coordinate `k` and their slopes, each (n, orders)."""
        if not self.turns[k]:
            return _polynomials(u, self.degree)
        value, slope = _harmonics(u, self.degree, self.turns[k])
        return value @ self._orthogonal[k], slope @ self._orthogonal[k]

    @cached_property
    def _orthogonal(self) -> list[Array]:
        """Combinations of harmonics that are orthonormal over each range."""
        grid = (np.arange(400) + 0.5) / 400
        result = []
        for turns in self.turns:
            raw = _harmonics(grid, self.degree, turns or TURN)[0] / np.sqrt(len(grid))
            triangle = np.linalg.qr(raw, mode="r")
            triangle *= np.sign(np.diag(triangle))[:, None]
            result.append(np.asarray(np.linalg.inv(triangle)))
        return result


def largest_harmonic(turns: float) -> int:
    """Highest harmonic that is told apart from the lower ones over an angle `turns` [rad]."""
    for degree in range(1, 12):
        raw = _harmonics((np.arange(400) + 0.5) / 400, degree, turns)[0]
        if np.abs(np.diag(np.linalg.qr(raw, mode="r"))).min() < 1e-5:
            return degree - 1
    return 11


def _harmonics(u: Array, degree: int, turns: float) -> tuple[Array, Array]:
    """1, cos, sin, cos 2, sin 2 ... of the angle turns * (u - 1/2), and their slopes."""
    rate = turns * np.arange(1, degree + 1)
    angle = np.outer(u - 0.5, rate)
    value = np.ones((len(u), 2 * degree + 1))
    slope = np.zeros_like(value)
    value[:, 1::2], value[:, 2::2] = np.cos(angle), np.sin(angle)
    slope[:, 1::2], slope[:, 2::2] = -rate * value[:, 2::2], rate * value[:, 1::2]
    return value, slope


def _polynomials(u: Array, degree: int) -> tuple[Array, Array]:
    """Legendre polynomials of 2 u - 1 and their slopes, each (n, degree + 1)."""
    z = 2.0 * u - 1.0
    p = np.ones((degree + 1, len(u)))
    dp = np.zeros_like(p)
    if degree:
        p[1], dp[1] = z, 1.0
    for n in range(1, degree):  # Bonnet's recursion and that of the derivatives
        p[n + 1] = ((2 * n + 1) * z * p[n] - n * p[n - 1]) / (n + 1)
        dp[n + 1] = dp[n - 1] + (2 * n + 1) * p[n]
    return p.T, 2.0 * dp.T


@dataclass(frozen=True)
class Trend:
    """A fitted trend.

    Attributes
    ----------
    basis : Basis
        Its functions of the joints.
    coefficients : (terms, 2) array
        Weight of each function, in the unit of the positions.
    """

    basis: Basis
    coefficients: Array

    def value(self, u: Array) -> Array:
        """Trend at the points `u` (n, d) of the unit box, (n, 2)."""
        return self.basis.values(u) @ self.coefficients

    def slope(self, u: Array) -> Array:
        """Its derivative by each unit coordinate, (n, 2, d)."""
        return np.moveaxis(self.basis.gradients(u) @ self.coefficients, 0, 2)
