"""Touch scatter: how far a model's tips are from the middle of the touches of each socket."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.rows import finite_rows, row_lengths
from ..errors import LogError
from ..model.model import Model
from ..samples.samples import Samples
from ..samples.sockets import Touches

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
    rows = rows[~touch.take(rows).strays(tip[rows])]
    touch = touch.take(rows)
    tip = tip[rows]
    if not touch.is_touch.any():
        raise LogError(NOT_LEARNED)
    means = touch.means(tip)
    samples = samples.take(rows)
    still = np.zeros_like(samples.q)
    samples = replace(samples, x=touch.positions(samples.x, means), side=still)
    off = row_lengths(tip - samples.x)
    touched = touch.is_touch
    bound = model.expected_error(samples.q[touched])
    return samples, {
        "scatter": _sizes(off[touched], bound),
        "points": _scatter_by_point(touch, off),
        "distances": _distances(touch, means),
    }


def _sizes(off: Array, bound: Array) -> dict[str, float]:
    """Sizes of distances (n,) [m] from sockets, and the share of them that bounds (n,) hold."""
    return {
        "mean": float(off.mean()),
        "rms": float(np.sqrt((off**2).mean())),
        "p95": float(np.quantile(off, 0.95)),
        "max": float(off.max()),
        "covered": float(np.mean(off <= bound)),
    }


def _scatter_by_point(touch: Touches, off: Array) -> list[dict[str, Any]]:
    """Number of touches of each socket and the mean of their distances `off` (n,) [m] from it."""
    points = []
    for number in np.unique(touch.number[touch.is_touch]):
        setup, point = touch.sockets[number]
        scatter = off[touch.number == number]
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
    """Stated distances [m] beside those of the sockets' places (p, 3), where both are known."""
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
