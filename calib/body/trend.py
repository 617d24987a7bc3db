"""The trend: one smooth function of all joints that the local models correct."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array
from .basis import Basis

_CHUNK = 1 << 15  # points whose functions are held at once


@dataclass(frozen=True)
class Trend:
    """A fitted trend."""

    basis: Basis  # its functions of the joints
    coefficients: Array  # (terms, m), weight of each function, in the unit of the positions

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

    def _features(self, u: Array) -> Array:
        """Products of plain functions of the coordinates, (terms, n), in the basis' order."""
        first, *others = self.basis.plain(u)
        result = first[self.basis.orders[:, 0]]
        for part, order in zip(others, self.basis.orders.T[1:], strict=True):
            used = np.flatnonzero(order)  # the function of order 0 is 1
            result[used] *= part[order[used]]
        return result

    @cached_property
    def _weights(self) -> Array:
        """Weight of each plain product in the value and in its slopes, (outputs (1 + d), terms).

        The derivative of a function is made of functions of the same basis, so that one
        product of matrices gives the values and all slopes.
        """
        shape = [len(matrix) for matrix in self.basis.orthogonal]
        tensor = np.zeros((*shape, self.outputs))
        place = tuple(self.basis.orders.T)
        tensor[place] = self.coefficients
        for k, matrix in enumerate(self.basis.orthogonal):
            tensor = _along(matrix, tensor, k)
        slopes = [_along(matrix, tensor, k) for k, matrix in enumerate(self.basis.derivatives)]
        return np.concatenate([t[place].T for t in (tensor, *slopes)])


def _along(matrix: Array, tensor: Array, axis: int) -> Array:
    """A matrix applied along one axis of a tensor."""
    return np.moveaxis(np.tensordot(matrix, tensor, axes=(1, axis)), 0, axis)
