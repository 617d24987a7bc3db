"""Socket places: where a model has the sockets that a log touched.

With its sockets as positions, which may be elsewhere, a log of touches is judged like any other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Index
from ..common.rows import finite_rows, row_lengths
from ..errors import LogError
from ..model.model import Model
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from ..samples.sockets import Touches
from .settings import TOUCHING

NOT_LEARNED = (
    "no row of the log lies within what the model has learned: measure others"
)


def in_sockets(
    model: Model, samples: Samples, touch: Touches
) -> tuple[Samples, dict[str, Any]]:
    """Touches with the means of the predicted tips as positions, and how tips scatter about them.

    Rows that are in no socket of theirs are left out.
    """
    tip = model.forward(samples.q)
    rows = np.flatnonzero(finite_rows(tip))
    strays = touch.take(rows).strays(tip[rows])
    if strays.mean() <= TOUCHING.most:  # of more it is the model that is wrong
        rows = rows[~strays]
    touch = touch.take(rows)
    tip = tip[rows]
    if not touch.is_touch.any():
        raise LogError(NOT_LEARNED)
    means = touch.means(tip)
    samples = samples.take(rows)
    still = np.zeros_like(samples.q)
    samples = replace(samples, x=touch.positions(samples.x, means), side=still)
    distance = row_lengths(tip - samples.x)
    touched = touch.is_touch
    bound = model.expected_error(samples.q[touched])
    return samples, {
        "scatter": _sizes(distance[touched], bound),
        "points": _scatter_by_point(touch, distance),
        "distances": _distances(touch, means),
    }


def as_positions(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """A log whose touches have their sockets where a model has them, and notes.

    Each posture counts once.  Rows in turn are of each socket, so that a part of them is of all.
    Raises LogError if the model is not of an arm in space.
    """
    if log.touch is None:
        return log, []
    body = model.body
    structure = None if body is None else body.structure
    if not isinstance(structure, SpatialStructure) or structure.outputs != 3:
        raise LogError(
            "the log holds touches: expected a model of an arm in space with a body"
        )
    postures = at_poses(log)
    touches, _ = in_sockets(model, postures, postures.touch or log.touch)
    notes = []
    strays = len(postures) - len(touches)
    if strays:
        notes.append(f"{strays} touches in no socket of theirs are left out")
    touch = touches.touch or log.touch
    return touches.take(_in_turn(touch.number)), notes


def _in_turn(number: Index) -> Index:
    """The order (n,) in which rows of sockets (n,) take turns, those of each spread over all."""
    share = np.empty(len(number))
    for socket in np.unique(number):
        rows = np.flatnonzero(number == socket)
        share[rows] = (np.arange(len(rows)) + 0.5) / len(rows)
    return np.argsort(share, kind="stable")


def _sizes(distance: Array, bound: Array) -> dict[str, float]:
    """Sizes of distances (n,) [m] from sockets, and the share of them that bounds (n,) hold."""
    return {
        "mean": float(distance.mean()),
        "rms": float(np.sqrt((distance**2).mean())),
        "p95": float(np.quantile(distance, 0.95)),
        "max": float(distance.max()),
        "covered": float(np.mean(distance <= bound)),
    }


def _scatter_by_point(touch: Touches, distance: Array) -> list[dict[str, Any]]:
    """Number of touches of each socket, and the mean of their `distance` (n,) [m] from it."""
    points = []
    for number in np.unique(touch.number[touch.is_touch]):
        setup, point = touch.sockets[number]
        scatter = distance[touch.number == number]
        points.append(
            {
                "setup": setup,
                "point": point,
                "rows": len(scatter),
                "scatter": float(scatter.mean()),
            }
        )
    return points


def _distances(touch: Touches, places: Array) -> list[dict[str, Any]]:
    """Stated distances [m], and those between the sockets' places (p, 3), where both are known."""
    distances = []
    for fact in touch.distances:
        one, other = places[list(fact.points)]
        predicted = float(np.linalg.norm(one - other))
        if np.isfinite(predicted):
            ends = [list(touch.sockets[number]) for number in fact.points]
            distances.append(
                {"points": ends, "stated": fact.value, "predicted": predicted}
            )
    return distances
