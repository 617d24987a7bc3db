"""The trend: one smooth function of all joints that the local models correct."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

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

    Legendre polynomials along ordinary coordinates (orthogonal for uniform samples), and
    cosines and sines of whole turns along periodic ones.

    Attributes
    ----------
    periodic : tuple of bool
        One flag per coordinate.
    degree : int
        Largest total degree; the harmonic k of a periodic coordinate has degree k.
    """

    periodic: tuple[bool, ...]
    degree: int

    @cached_property
    def orders(self) -> Exponents:
        """Index of the one-dimensional function of each term and coordinate, (terms, d)."""
        rows = []
        for term in exponents(len(self.periodic), self.degree):
            # a harmonic has two functions, cos and sin
            choices = [
                ((2 * e - 1, 2 * e) if p and e else (e,))
                for e, p in zip(term.tolist(), self.periodic, strict=True)
            ]
            rows += list(itertools.product(*choices))
        return np.array(rows, dtype=int).reshape(-1, len(self.periodic))

    def terms(self, degree: int) -> int:
        """Number of terms up to a total degree; they come first."""
        periodic = np.array(self.periodic)
        total = np.where(periodic, (self.orders + 1) // 2, self.orders).sum(axis=1)
        return int(np.count_nonzero(total <= degree))

    def values(self, u: Array) -> Array:
        """Value of each term at the points `u` (n, d), (n, terms)."""
        result: Array = np.ones((len(u), len(self.orders)))
        for k, periodic in enumerate(self.periodic):
            result *= _functions(u[:, k], self.degree, periodic)[0][:, self.orders[:, k]]
        return result

    def gradients(self, u: Array) -> Array:
        """Derivative of each term by each coordinate, (d, n, terms)."""
        parts = [_functions(u[:, k], self.degree, p) for k, p in enumerate(self.periodic)]
        columns = [
            (value[:, order], slope[:, order])
            for (value, slope), order in zip(parts, self.orders.T, strict=True)
        ]
        return np.stack(
            [
                np.prod([c[1 if k == j else 0] for k, c in enumerate(columns)], axis=0)
                for j in range(len(columns))
            ]
        )


def _functions(u: Array, degree: int, periodic: bool) -> tuple[Array, Array]:
    """One-dimensional functions and their derivatives at `u` (n,), each (n, orders)."""
    if periodic:
        angle = 2 * np.pi * np.outer(u, np.arange(1, degree + 1))
        value = np.ones((len(u), 2 * degree + 1))
        slope = np.zeros_like(value)
        value[:, 1::2], value[:, 2::2] = np.cos(angle), np.sin(angle)
        turns = 2 * np.pi * np.arange(1, degree + 1)
        slope[:, 1::2], slope[:, 2::2] = -turns * value[:, 2::2], turns * value[:, 1::2]
        return value, slope
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
