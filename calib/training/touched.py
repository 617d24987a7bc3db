"""Touches: the arm and its sockets first; then sockets are positions like others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.arm import SpatialArm
from ..body.belief import Body
from ..body.body_fit import BodyFit
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import with_measurements
from ..body.settings import STUDENT
from ..body.spatial import SpatialStructure, structure_of
from ..body.touch import (
    DRAWN_SIZE,
    fit_touches,
    in_structure,
    rows_of_touches,
    with_size,
)
from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, median_length, row_lengths
from ..errors import LogError
from ..model.model import Model
from ..samples.samples import Samples
from ..samples.sockets import Touches
from ..samples.tables import rows_in_words
from .options import TrainingOptions
from .settings import LEARNING, TOUCHING
from .smooth import SmoothPart

NOT_LEARNED = (
    "no row of the log lies within what the model has learned: measure others"
)

_BASE = (
    "no touch tells where the base stands and how it is turned about the first axis: both stay as "
    "drawn and are left out of intervals"
)
_SIZE = (
    "touches alone do not tell how large the arm is: its size stays as drawn; state the distance "
    "of two points, as in `distance='A,B=50mm'`"
)


@dataclass(frozen=True, eq=False)
class Sockets:
    """An arm that was fitted to its touches."""

    fit: BodyFit
    places: Array  # (p, 3) [m], where the sockets are
    used: Mask  # (n,), rows whose tips are in their sockets
    scatter: float  # [m], median distance of tips from their sockets


def fit_sockets(
    samples: Samples, touch: Touches, options: TrainingOptions
) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit arm and sockets; rows that are not in theirs are left out.

    Returns the samples with their sockets' places as positions: in the arm's base frame, or in the
        sensor's where one measured some rows.
    Raises LogError if the touches tell nothing of the arm, or no arm explains them.
    """
    arm = samples.arm
    if not isinstance(arm, SpatialArm):
        raise LogError(
            "touches need the robot in space that made them: give its URDF"
        )
    _refuse_alike(samples, touch)
    touched_alone = bool(touch.is_touch.all())
    structure = structure_of(arm, "base" if touched_alone else "rigid")
    structure = replace(structure, zeros_alone=options.free == "offsets")
    sockets = _fit_sound_touches(samples, touch, structure, options.seed)
    notes: list[str] = []
    size_sd = 0.0
    if touched_alone:
        sockets, size_sd, words = _of_right_size(
            sockets, samples, touch, structure, options.seed
        )
        notes = [_BASE, *words]
    if sockets.scatter > LEARNING.no_arm * arm.chain.reach:
        raise LogError(
            f"no arm explains the touches: the tips scatter by {1e3 * sockets.scatter:.3g} mm "
            "about their sockets (median); check the joints' order and unit, the tip, and the "
            "points' names"
        )
    strays = np.flatnonzero(~sockets.used)
    if len(strays):
        notes.append(
            f"{len(strays)} rows were in no socket of theirs and are left out: "
            f"{rows_in_words(samples.rows[strays])}"
        )
    fit = sockets.fit
    if size_sd:
        fit = replace(fit, body=with_size(fit.body, size_sd))
    positions = touch.positions(samples.x, sockets.places)
    samples = replace(samples, x=positions).take(sockets.used)
    rows = np.arange(len(samples))
    return samples, SmoothPart(fit, rows, samples.unit_box), notes


def _of_right_size(
    sockets: Sockets,
    samples: Samples,
    touch: Touches,
    structure: SpatialStructure,
    seed: int,
) -> tuple[Sockets, float, list[str]]:
    """The fit that has the arm's size right, where no sensor measured: by distances or the drawing.

    Returns the fit, the relative sd of its size beside what the rows tell, and notes.
    """
    if not touch.distances:
        return sockets, DRAWN_SIZE, [_SIZE]
    planes = tuple(fact for fact in touch.facts if fact.value is None)
    drawn = _fit_sound_touches(
        samples, replace(touch, facts=planes), structure, seed
    )
    words, apart = _size_words(touch, drawn)
    if not words:
        return sockets, 0.0, []
    size_sd = apart / 1.96 if apart <= TOUCHING.most_doubt else 0.0
    return drawn, size_sd, [words]


def _fit_sound_touches(
    samples: Samples, touch: Touches, structure: SpatialStructure, seed: int
) -> Sockets:
    """Fit arm and sockets, without the rows whose tips are far from their sockets."""
    used = np.ones(len(samples), dtype=bool)
    places = np.full((len(touch.sockets), 3), np.nan)
    for attempt in range(1, TOUCHING.attempts + 1):
        number, facts, sockets = touch.take(used).numbers_and_facts()
        fit, places[sockets] = fit_touches(
            structure,
            samples.q[used],
            number,
            facts,
            lower=samples.lower,
            upper=samples.upper,
            x=samples.x[used],
            seed=seed,
        )
        tip = fit.body.predict(samples.q)
        sound = ~touch.strays(tip, places)
        # the rows of the fit are those that are returned: what strays from the last one stays
        too_many = sound.mean() < 1 - TOUCHING.most
        if (sound == used).all() or too_many or attempt == TOUCHING.attempts:
            break
        used = sound
    in_place = used & touch.is_touch
    scatter = median_length((tip - places[touch.number])[in_place])
    return Sockets(fit, places, used, scatter)


def _size_words(touch: Touches, drawn: Sockets) -> tuple[str, float]:
    """Return what stated distances say of an arm of its drawing's size, and how far they are off.

    The words are empty where both may be true.
    """
    points = np.array([fact.points for fact in touch.distances])
    stated = np.array([fact.value for fact in touch.distances], dtype=float)
    tolerance = np.array([fact.tolerance for fact in touch.distances])
    fitted = row_lengths(
        drawn.places[points[:, 0]] - drawn.places[points[:, 1]]
    )
    weight = np.nan_to_num(fitted / np.hypot(tolerance, drawn.scatter)) ** 2
    if not weight.any():
        return "", 0.0
    ratio = float(np.nansum(weight * stated / fitted) / weight.sum())
    apart = abs(ratio - 1.0)
    doubt = float(np.hypot(weight.sum() ** -0.5, DRAWN_SIZE))
    if apart <= TOUCHING.clearly * doubt:
        return "", 0.0
    size = 1e3 * stated[0] / ratio
    widened = "bounds contain both"
    if apart > TOUCHING.most_doubt:
        widened = "no drawing is so far off, so the distance is left out"
    return (
        f"the size of the arm: {' and '.join(map(touch.name, points[0]))} are said to be "
        f"{1e3 * stated[0]:.4g} mm apart, by the drawing's size they are {size:.4g} +- "
        f"{1.96 * size * doubt:.2g} mm: one of the two is wrong by {100 * apart:.2g} %; the "
        f"drawing's is taken, and {widened}"
    ), apart


def _refuse_alike(samples: Samples, touch: Touches) -> None:
    """Refuse touches that are too few or too much alike to tell anything of the arm."""
    sockets, counts = np.unique(
        touch.number[touch.is_touch], return_counts=True
    )
    spans = [np.ptp(samples.q[touch.number == k], axis=0) for k in sockets]
    alike = np.max(spans, initial=0.0) < TOUCHING.alike
    few = counts.sum() < TOUCHING.few or counts.max() < TOUCHING.few_of_one
    if alike or few:
        raise LogError(
            f"{counts.sum()} touches of {len(sockets)} sockets"
            f"{', all alike,' if alike else ''} tell nothing of the arm: expected 20 postures and "
            "more in each socket, from other sides, with the wrist turned each way"
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
    touched = touch.is_touch
    tip = tip[rows]
    if not touched.any():
        raise LogError(NOT_LEARNED)
    means = touch.means(tip)
    samples = samples.take(rows)
    samples = replace(
        samples,
        x=touch.positions(samples.x, means),
        side=np.zeros_like(samples.q),
    )
    off = row_lengths(tip - samples.x)
    bound = model.expected_error(samples.q[touched])
    scatter = {
        "mean": float(off[touched].mean()),
        "rms": float(np.sqrt((off[touched] ** 2).mean())),
        "p95": float(np.quantile(off[touched], 0.95)),
        "max": float(off[touched].max()),
        "covered": float(np.mean(off[touched] <= bound)),
    }
    return samples, {
        "scatter": scatter,
        "points": _scatter_by_point(touch, off),
        "distances": _distances(touch, means),
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


def as_positions(
    model: Model, log: Samples, touch: Touches
) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions of a model, and notes.

    Sockets are where the model has them; where touches speak clearly for a change of the arm, where
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
    if len(log) < count:
        notes.append(
            f"{count - len(log)} touches in no socket of theirs are left out"
        )
    places = _places_after_change(
        body, structure, model.about.joints_of(log), log, touch
    )
    if places is not None:
        log = replace(log, x=touch.positions(log.x, places))
    return replace(log, touch=None), notes


def _places_after_change(
    body: Body,
    structure: SpatialStructure,
    q: Array,
    log: Samples,
    touch: Touches,
) -> Array | None:
    """Places (p, 3) of the sockets in the sensor's frame, as a changed arm has them.

    body, q : the belief before, and joint values (n, dof) in its order
    Returns None where the touches do not clearly speak for a change.
    """
    noise = float(body.noise[0]) / structure.metre
    number, facts, sockets = touch.numbers_and_facts()
    rows = [
        replace(measured, floor=0.5 * noise, noise=noise)
        for measured in rows_of_touches(q, number, facts, log.x)
    ]
    seen = with_measurements(structure, rows)
    point = seen.groups["point"]
    belief = in_structure(body, seen)
    beta = belief.beta.copy()
    beta[point] = touch.means(structure.pose(q, body.beta)[0])[sockets].ravel()

    # the covariance of the belief, and of sockets that may be anywhere
    active = belief.active
    variance = np.zeros((seen.size, seen.size))
    gauge = TOUCHING.gauge**2 * np.eye(len(active))
    variance[np.ix_(active, active)] = body.kappa**2 * belief.covariance + gauge
    variance[point, point] = structure.chain.reach**2
    may_change = np.zeros(seen.size)
    may_change[seen.groups["offset"]] = TOUCHING.offset**2
    may_change[seen.groups["tool"]] = TOUCHING.tool**2
    may_change[seen.groups["placement"]] = TOUCHING.placement**2

    def fit_with(variance: Array) -> Fit:
        """The fit with a prior of this covariance (d, d) around the parameters."""
        sd = np.sqrt(np.diag(variance))
        free = np.flatnonzero(sd)
        precision = np.asarray(np.linalg.inv(variance[np.ix_(free, free)]))
        prior = Prior(beta, sd, precision=precision)
        return Fit(seen, rows, beta, prior, nu=STUDENT).maximise(steps=8)

    same = fit_with(variance)
    changed = fit_with(variance + np.diag(may_change))
    gain = changed.evidence - same.evidence
    if gain <= TOUCHING.nats * changed.autocorrelation:
        return None
    arm = in_structure(replace(belief, beta=changed.beta), structure)
    sensor = structure.sensor(arm.beta)
    points = changed.beta[point].reshape(-1, 3)
    places = np.full((len(touch.sockets), 3), np.nan)
    places[sockets] = sensor.scale * points @ sensor.rotation.T + sensor.shift
    return places
