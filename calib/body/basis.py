"""The basis of a trend: products of one-dimensional functions of the joints."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array

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
    while math.comb(dim + degree + 1, dim) <= terms:
        degree += 1
    return degree


@dataclass(frozen=True)
class Basis:
    """Products of one-dimensional functions up to a total degree, on the unit box.

    Along a coordinate either Legendre polynomials, or the harmonics of a joint that turns:
    1, cos, sin, cos 2, sin 2, ... of its angle, made orthogonal over its range.  All that
    is known of the arm is that a whole turn brings a joint back to where it was.
    """

    # [rad], angle that each coordinate's unit interval spans, 0 for polynomials
    turns: tuple[float, ...]
    degree: int  # largest total degree; the harmonic k has degree k
    # largest degree along one coordinate, 0 for no such limit.  With 1, a function of many joints
    # is affine in the cosine and sine of each, as a chain of rigid links is.
    each: int = 0

    @cached_property
    def orders(self) -> Exponents:
        """Index of the one-dimensional function of each term and coordinate, (terms, d)."""
        rows = []
        terms = exponents(len(self.turns), self.degree)
        for term in terms[terms.max(axis=1) <= self.highest]:
            # a harmonic has two functions, cos and sin
            choices = [
                ((2 * e - 1, 2 * e) if p and e else (e,))
                for e, p in zip(term.tolist(), self.turns, strict=True)
            ]
            rows += list(itertools.product(*choices))
        return np.array(rows, dtype=int).reshape(-1, len(self.turns))

    @property
    def highest(self) -> int:
        """Largest degree along one coordinate."""
        return min(self.degree, self.each or self.degree)

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
        parts = [p.T @ o for p, o in zip(self.plain(u), self.orthogonal, strict=True)]
        result: Array = np.ones((len(u), len(self.orders)))
        for part, order in zip(parts, self.orders.T, strict=True):
            result *= part[:, order]
        return result

    def plain(self, u: Array) -> list[Array]:
        """One-dimensional functions of each coordinate as they are, (functions, n) each."""
        if all(self.turns):
            return list(_harmonics(u.T, self.highest, self._rates))
        return [
            _harmonics(u[:, k], self.highest, turns)
            if turns
            else _polynomials(u[:, k], self.highest)
            for k, turns in enumerate(self.turns)
        ]

    @cached_property
    def _rates(self) -> Array:
        return np.array(self.turns)[:, None]

    @cached_property
    def derivatives(self) -> list[Array]:
        """Derivative of each plain function in terms of the plain functions, per coordinate.

        Column j of a matrix holds the coefficients of the derivative of function j.
        """
        result = []
        for turns in self.turns:
            matrix = np.zeros((2 * self.highest + 1,) * 2)
            if turns:
                for k in range(1, self.highest + 1):
                    matrix[2 * k, 2 * k - 1] = -turns * k  # cos' = -sin
                    matrix[2 * k - 1, 2 * k] = turns * k
            else:
                matrix = np.zeros((self.highest + 1,) * 2)
                for n in range(self.highest):  # P'_n+1 = P'_n-1 + (2 n + 1) P_n
                    matrix[:, n + 1] = matrix[:, n - 1] if n else 0.0
                    matrix[n, n + 1] += 2.0 * (2 * n + 1)
            result.append(matrix)
        return result

    @cached_property
    def orthogonal(self) -> list[Array]:
        """Combinations of the plain functions that are orthogonal over each range."""
        grid = (np.arange(400) + 0.5) / 400
        result = []
        for turns in self.turns:
            if not turns:
                result.append(np.eye(self.highest + 1))
                continue
            raw = _harmonics(grid, self.highest, turns).T / np.sqrt(len(grid))
            triangle = np.linalg.qr(raw, mode="r")
            triangle *= np.sign(np.diag(triangle))[:, None]
            result.append(np.asarray(np.linalg.inv(triangle)))
        return result


def largest_harmonic(turns: float) -> int:
    """Highest harmonic that is told apart from the lower ones over an angle `turns` [rad]."""
    for degree in range(1, 12):
        raw = _harmonics((np.arange(400) + 0.5) / 400, degree, turns).T
        if np.abs(np.diag(np.linalg.qr(raw, mode="r"))).min() < 1e-5:
            return degree - 1
    return 11


def _harmonics(u: Array, degree: int, turns: float | Array) -> Array:
    """1, cos, sin, cos 2, sin 2 ... of the angle turns * (u - 1/2).

    Of the shape (2 degree + 1, n) for `u` (n,), and (d, 2 degree + 1, n) for `u` (d, n).
    """
    value = np.empty((*u.shape[:-1], 2 * degree + 1, u.shape[-1]))
    value[..., 0, :] = 1.0
    if not degree:
        return value
    angle = turns * (u - 0.5)
    cos, sin = value[..., 1, :], value[..., 2, :]
    np.cos(angle, out=cos)
    np.sin(angle, out=sin)
    for k in range(3, 2 * degree + 1, 2):  # of the sum of two angles
        value[..., k, :] = value[..., k - 2, :] * cos - value[..., k - 1, :] * sin
        value[..., k + 1, :] = value[..., k - 1, :] * cos + value[..., k - 2, :] * sin
    return value


def _polynomials(u: Array, degree: int) -> Array:
    """Legendre polynomials of 2 u - 1, (degree + 1, n)."""
    z = 2.0 * u - 1.0
    p = np.ones((degree + 1, len(u)))
    if degree:
        p[1] = z
    for n in range(1, degree):  # Bonnet's recursion
        p[n + 1] = ((2 * n + 1) * z * p[n] - n * p[n - 1]) / (n + 1)
    return p
