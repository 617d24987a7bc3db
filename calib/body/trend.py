"""The trend: one smooth function of all joints that the local models correct."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .basis import Basis

Array = NDArray[np.float64]

_CHUNK = 1 << 15  # points whose functions are held at once


@dataclass(frozen=True)
class Trend:
    """A fitted trend.

    Attributes
    ----------
    basis : Basis
        Its functions of the joints.
    coefficients : (terms, m) array
        Weight of each function, in the unit of the positions.
    """

    basis: Basis
    coefficients: Array

    @property
    def terms(self) -> int:
        """Number of functions."""
        return len(self.coefficients)

    @property
    def outputs(self) -> int:
        """Number of coordinates of a position."""
        return int(self.coefficients.shape[1])

    def value(self, u: Array) -> Array:
        """Trend at the points `u` (n, d) of the unit box, (n, outputs)."""
        weights = self._weights[: self.outputs]
        if len(u) <= _CHUNK:
            return np.asarray((weights @ self._features(u)).T)
        parts = (u[first : first + _CHUNK] for first in range(0, len(u), _CHUNK))
        return np.concatenate([(weights @ self._features(part)).T for part in parts])

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Trend (n, outputs) and its derivatives (n, outputs, d) by the unit coordinates."""
        both = self._weights @ self._features(u)
        o = self.outputs
        return both[:o].T, both[o:].reshape(u.shape[1], o, -1).transpose(2, 1, 0)

    def slope(self, u: Array) -> Array:
        """Its derivative by each unit coordinate, (n, outputs, d)."""
        return self.value_and_slope(u)[1]

    def _features(self, u: Array) -> Array:
        """Products of plain functions of the coordinates, (terms, n), in the order of `_plan`."""
        parts = np.concatenate(self.basis.plain(u))
        result = np.empty((len(self._plan.orders), len(u)))
        result[0] = 1.0
        for begin, end, parent, part in self._plan.steps:
            if begin == 1:
                result[1:end] = parts[part]
            else:
                np.multiply(result[parent], parts[part], out=result[begin:end])
        return result

    @cached_property
    def _plan(self) -> _Plan:
        return _Plan.of(self.basis)

    @cached_property
    def _weights(self) -> Array:
        """Weight of each plain product in the value and in its slopes, (outputs (1 + d), terms).

        The derivative of a function is made of functions of the same basis, so that one
        product of matrices gives the values and all slopes.
        """
        shape = [len(matrix) for matrix in self.basis.orthogonal]
        tensor = np.zeros((*shape, self.outputs))
        tensor[tuple(self.basis.orders.T)] = self.coefficients
        for k, matrix in enumerate(self.basis.orthogonal):
            tensor = _along(matrix, tensor, k)
        slopes = [_along(matrix, tensor, k) for k, matrix in enumerate(self.basis.derivatives)]
        place = tuple(self._plan.orders.T)
        return np.concatenate([t[place].T for t in (tensor, *slopes)])


@dataclass(frozen=True, eq=False)
class _Plan:
    """How the products of a basis are built from one another.

    Attributes
    ----------
    orders : (terms, d) int array
        The basis' terms: those of no coordinate first, then of one, of two, ...
    steps : list of (begin, end, parent, part)
        The terms begin ... end - 1 are products of the earlier terms `parent` and of the
        one-dimensional functions `part`, all coordinates' functions counted through.
    """

    orders: NDArray[np.int_]
    steps: list[tuple[int, int, NDArray[np.intp], NDArray[np.intp]]]

    @staticmethod
    def of(basis: Basis) -> _Plan:
        used = np.count_nonzero(basis.orders, axis=1)
        orders = basis.orders[np.argsort(used, kind="stable")]
        used = np.sort(used, kind="stable")
        place = {tuple(term): i for i, term in enumerate(orders.tolist())}
        sizes = [len(matrix) for matrix in basis.orthogonal]
        offset = np.cumsum([0, *sizes[:-1]])
        parent = np.zeros(len(orders), dtype=np.intp)
        part = np.zeros(len(orders), dtype=np.intp)
        for i, term in enumerate(orders.tolist()):
            if not i:
                continue
            last = max(k for k, order in enumerate(term) if order)
            part[i] = offset[last] + term[last]
            term[last] = 0
            parent[i] = place[tuple(term)]
        edges = np.searchsorted(used, np.arange(1, used[-1] + 2))
        steps = [(int(a), int(b), parent[a:b], part[a:b]) for a, b in itertools.pairwise(edges)]
        return _Plan(orders, steps)


def _along(matrix: Array, tensor: Array, axis: int) -> Array:
    """A matrix applied along one axis of a tensor."""
    return np.moveaxis(np.tensordot(matrix, tensor, axes=(1, axis)), 0, axis)
