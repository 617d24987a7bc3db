"""The basis of a trend: products of one-dimensional functions of the joints."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legder, legvander
from numpy.typing import NDArray

from ..common.arrays import Array

_Exponents = NDArray[np.int_]

_GRID = 400  # places over which harmonics are made orthogonal


def exponents(dim: int, degree: int) -> _Exponents:
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
    def orders(self) -> _Exponents:
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
    def totals(self) -> _Exponents:
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
        return [
            _harmonics(u[:, k], self.highest, turns)
            if turns
            else np.asarray(legvander(2.0 * u[:, k] - 1.0, self.highest).T, dtype=float)
            for k, turns in enumerate(self.turns)
        ]

    @cached_property
    def derivatives(self) -> list[Array]:
        """Derivative of each plain function in terms of the plain functions, per coordinate.

        Column j of a matrix holds the coefficients of the derivative of function j.
        """
        result = []
        for turns in self.turns:
            matrix = np.zeros(((2 if turns else 1) * self.highest + 1,) * 2)
            if turns:
                for k in range(1, self.highest + 1):
                    matrix[2 * k, 2 * k - 1] = -turns * k  # cos' = -sin
                    matrix[2 * k - 1, 2 * k] = turns * k
            else:
                slopes = legder(np.eye(self.highest + 1), scl=2.0)  # of 2 u - 1
                matrix[: len(slopes)] = slopes
            result.append(matrix)
        return result

    @cached_property
    def orthogonal(self) -> list[Array]:
        """Combinations of the plain functions that are orthogonal over each range."""
        result = [np.eye(self.highest + 1)] * len(self.turns)
        for k, turns in enumerate(self.turns):
            if turns:
                triangle = _triangle(self.highest, turns) / np.sqrt(_GRID)
                triangle *= np.sign(np.diag(triangle))[:, None]
                result[k] = np.asarray(np.linalg.inv(triangle))
        return result


def largest_harmonic(turns: float) -> int:
    """Highest harmonic that is told apart from the lower ones over an angle `turns` [rad]."""
    for degree in range(1, 12):
        if np.abs(np.diag(_triangle(degree, turns))).min() < 1e-5:
            return degree - 1
    return 11


def _triangle(degree: int, turns: float) -> Array:
    """Triangular factor of harmonics at places all over the range."""
    places = (np.arange(_GRID) + 0.5) / _GRID
    return np.asarray(np.linalg.qr(_harmonics(places, degree, turns).T, mode="r"))


def _harmonics(u: Array, degree: int, turns: float) -> Array:
    """1, cos, sin, cos 2, sin 2 ... of the angle turns * (u - 1/2), (2 degree + 1, n)."""
    waves = np.cumprod(np.tile(np.exp(1j * turns * (u - 0.5)), (degree, 1)), axis=0)
    value = np.ones((2 * degree + 1, len(u)))
    value[1::2], value[2::2] = waves.real, waves.imag
    return value
