"""Touches: the arm and its sockets first; then sockets are positions like others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.arm import SpatialArm
from ..body.body_fit import BodyFit
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import together
from ..body.settings import STUDENT
from ..body.size import DRAWN_SIZE, size_of, with_size
from ..body.spatial import SpatialStructure, structure_of
from ..body.touch import fit_touches, restated, touching
from ..common.arrays import Array, Index, Mask
from ..errors import LogError
from ..model.model import Model
from ..samples.samples import Samples
from ..samples.sockets import Touches
from ..samples.wrong_rows import row_numbers
from .learn import TrainingOptions
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
    touch: Touches
    places: Array  # (p, 3) [m], where the sockets are
    used: Mask  # (n,), rows that are in theirs
    tip: Array  # (n, 3) [m], where the arm has its tip
    scatter: float  # [m], median distance of tips from their sockets

    def of_doubtful_size(self, sd: float) -> Sockets:
        """The fit of an arm whose size is known to a relative `sd` alone."""
        return replace(
            self, fit=replace(self.fit, body=with_size(self.fit.body, sd))
        )

    @property
    def ratios(self) -> Array:
        """Stated distances over fitted ones, and the sd of each, (k, 2)."""
        ratios = []
        for fact in self.touch.distances:
            fitted = float(
                np.linalg.norm(np.subtract(*self.places[list(fact.points)]))
            )
            if np.isfinite(fitted) and fitted > 0:
                doubt = np.hypot(fact.tolerance, self.scatter)
                ratios.append(((fact.value or 0.0) / fitted, doubt / fitted))
        return np.reshape(ratios, (-1, 2))

    @property
    def sizes_disagree(self) -> bool:
        """Whether stated distances stretch the arm beyond its drawing, or are not met at all."""
        ratios = self.ratios
        if not len(ratios):
            return False
        stretched = (
            abs(size_of(self.fit.body) - 1.0) > TOUCHING.clearly * DRAWN_SIZE
        )
        missed = np.abs(ratios[:, 0] - 1.0) > TOUCHING.clearly * ratios[:, 1]
        return bool(stretched or missed.any())


def fit_sockets(
    samples: Samples, options: TrainingOptions
) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit arm and sockets; rows that are not in theirs are left out.

    Returns the samples with their sockets' places as positions: in the arm's base frame, or in the
        sensor's where one measured some rows.
    Raises LogError if the touches tell nothing of the arm, or no arm explains them.
    """
    arm = samples.arm
    touch = samples.touch
    assert touch is not None  # noqa: S101 - samples of touches
    if not isinstance(arm, SpatialArm):
        raise LogError(
            "touches need the robot in space that made them: give its URDF"
        )
    _refuse_alike(samples, touch)
    base_is_measured = not touch.touched.all()
    structure = structure_of(arm, "rigid" if base_is_measured else "base")
    structure = replace(structure, zeros_alone=options.free == "offsets")
    seed = options.seed
    sockets = _fit_sound_touches(samples, touch, structure, seed)
    notes: list[str] = []
    if not base_is_measured:
        if sockets.sizes_disagree:
            planes = [fact for fact in touch.facts if fact.value is None]
            undistanced = replace(touch, facts=tuple(planes))
            by_drawing = _fit_sound_touches(
                samples, undistanced, structure, seed
            )
            words, doubt = _size_words(replace(by_drawing, touch=touch))
            if words:
                notes.append(words)
                sockets = by_drawing
                if doubt <= TOUCHING.most_doubt:
                    sockets = sockets.of_doubtful_size(doubt / 1.96)
        if not touch.distances:
            sockets = sockets.of_doubtful_size(DRAWN_SIZE)
    if sockets.scatter > LEARNING.no_arm * arm.chain.reach:
        raise LogError(
            f"no arm explains the touches: the tips scatter by {1e3 * sockets.scatter:.3g} mm "
            "about their sockets (median); check the joints' order and unit, the tip, and the "
            "points' names"
        )
    notes += _stray_words(samples, sockets)
    if not base_is_measured:
        notes.append(_BASE)
        if not touch.distances:
            notes.append(_SIZE)
    placed = replace(samples, x=touch.placed(samples.x, sockets.places))
    samples = placed.take(sockets.used)
    return (
        samples,
        SmoothPart.of(samples, sockets.fit, np.arange(len(samples))),
        notes,
    )


def _fit_sound_touches(
    samples: Samples, touch: Touches, structure: SpatialStructure, seed: int
) -> Sockets:
    """Fit arm and sockets to the rows that are in theirs."""
    used = np.ones(len(samples), dtype=bool)
    places = np.full((len(touch.sockets), 3), np.nan)
    for attempt in range(1, TOUCHING.attempts + 1):
        number, facts, sockets = touch.take(used).renumbered()
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
        distance = np.linalg.norm(tip - places[touch.number], axis=1)
        sound = ~touch.strays(distance)
        # the rows of the fit are those that are returned: what strays from the last one stays
        too_many = sound.mean() < 1 - TOUCHING.most
        if (sound == used).all() or too_many or attempt == TOUCHING.attempts:
            break
        used = sound
    scatter = float(np.median(distance[used & touch.touched]))
    return Sockets(fit, touch, places, used, tip, scatter)


def _size_words(by_drawing: Sockets) -> tuple[str, float]:
    """Return what drawing and stated distances say of the arm's size, and how far they are apart.

    The words are empty where both may be true.
    """
    touch = by_drawing.touch
    ratios = by_drawing.ratios
    weights = ratios[:, 1] ** -2.0
    ratio = float(ratios[:, 0] @ weights / weights.sum())
    sd = float(weights.sum() ** -0.5)
    apart = abs(ratio - 1.0)
    doubt = float(np.hypot(sd, DRAWN_SIZE))
    if apart <= TOUCHING.clearly * doubt:
        return "", 0.0
    fact = touch.distances[0]
    value = fact.value or 0.0
    drawn = value / ratio
    widened = "bounds contain both"
    if apart > TOUCHING.most_doubt:
        widened = "no drawing is so far off, so the distance is left out"
    words = (
        f"the size of the arm: {' and '.join(map(touch.name, fact.points))} are said to be "
        f"{1e3 * value:.4g} mm apart, by the drawing's size they are {1e3 * drawn:.4g} +- "
        f"{1.96e3 * drawn * doubt:.2g} mm: one of the two is wrong by {100 * apart:.2g} %; the "
        f"drawing's is taken, and {widened}"
    )
    return words, apart


def _refuse_alike(samples: Samples, touch: Touches) -> None:
    """Refuse touches that are too few or too much alike to tell anything of the arm."""
    sockets, counts = np.unique(touch.number[touch.touched], return_counts=True)
    spans = [
        np.ptp(samples.q[touch.number == socket], axis=0).max()
        for socket in sockets
    ]
    alike = max(spans, default=0.0) < TOUCHING.alike
    few = counts.sum() < TOUCHING.few or counts.max() < TOUCHING.few_of_one
    if alike or few:
        raise LogError(
            f"{counts.sum()} touches of {len(sockets)} sockets"
            f"{', all alike,' if alike else ''} tell nothing of the arm: expected 20 postures and "
            "more in each socket, from other sides, with the wrist turned each way"
        )


def _stray_words(samples: Samples, sockets: Sockets) -> list[str]:
    """Name the rows that were in no socket of theirs, and the socket that one of them was in."""
    strays = np.flatnonzero(~sockets.used)
    if not len(strays):
        return []
    rows = row_numbers(samples, strays)
    notes = [
        f"{len(strays)} rows were in no socket of theirs and are left out: {rows}"
    ]
    distance = np.linalg.norm(
        sockets.tip[strays, None] - sockets.places, axis=2
    )
    stray, socket = np.unravel_index(np.nanargmin(distance), distance.shape)
    if distance[stray, socket] <= max(
        TOUCHING.in_socket * sockets.scatter, 1e-9
    ):
        row = row_numbers(samples, strays[[stray]])
        notes.append(
            f"{row} was in the socket {sockets.touch.name(int(socket))!r}: a wrong name?"
        )
    return notes


def in_sockets(
    model: Model, samples: Samples, touch: Touches
) -> tuple[Samples, dict[str, Any]]:
    """Touches with the means of the predicted tips as positions, and how tips scatter about them.

    Rows that are in no socket of theirs are left out.
    """
    tip = model.forward(samples.q)
    answered = np.flatnonzero(np.isfinite(tip).all(axis=1))
    strays = touch.take(answered).strays(
        touch.take(answered).about_medians(tip[answered])
    )
    rows = answered[~strays]
    samples = samples.take(rows)
    touch = touch.take(rows)
    tip = tip[rows]
    touched = touch.touched
    if not touched.any():
        raise LogError(NOT_LEARNED)
    means = touch.means(tip)
    off = np.linalg.norm(tip - means[touch.number], axis=1)
    points = []
    for number in np.unique(touch.number[touched]):
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
    distances = []
    for fact in touch.distances:
        predicted = float(
            np.linalg.norm(np.subtract(*means[list(fact.points)]))
        )
        if np.isfinite(predicted):
            ends = [list(touch.sockets[number]) for number in fact.points]
            distances.append(
                {"points": ends, "stated": fact.value, "predicted": predicted}
            )
    off = off[touched]
    bound = model.expected_error(samples.q[touched])
    sizes = {
        "mean": float(off.mean()),
        "rms": float(np.sqrt((off**2).mean())),
        "p95": float(np.quantile(off, 0.95)),
        "max": float(off.max()),
        "covered": float(np.mean(off <= bound)),
    }
    samples = replace(samples, x=touch.placed(samples.x, means))
    return samples, {"scatter": sizes, "points": points, "distances": distances}


def as_positions(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions of a model, and notes.

    They are found with the model's belief as prior, as it is and with what may have changed: where
    the evidence speaks clearly for a change they are where the changed arm has them.
    Raises LogError if the model is not of an arm in space.
    """
    body = model.body
    touch = log.touch
    count = len(log)
    assert touch is not None  # noqa: S101 - a log of touches
    structure = None if body is None else body.structure
    if not isinstance(structure, SpatialStructure) or structure.outputs != 3:
        raise LogError(
            "the log holds touches: expected a model of an arm in space with a body"
        )
    assert body is not None  # noqa: S101 - it has the structure
    log, _ = in_sockets(model, log, touch)  # where the model has them
    touch = log.touch or touch
    notes = []
    if len(log) < count:
        notes.append(
            f"{count - len(log)} touches in no socket of theirs are left out"
        )
    q = model.about.joints_of(log)
    noise = float(body.noise[0]) / structure.metre
    number, facts, sockets = touch.renumbered()
    rows = [
        replace(measured, floor=0.5 * noise, noise=noise)
        for measured in touching(q, number, facts, log.x)
    ]
    seen = together(structure, rows)
    belief = restated(body, seen)
    tip = structure.pose(q, body.beta)[0]
    point = seen.groups["point"]
    beta = belief.beta.copy()
    beta[point] = np.ravel(
        [tip[number == k].mean(axis=0) for k in range(len(sockets))]
    )
    active = belief.active
    variance = np.zeros((seen.size, seen.size))
    gauge = TOUCHING.gauge**2 * np.eye(len(active))
    variance[np.ix_(active, active)] = body.kappa**2 * belief.covariance + gauge
    variance[point, point] = structure.chain.reach**2
    same = _fit_around(seen, rows, beta, variance)
    freed = {
        "offset": TOUCHING.offset,
        "tool": TOUCHING.tool,
        "placement": TOUCHING.placement,
    }
    for group, sd in freed.items():
        indices = seen.groups[group]
        variance[indices, indices] += sd**2
    changed = _fit_around(seen, rows, beta, variance)
    if (
        changed.evidence - same.evidence
        > TOUCHING.nats * changed.autocorrelation
    ):
        sensor = structure.sensor(
            restated(replace(belief, beta=changed.beta), structure).beta
        )
        places = np.full((len(touch.sockets), 3), np.nan)
        at_sockets = changed.beta[point].reshape(-1, 3)
        places[sockets] = (
            sensor.scale * at_sockets @ sensor.rotation.T + sensor.shift
        )
        log = replace(log, x=touch.placed(log.x, places))
    return replace(log, touch=None), notes


def _fit_around(
    seen: Any, rows: list[Any], beta: Array, variance: Array
) -> Fit:
    """The fit of touches with a prior of some variance (d, d) around parameters (d,)."""
    sd = np.sqrt(np.diag(variance))
    free: Index = np.flatnonzero(sd)
    precision = np.asarray(np.linalg.inv(variance[np.ix_(free, free)]))
    prior = Prior(beta, sd, known=precision)
    return Fit(seen, rows, beta, prior, nu=STUDENT).maximise(steps=8)
