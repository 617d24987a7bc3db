"""The predictor: trend plus blended local models, from joints to position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.trend import Trend
from . import local_models as local
from .local_models import LocalModels
from .map import Map

Array = NDArray[np.float64]

_CHUNK = 250_000  # products at once: fewer than a BLAS splits over threads that wait for each other


@dataclass(frozen=True)
class Predictor:
    """The readout ``local`` in the forward direction.

    Attributes
    ----------
    motor : Map
        Its nodes carry the local models.
    trend : Trend
        The smooth part.
    models : LocalModels
        What the trend leaves over, around each node.
    """

    motor: Map
    trend: Trend
    models: LocalModels

    def value(self, u: Array) -> Array:
        """Positions (n, 2) at the points `u` (n, d) of the unit box."""
        return self._evaluate(u, slope=False)[0]

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Positions (n, 2) and their derivatives by the unit coordinates (n, 2, d)."""
        value, slope = self._evaluate(u, slope=True)
        assert slope is not None  # noqa: S101
        return value, slope

    def _evaluate(self, u: Array, *, slope: bool) -> tuple[Array, Array | None]:
        step = max(64, _CHUNK // (2 * (1 + u.shape[1]) * len(self.trend.coefficients)))
        if len(u) <= step:
            return self._evaluate_chunk(u, slope)
        parts = [self._evaluate_chunk(u[i : i + step], slope) for i in range(0, len(u), step)]
        value = np.concatenate([v for v, _ in parts])
        return value, np.concatenate([s for _, s in parts if s is not None]) if slope else None

    def _evaluate_chunk(self, u: Array, slope: bool) -> tuple[Array, Array | None]:
        value, tilt = self.trend.value_and_slope(u) if slope else (self.trend.value(u), None)
        if self.models.degree >= 0:
            correction, correction_slope = local.predict(self.models, self.motor, u, slope=slope)
            value = value + correction
            if tilt is not None and correction_slope is not None:
                tilt = tilt + correction_slope
        return value, tilt
