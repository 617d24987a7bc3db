"""Socket places: where a model, or its arm after a change, has the sockets that a log touched.

With its sockets as positions a log of touches is judged like any other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..body.belief import Body
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows, with_measurements
from ..body.settings import STUDENT
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..body.touch import in_structure, rows_of_touches
from ..common.arrays import Array
from ..common.rows import finite_rows, row_lengths
from ..errors import LogError
from ..model.model import Model
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
    rows = rows[~touch.take(rows).strays(tip[rows])]
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


def as_positions(
    model: Model, log: Samples, touch: Touches
) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions of a model, and notes.

    Sockets are where the model has them; where touches clearly show a change of the arm, where
    the changed arm has them.
    Raises LogError if the model is not of an arm in space.
    """
    body = model.body
    structure = None if body is None else body.structure
    if (
        body is None
        or not isinstance(structure, SpatialStructure)
        or structure.outputs != 3
    ):
        raise LogError(
            "the log holds touches: expected a model of an arm in space with a body"
        )
    count = len(log)
    log, _ = in_sockets(model, log, touch)  # where the model has them
    touch = log.touch or touch
    notes = []
    strays = count - len(log)
    if strays:
        notes.append(f"{strays} touches in no socket of theirs are left out")
    q = model.about.joints_of(log)
    places = _places_after_change(body, structure, q, log.x, touch)
    if places is not None:
        log = replace(log, x=touch.positions(log.x, places))
    return replace(log, touch=None), notes


def _places_after_change(
    body: Body, structure: SpatialStructure, q: Array, x: Array, touch: Touches
) -> Array | None:
    """Places (p, 3) of the sockets in the sensor's frame, as a changed arm has them.

    The arm and its sockets are fitted twice, with the arm as it was and with one that may have
    changed.

    body, structure : the belief before
    q, x : (n, dof) and (n, 3), joint values in the body's order, and readings of the sensor
    Returns None where the touches are no clear evidence of a change.
    """
    noise = float(body.noise[0]) / structure.metre
    number, facts, sockets = touch.numbers_and_facts()
    rows = [
        replace(measured, floor=0.5 * noise, noise=noise)
        for measured in rows_of_touches(q, number, facts, x)
    ]
    with_points = with_measurements(structure, rows)
    point = with_points.groups["point"]
    belief = in_structure(body, with_points)
    beta = belief.beta.copy()
    tips = structure.pose(q, body.beta)[0]
    beta[point] = touch.means(tips)[sockets].ravel()

    before = _covariance_before(belief, structure.chain.reach)
    after = before + np.diag(_variance_of_changes(with_points))
    same = _most_probable(with_points, rows, beta, before)
    changed = _most_probable(with_points, rows, beta, after)
    gain = changed.evidence - same.evidence
    if gain <= TOUCHING.nats * changed.autocorrelation:
        return None
    arm = in_structure(replace(belief, beta=changed.beta), structure)
    sensor = structure.sensor(arm.beta)
    points = changed.beta[point].reshape(-1, 3)
    places = np.full((len(touch.sockets), 3), np.nan)
    places[sockets] = sensor.scale * points @ sensor.rotation.T + sensor.shift
    return places


def _covariance_before(belief: Body, reach: float) -> Array:
    """Covariance (d, d) of a belief, and of sockets that may be anywhere within `reach` [m]."""
    structure = belief.structure
    active = belief.active
    variance = np.zeros((structure.size, structure.size))
    gauge = TOUCHING.gauge**2 * np.eye(len(active))
    variance[np.ix_(active, active)] = (
        belief.kappa**2 * belief.covariance + gauge
    )
    point = structure.groups["point"]
    variance[point, point] = reach**2
    return variance


def _variance_of_changes(structure: Structure) -> Array:
    """Variances (d,) of what may have changed of an arm since."""
    variance = np.zeros(structure.size)
    variance[structure.groups["offset"]] = TOUCHING.offset**2
    variance[structure.groups["tool"]] = TOUCHING.tool**2
    variance[structure.groups["placement"]] = TOUCHING.placement**2
    return variance


def _most_probable(
    structure: Structure, rows: list[Rows], beta: Array, covariance: Array
) -> Fit:
    """The fit to rows with a prior of this covariance (d, d) around the parameters (d,)."""
    sd = np.sqrt(np.diag(covariance))
    free = np.flatnonzero(sd)
    precision = np.asarray(np.linalg.inv(covariance[np.ix_(free, free)]))
    prior = Prior(beta, sd, precision=precision)
    return Fit(structure, rows, beta, prior, nu=STUDENT).maximise(steps=8)


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
