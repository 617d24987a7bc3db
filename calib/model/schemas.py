"""Schema: one state of an arm that a model keeps, such as with a tool and without it.

:mod:`calib.change.schemas` recognises, keeps and recalls them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError
from ..maps.map import Map
from ..maps.node_bounds import blend_nodes
from ..maps.predictor import Predictor
from .baseline import Baseline
from .trust import Trust

if TYPE_CHECKING:
    from ..body.belief import Body
    from .model import Model

FIRST = "schema 1"
"""Name of the state that a model was trained in."""

_RADII = {1: 1.96, 2: 2.4477, 3: 2.7955}  # of 95 % of a normal distribution, by its dimension
_GRAIN = 1e-6  # share of the extent below which nothing counts


@dataclass(frozen=True, eq=False)
class Schema:
    """One state of an arm.

    Attributes
    ----------
    name : str
        Such as "tool on".
    sensory : Map
        Where the sensory nodes stand.
    predictor : Predictor
        From joints to positions, with the motor map that carries it.
    bounds, model_bounds : (motor nodes,) array [unit]
        95 % bounds around each node: on what `bound_of` says, and on the true position.
    most : float [unit]
        Largest bound with which a position is still an answer.
    visited : (motor nodes,) bool array
        Nodes that samples have visited.
    baseline : Baseline or None
        What an undisturbed arm's distortions look like.
    bound_of : str
        "true position" or "sensor reading": what `bounds` bound.
    samples : int
        Samples that it rests on.
    """

    name: str
    sensory: Map
    predictor: Predictor
    bounds: Array
    model_bounds: Array
    most: float
    visited: NDArray[np.bool_]
    baseline: Baseline | None
    bound_of: str
    samples: int

    @classmethod
    def of(cls, model: Model, name: str | None = None) -> Schema:
        """The present state of a model, under its own name or another one."""
        return cls(
            model.schema if name is None else name, model.sensory, model.predictor, model.bounds,
            model.model_bounds, model.trust.most, model.visited, model.baseline,
            model.about.bound_of, model.about.samples,
        )  # fmt: skip

    @property
    def noise(self) -> float:
        """Standard deviation per axis of a reading beyond what is bounded [unit]."""
        if self.baseline is None or self.bound_of != "true position":
            return 0.0
        return self.baseline.noise

    @property
    def radius(self) -> float:
        """Of 95 % of a normal distribution of a position, in standard deviations."""
        return _RADII[self.sensory.units.shape[1]]

    @cached_property
    def trust(self) -> Trust:
        """Where answers are given."""
        return Trust(self.predictor.motor, self.model_bounds, self.most)

    @property
    def body(self) -> Body | None:
        """The kinematic model under the maps, if there is one."""
        return self.predictor.body

    def contradictions(self, u: Array, x: Array) -> tuple[Array, Array, Array]:
        """How far positions `x` (n, m) are from what the schema says of joints `u` (n, dof).

        Returns distance over bound, NaN where nothing was learned; distance; bound: each (n,)
        [unit]. Joints are in the unit box.
        """
        motor = self.predictor.motor
        known = self.trust.covers(u)
        ratio, distance, bound = (np.full(len(u), np.nan) for _ in range(3))
        if known.any():
            predicted = self.predictor.value(u[known])
            distance[known] = np.linalg.norm(x[known] - predicted, axis=1)
            square = blend_nodes(motor, self.bounds, u[known]) ** 2
            square += (self.radius * self.noise) ** 2  # of the sensor, on top
            # a simulation's bound is zero where its samples are exact
            floor = _GRAIN * float(np.linalg.norm(self.sensory.scale.span))
            bound[known] = np.sqrt(square + floor**2)
            ratio[known] = distance[known] / bound[known]
        return ratio, distance, bound


def check_name(name: str) -> None:
    """Refuse a name that could not be printed or stored."""
    if not isinstance(name, str) or not name.strip() or len(name) > 80 or not name.isprintable():
        raise OptionError(f"schema name {name!r}: expected 1 to 80 printable characters")
