"""The predictor: a smooth part of all joints plus local models on the motor map's nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.scale import Scale
from . import local_models as local
from .local_models import LocalModels
from .map import Map

_NONE = np.empty(0)
_ROWS = 1024  # at once: fewer products than a BLAS splits over threads that wait for each other


class Smooth(Protocol):
    """A smooth function of the joints: a body, or the linear models of maps and links."""

    def value(self, u: Array) -> Array:
        """Positions (n, m) at the points `u` (n, dof) of the unit box."""

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Positions (n, m) and their derivatives by the unit coordinates (n, m, dof)."""


@dataclass(frozen=True)
class BodyInBox:
    """A body that is asked in the unit box of the joints, see :class:`Smooth`."""

    body: Body
    scale: Scale  # range of the joints

    def value(self, u: Array) -> Array:  # noqa: D102
        return self.body.predict(self.scale.from_unit(u))

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:  # noqa: D102
        value, slope = self.body.predict_and_slope(self.scale.from_unit(u))
        return value, slope * self.scale.span


@dataclass(frozen=True)
class Predictor:
    """The readout ``local`` in the forward direction, see :class:`Smooth`."""

    motor: Map  # its nodes carry the local models
    smooth: Smooth  # the smooth part: the body, or what stands for it
    models: LocalModels  # what the smooth part leaves over, around each node

    @property
    def body(self) -> Body | None:
        """The kinematic model in the smooth part, if there is one."""
        return self.smooth.body if isinstance(self.smooth, BodyInBox) else None

    def value(self, u: Array) -> Array:  # noqa: D102
        if len(u) <= _ROWS:
            return self._evaluate(u, slope=False)[0]
        return np.concatenate([self._evaluate(part, slope=False)[0] for part in _parts(u)])

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:  # noqa: D102
        if len(u) <= _ROWS:
            return self._evaluate(u, slope=True)
        values, slopes = zip(*(self._evaluate(part, slope=True) for part in _parts(u)), strict=True)
        return np.concatenate(values), np.concatenate(slopes)

    def _evaluate(self, u: Array, *, slope: bool) -> tuple[Array, Array]:
        value, tilt = self.smooth.value_and_slope(u) if slope else (self.smooth.value(u), _NONE)
        if self.models.degree < 0:
            return value, tilt
        correction, more = local.predict(self.models, self.motor, u, slope=slope)
        return value + correction, tilt if more is None else tilt + more


def _parts(u: Array) -> list[Array]:
    return [u[first : first + _ROWS] for first in range(0, len(u), _ROWS)]
