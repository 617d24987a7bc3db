"""Bounds of a model that was learned from a log, for each motor node.

With a body they are its posterior's: they grow with the distance from the rows by
themselves.  Without one nothing is known beyond the rows, so the bound grows with the
distance as fast as the position can change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale
from ..maps.map import search_tree
from ..maps.node_bounds import learn_bounds
from ..model.model import Model

Array = NDArray[np.float64]

_BESIDE = 2.0  # a node within so many gaps between rows from a row is beside it
_AWAY = 6.0  # a node further away than so many gaps has no part in what the rows showed
_RADIUS_95 = 2.448  # radius that holds 95 % of a 2-D Gaussian of standard deviation 1


def node_bounds(
    model: Model, u: Array, rows: NDArray[np.intp], errors: Array, *, has_models: bool
) -> tuple[Array, Array]:
    """Bounds (nodes,) on what the sensor reads and on the true position.

    Parameters
    ----------
    model : Model
        Whose bounds are still to be learned.
    u : (n, dof) array
        Measured rows, in the unit box.
    rows : (k,) int array
        Those that were held out.
    errors : (k,) array [unit]
        Their held-out errors.
    has_models : bool
        Whether local models mend what the smooth part leaves over.
    """
    motor = model.motor
    nodes = np.clip(motor.units, 0.0, 1.0)
    if model.body is None:
        learned = learn_bounds(motor, u[rows], errors)
        return learned, learned  # they hold beside the rows, see `calib.model.trust`
    q = motor.scale.from_unit(nodes)
    reading = model.body.bound(q, noise=True)
    position = model.body.bound(q, noise=False)
    if has_models:
        beside = _beside(nodes, u, motor.scale, motor.spacing)
        learned = learn_bounds(motor, u[rows], errors)
        noise = _RADIUS_95 * float(np.sqrt(np.mean(model.body.noise[:2] ** 2)))
        reading = beside * np.minimum(learned, reading) + (1.0 - beside) * reading
        mended = np.sqrt(np.maximum(reading**2 - noise**2, 0.0))
        position = np.maximum(position * (1.0 - beside), np.minimum(position, mended))
    return reading, position


def _gap(nodes: Array, u: Array, scale: Scale) -> Array:
    """Distance (nodes,) to the nearest row, in the unit box."""
    return np.asarray(search_tree(u, scale).query(np.where(scale.periodic, nodes % 1.0, nodes))[0])


def _gaps(u: Array, scale: Scale) -> float:
    """Distance in the unit box from a row to the next one, which nine of ten rows are within."""
    gaps = np.asarray(search_tree(u, scale).query(u, k=[min(2, len(u))])[0])[:, 0]
    return float(np.quantile(gaps, 0.9))


def _beside(nodes: Array, u: Array, scale: Scale, spacing: float) -> Array:
    """Share (nodes,) to which what rows showed speaks for a node: 1 beside rows, 0 away."""
    unit = max(_gaps(u, scale), spacing)
    away = _gap(nodes, u, scale) / unit
    return np.clip((_AWAY - away) / (_AWAY - _BESIDE), 0.0, 1.0)
