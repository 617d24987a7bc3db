"""A covariance as a triangle of single precision: half the size, and positive by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .structure import Array

Packed = NDArray[np.float32]


def pack(covariance: Array) -> tuple[Packed, Array]:
    """Triangle (k (k + 1) / 2,) of the correlation's root, and the deviations (k,)."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviations > 0, deviations, 1.0)
    correlation = covariance / safe[:, None] / safe
    values, vectors = np.linalg.eigh((correlation + correlation.T) / 2)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    upper = np.asarray(np.linalg.qr(root, mode="r"), dtype=float)
    upper *= np.where(np.diag(upper) < 0, -1.0, 1.0)[:, None]
    return upper[np.triu_indices(len(upper))].astype(np.float32), deviations


def unpack(packed: Packed, deviations: Array) -> Array:
    """The covariance (k, k) that `pack` stored."""
    k = len(deviations)
    upper = np.zeros((k, k))
    upper[np.triu_indices(k)] = packed
    upper *= deviations
    return np.asarray(upper.T @ upper)


def as_stored(covariance: Array) -> Array:
    """The covariance as it is after saving and loading."""
    return unpack(*pack(covariance))
