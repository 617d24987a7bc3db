"""Distortion: how the rows of a log lie on a model's maps (eq. 9), a display and no alarm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from ..maps.map import Map, search_tree
from .rows import LogRows

_MOST = 1000  # rows that distortions are measured on


class Signal(NamedTuple):
    """One measure of how a log lies on the maps."""

    value: float  # of the log
    threshold: float  # what is usual where it lies

    @property
    def score(self) -> float:
        """Value over threshold."""
        return (
            self.value / self.threshold
            if self.threshold > 0
            else float(self.value > 0)
        )


def distortions(rows: LogRows) -> dict[str, Signal]:
    """Return zeta of both maps, the reverse distortion, and the distance to the prediction.

    "reverse" is the mean squared distance of the nodes predicted for the joints to those that the
    positions visit, in the unit box; "links" the root mean square of the residuals [unit].
    """
    model = rows.model
    baseline = model.baseline
    assert baseline is not None  # noqa: S101 - checked where the rows are read
    some = thinned(len(rows), _MOST)
    sensory = model.sensory
    measured = sensory.scale.to_unit(rows.x[some])
    predicted = sensory.scale.to_unit(rows.predicted[some])
    nodes = sensory.units[sensory.nearest(measured)[1][:, 0]]
    nodes_predicted = sensory.units[sensory.nearest(predicted)[1][:, 0]]
    away = search_tree(np.unique(nodes, axis=0), sensory.scale).query(
        nodes_predicted
    )[0]
    bound = rows.bound[some]
    usual = np.where(np.isfinite(bound), bound, 0.0)
    return {
        "motor": _zeta(model.motor, rows.u[some], baseline.motor),
        "sensory": _zeta(sensory, measured, baseline.sensory),
        "reverse": Signal(
            float(np.mean(np.asarray(away) ** 2)), sensory.spacing**2
        ),
        "links": Signal(
            _root_mean_square(rows.missed[some]), _root_mean_square(usual)
        ),
    }


def _zeta(network: Map, points: Array, expected: Array) -> Signal:
    """Distortion (eq. 9) of points (n, p) in the unit box, beside the winners' own (nodes,)."""
    distance, winner = network.nearest(points)
    return Signal(
        float(np.mean(distance[:, 0] ** 2)),
        float(expected[winner[:, 0]].mean()),
    )


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
