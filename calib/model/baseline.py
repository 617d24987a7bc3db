"""The baseline: what a model knows of an undisturbed arm where it learned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..common.arrays import Array, ReadOnly, Shape
from ..common.rows import rms
from ..common.scale import Scale
from ..maps.association import Association
from ..maps.map import Map, nearest_points

_PRIOR = 4.0  # samples that the mean of all nodes counts for at each node


@dataclass(frozen=True, eq=False)
class RowPlaces(ReadOnly):
    """Places of the rows of a log: without a body its bound holds around them, and grows between.

    Around a place it holds as far as the place's n + 1st neighbour is, for n joints, but no further
    than the median of these distances.
    """

    # in the unit box
    places: Annotated[Array, Shape("seen", "dof", storage="f4")]
    # how far around each place the bound holds, in the unit box
    reach: Annotated[Array, Shape("seen", storage="f4")]

    @staticmethod
    def of(scale: Scale, u: Array) -> RowPlaces:
        """Places of rows `u` (n, dof) in the unit box."""
        # an arm at rest is at one place
        places = np.unique(np.round(scale.wrapped(u), 3), axis=0)
        away = nearest_points(places, scale, places, u.shape[1] + 2)[0][:, -1]
        reach = np.minimum(away, np.median(away))
        return RowPlaces(_in_file(places), _in_file(reach))

    def beside(self, scale: Scale, u: Array) -> Array:
        """Distances (n,) of points `u` (n, dof) from where the bound holds."""
        distance, place = nearest_points(self.places, scale, u)
        return np.maximum(distance[:, 0] - self.reach[place[:, 0]], 0.0)


class Signal(NamedTuple):
    """One measure of how a log lies on the maps."""

    value: float  # of the log
    threshold: float  # what is usual where it lies


@dataclass(frozen=True, eq=False)
class Baseline(ReadOnly):
    """Distortions of samples that training never saw, stored with a model."""

    # (nodes,), expected squared distance of a sample to its winner, per winner, in the unit box
    motor: Annotated[Array, Shape("nodes", storage="f4")]
    sensory: Annotated[Array, Shape("places", storage="f4")]
    # variance of squared distance over expected one, in the motor and sensory map
    spread: tuple[float, float]
    # [unit], standard deviation per axis of measured less predicted position in training
    noise: float
    seen: RowPlaces | None = None  # of a log without a body

    def distortions(
        self,
        association: Association,
        u: Array,
        x: Array,
        predicted: Array,
        bound: Array,
    ) -> dict[str, Signal]:
        """Zeta of both maps (eq. 9), the reverse distortion, and the distance to the prediction.

        "reverse" is the mean squared distance of the nodes predicted for the joints to those that
        the positions visit, in the unit box; "links" the root mean square of the residuals [unit].

        u : (n, dof), joints in the unit box
        x, predicted : (n, m) [unit], positions
        bound : (n,) [unit], infinite for none
        """
        sensory = association.sensory
        measured = sensory.scale.to_unit(x)
        nodes = sensory.winners(x)
        of_prediction = sensory.winners(predicted)
        visited = sensory.units[np.unique(nodes)]
        places = sensory.units[of_prediction]
        distance = nearest_points(visited, sensory.scale, places)[0]
        reverse = float(np.mean(distance**2))
        usual_bound = np.where(np.isfinite(bound), bound, 0.0)
        squares = ((x - predicted) ** 2).sum(axis=1)
        links = math.sqrt(np.mean(squares))
        usual_links = rms(usual_bound)
        return {
            "motor": _zeta(association.motor, u, self.motor),
            "sensory": _zeta(sensory, measured, self.sensory),
            "reverse": Signal(reverse, sensory.spacing**2),
            "links": Signal(links, usual_links),
        }


def learn_baseline(
    association: Association, u: Array, x: Array, errors: Array
) -> Baseline:
    """Learn what to expect from samples that training never saw.

    They are joints `u` (n, dof) in the unit box and positions `x` (n, m); `errors` (m,) [unit] are
    the distances from measured to predicted positions of the samples of training.
    """
    motor, first = _usual_squares(association.motor, u)
    sensory, second = _usual_squares(
        association.sensory, association.sensory.scale.to_unit(x)
    )
    # the median of a Rayleigh distribution: a few wrong detections do not count
    noise = float(np.median(errors)) / np.sqrt(2.0 * np.log(2.0))
    return Baseline(motor, sensory, (first, second), float(noise))


def _zeta(network: Map, points: Array, expected: Array) -> Signal:
    """Distortion (eq. 9) of points (n, p) in the unit box, against the winners' own (nodes,)."""
    distance, winner = network.nearest(points)
    zeta = np.mean(distance[:, 0] ** 2)
    return Signal(float(zeta), float(expected[winner[:, 0]].mean()))


def _usual_squares(network: Map, points: Array) -> tuple[Array, float]:
    distance, winner = (part[:, 0] for part in network.nearest(points))
    square = distance**2
    count = np.bincount(winner, minlength=network.size)
    total = np.bincount(winner, square, minlength=network.size)
    # of unvisited nodes and of few samples: the mean of all, or the least that is not zero
    mean = max(float(square.mean()), 1e-24)
    expected = (total + _PRIOR * mean) / (count + _PRIOR)
    expected = _in_file(expected)
    return expected, float(np.var(square / expected[winner]))


def _in_file(values: Array) -> Array:
    """Values as a model file keeps them."""
    return values.astype(np.float32).astype(float)
