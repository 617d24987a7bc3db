"""Prediction: the one way from joints to readings, step by step.

clock         rows are of one moment: whoever reads a log has brought its clocks together
              (`calib.training.fitted_log.in_time`)
approach      true values of joints that came from a known side: `Prediction.joints`
body          the chain, then the sensor's view, then its lens: `calib.body.belief.Body.predict`
local models  what the body leaves over around the motor map's nodes, added to the reading:
              `calib.maps.predictor.Predictor.value`
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arm.rotations import quaternion_of
from ..common.arrays import Array, Mask
from ..common.rows import row_lengths
from ..samples.motion import Motion
from .parts import PREDICTOR, BoundName, ModelParts
from .space import Space


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's predictions for a motion; each array is computed on its first use.

    Rows without an answer are NaN: joint values that are not finite or out of the learned range,
    and places where the bound exceeds a tenth of the reach.
    """

    model: ModelParts
    motion: Motion

    @cached_property
    def has_answer(self) -> Mask:
        """Whether there is an answer, (n,)."""
        return self.model.covers(self.motion.q)

    @cached_property
    def joints(self) -> Array:
        """The joints' true values (n, dof) [rad or m]: the encoders' with play taken up."""
        approach = self.model.approach
        side = self.motion.side
        if approach is None or side is None:
            return self.motion.q
        return approach.effective(self.motion.q, side)

    @property
    def value(self) -> Array:
        """Readings (n, m) [unit] of the model's default readout."""
        return self.read(PREDICTOR)

    @property
    def reading_bound(self) -> Array:
        """95 % bound (n,) [unit] on the distance to what `about.bound_of` names.

        That is the sensor's reading, or the true position of a simulated arm.
        """
        return self._bound("bounds")

    @property
    def position_bound(self) -> Array:
        """95 % bound (n,) [unit] on the distance to the true position in the sensor's frame."""
        return self._bound("model_bounds")

    @property
    def slope(self) -> Array:
        """Derivative (n, m, dof) [unit / rad or m] of the readings by the joint values."""
        model = self.model
        slope = self._nan_rows(len(model.axes), len(model.about.lower))
        if self.has_answer.any():
            by_unit = model.predictor.value_and_slope(self._unit)[1]
            slope[self.has_answer] = by_unit / model.motor.scale.span
        return slope

    @property
    def pose(self) -> Array:
        """Positions [unit] and quaternions of the tip in the sensor's frame, (n, m + 4)."""
        space = Space.of(self.model)
        quaternion = self._nan_rows(4)
        rotation = space.evaluate(self.motion.q[self.has_answer])[1]
        in_sensor = space.sensor[0] @ rotation
        quaternion[self.has_answer] = quaternion_of(in_sensor)
        return np.hstack([self.value, quaternion])

    def read(self, readout: str) -> Array:
        """Readings (n, m) [unit] of any readout."""
        readings = self._nan_rows(len(self.model.axes))
        if self.has_answer.any():
            readings[self.has_answer] = self.model.positions_at(
                self._unit, readout
            )
        return readings

    def apart(self, readout: str) -> Array:
        """How far a readout is from the default one, (n,) [unit].

        The bounds hold for the default readout; another one is further off by at most this
        (triangle inequality).
        """
        return row_lengths(self.read(readout) - self.value)

    @cached_property
    def _unit(self) -> Array:
        """The true joints of the answered rows in the unit box, (k, dof)."""
        return self.model.motor.scale.to_unit(self.joints[self.has_answer])

    def _bound(self, which: BoundName) -> Array:
        """95 % bound (n,) [unit], see `ModelParts.bound_at`."""
        approach = self.model.approach
        side = self.motion.side
        sides: Mask | None = None
        if approach is not None and side is not None:
            sides = approach.has_sides(side[self.has_answer])
        bound = self._nan_rows()
        if self.has_answer.any():
            bound[self.has_answer] = self.model.bound_at(
                self._unit, which, side_known=sides
            )
        return bound

    def _nan_rows(self, *shape: int) -> Array:
        """NaN (n, *shape), the values of rows without an answer."""
        return np.full((len(self.motion), *shape), np.nan)
