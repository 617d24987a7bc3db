"""A covariance as a triangle of single precision: half the size, and positive by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .bound import root_of

Packed = NDArray[np.float32]


def pack(covariance: Array) -> Packed:
    """Upper triangular root (k (k + 1) / 2,) of a covariance, row by row."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviations > 0, deviations, 1.0)
    correlation = covariance / safe[:, None] / safe
    try:
        upper = np.linalg.cholesky((correlation + correlation.T) / 2).T
    except np.linalg.LinAlgError:  # semidefinite
        values, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        upper = np.asarray(np.linalg.qr(root, mode="r"), dtype=float)
        upper *= np.where(np.diag(upper) < 0, -1.0, 1.0)[:, None]
    upper = upper * deviations
    return upper[np.triu_indices(len(upper))].astype(np.float32)


def unpack(packed: Packed, size: int) -> Array:
    """The covariance (size, size) of a packed root."""
    upper = _triangle(packed, size)
    return np.asarray(upper.T @ upper)


def root_in(covariance: Array, packed: Packed | None) -> Array:
    """A root (k, k) of a covariance: the packed triangle where that is its own."""
    if packed is not None and _is_of(packed, covariance):
        return _triangle(packed, len(covariance)).T  # a fifth of the eigenvectors' time, half zero
    return root_of(covariance)


def packed_of(covariance: Array, packed: Packed | None) -> Packed:
    """The packed root of a covariance: the one at hand where it is the covariance's own."""
    return packed if packed is not None and _is_of(packed, covariance) else pack(covariance)


def _triangle(packed: Packed, size: int) -> Array:
    upper = np.zeros((size, size))
    upper[np.triu_indices(size)] = packed
    return upper


def _is_of(packed: Packed, covariance: Array) -> bool:
    size = len(covariance)
    fits = len(packed) == size * (size + 1) // 2
    return fits and np.array_equal(unpack(packed, size), covariance)
