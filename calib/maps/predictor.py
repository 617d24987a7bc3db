"""The predictor: a smooth part of all joints plus local models on the motor map's nodes."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.scale import Scale
from .blend import Blend
from .local_models import LocalModels, correction, correction_slope
from .map import Map

_ROWS = 1024  # at once: fewer products than a BLAS splits over threads that wait for each other


class Smooth(Protocol):
    """A smooth function of the joints: a body, or the linear models of maps and links."""

    def value(self, u: Array) -> Array:
        """Positions (n, m) at the points `u` (n, dof) of the unit box."""

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Positions (n, m) and their derivatives by the unit coordinates (n, m, dof)."""


@dataclass(frozen=True)
class BodyInBox:
    """A body as a function of the joints in their unit box, see :class:`Smooth`."""

    body: Body
    scale: Scale  # range of the joints

    def value(self, u: Array) -> Array:  # noqa: D102
        q = self.scale.from_unit(u)
        return self.body.predict(q)

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:  # noqa: D102
        q = self.scale.from_unit(u)
        value, slope = self.body.predict_and_slope(q)
        return value, slope * self.scale.span


@dataclass(frozen=True)
class Predictor:
    """The readout ``local`` in the forward direction, see :class:`Smooth`."""

    motor: Map  # its nodes carry the local models
    smooth: Smooth  # the smooth part: the body, or what replaces it
    models: LocalModels  # what the smooth part leaves over, around each node

    @property
    def body(self) -> Body | None:
        """The kinematic model in the smooth part, if there is one."""
        return self.smooth.body if isinstance(self.smooth, BodyInBox) else None

    def value(self, u: Array) -> Array:  # noqa: D102
        values = [self._value_of(rows) for rows in _parts(u)]
        return np.concatenate(values)

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:  # noqa: D102
        if len(u) <= _ROWS:
            return self._value_and_slope_of(u)
        parts = map(self._value_and_slope_of, _parts(u))
        values, slopes = zip(*parts, strict=True)
        return np.concatenate(values), np.concatenate(slopes)

    def _value_of(self, u: Array) -> Array:
        value = self.smooth.value(u)
        if self.models.degree < 0:
            return value
        return value + correction(self.models, Blend(self.motor, u))

    def _value_and_slope_of(self, u: Array) -> tuple[Array, Array]:
        value, slope = self.smooth.value_and_slope(u)
        if self.models.degree < 0:
            return value, slope
        blend = Blend(self.motor, u)
        value = value + correction(self.models, blend)
        return value, slope + correction_slope(self.models, blend)


def _parts(u: Array) -> list[Array]:
    return np.split(u, range(_ROWS, len(u), _ROWS))
