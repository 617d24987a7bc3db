"""Derivative of many rows by many parameters, of which most may be the harmonics of joint curves.

The harmonics w (h,) of a joint move a row's outputs along one direction d (m,): x = d w'. So the
normal equations of two joints' harmonics are W' diag(d . e) V, a third of the work of columns for
each of three outputs, which need not be made (Kronecker structure).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from .parameters import Indices


class Waves(NamedTuple):
    """Columns of one joint's harmonics."""

    columns: slice
    direction: Array  # (n, m)
    factors: Array  # (n, h)


@dataclass(frozen=True)
class Derivative:
    """Derivatives (n, m, k) of outputs."""

    bare: Array  # (n, m, g), by the parameters that are no harmonics
    columns: Indices  # (g,), theirs of the k
    waves: tuple[Waves, ...] = ()

    @staticmethod
    def of(x: Array) -> Derivative:
        """Of derivatives (n, m, k) as they are."""
        return Derivative(x, np.arange(x.shape[2]))

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return len(self.columns) + sum(len(each.factors.T) for each in self.waves)

    def rows(self, rows: slice | Indices, outputs: slice = slice(None)) -> Derivative:
        """The derivative of some rows and outputs."""
        waves = (Waves(c, d[rows, outputs], w[rows]) for c, d, w in self.waves)
        return Derivative(self.bare[rows, outputs], self.columns, tuple(waves))

    def dense(self) -> Array:
        """All columns (n, m, k)."""
        out = np.empty((*self.bare.shape[:2], self.size))
        out[:, :, self.columns] = self.bare
        for columns, direction, factors in self.waves:
            np.multiply(direction[:, :, None], factors[:, None], out=out[:, :, columns])
        return out

    def times(self, delta: Array) -> Array:
        """Moves (n, m) of the outputs by a change (k,) of the parameters."""
        out = self.bare @ delta[self.columns]
        for columns, direction, factors in self.waves:
            out += direction * (factors @ delta[columns])[:, None]
        return np.asarray(out)

    def moment(self, r: Array) -> Array:
        """``X' r`` (k,) of residuals (n, m)."""
        out = np.empty(self.size)
        out[self.columns] = np.tensordot(r, self.bare, axes=2)
        for columns, direction, factors in self.waves:
            out[columns] = (direction * r).sum(axis=1) @ factors
        return out

    def gram(self, w: Array) -> Array:
        """``X' W X`` (k, k) of weights (n, m)."""
        root = np.sqrt(w)
        bare = self.bare * root[:, :, None]
        flat = bare.reshape(-1, len(self.columns))
        out = np.empty((self.size, self.size))
        out[np.ix_(self.columns, self.columns)] = flat.T @ flat
        led = [each.direction * root for each in self.waves]
        for i, (columns, _, factors) in enumerate(self.waves):
            block = factors.T @ np.einsum("nm,nmg->ng", led[i], bare)
            out[columns, self.columns], out[self.columns, columns] = block, block.T
            for other, along in zip(self.waves[: i + 1], led, strict=False):
                shared = (led[i] * along).sum(axis=1)
                block = factors.T @ (other.factors * shared[:, None])
                out[columns, other.columns], out[other.columns, columns] = block, block.T
        return out
