"""The systematic part of a residual: what smooth functions of the joints explain of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FALSE_ALARM = 1e-3
"""Share of undisturbed logs for which one signal exceeds its threshold."""

_COLLINEAR = 1e-6


@dataclass(frozen=True)
class Systematic:
    """A residual, divided into what is systematic and what is noise.

    Attributes
    ----------
    value : float [unit]
        Root mean square of the systematic part.
    threshold : float [unit]
        What chance and the model's own error explain of it.
    noise : float [unit]
        Standard deviation per axis of the rest.
    """

    value: float
    threshold: float
    noise: float

    @property
    def fired(self) -> bool:
        """Whether there is a systematic part."""
        return self.value > self.threshold


def orthonormal(features: Array) -> Array:
    """Orthonormal functions (n, rank) that span the features (n, p)."""
    size = np.maximum(np.linalg.norm(features, axis=0), 1e-300)
    left, weight, _ = np.linalg.svd(features / size, full_matrices=False)
    return np.asarray(left[:, weight > _COLLINEAR * weight[0]])


def systematic(basis: Array, residual: Array, floor: float) -> Systematic:
    """Test a residual with an F test of a regression on smooth functions.

    Parameters
    ----------
    basis : (n, p) array
        Orthonormal functions, see :func:`orthonormal`.
    residual : (n, 2) array [unit]
        Measured less predicted positions.
    floor : float [unit]
        Root mean square error that the model may have of itself.
    """
    from scipy.special import fdtri

    n, p = basis.shape
    explained = float(np.sum((basis.T @ residual) ** 2))
    rest = max(float(np.sum(residual**2)) - explained, 0.0)
    noise = np.sqrt(rest / (2.0 * max(n - p, 1)))
    quantile = float(fdtri(2 * p, 2 * max(n - p, 1), 1.0 - FALSE_ALARM))
    threshold = np.sqrt(noise**2 * 2.0 * p * quantile / n + floor**2)
    return Systematic(float(np.sqrt(explained / n)), float(threshold), float(noise))
