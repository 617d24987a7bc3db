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
from .smooth import NO_ARM, SmoothPart

NOT_LEARNED = "no row of the log lies within what the model has learned: measure others"

_MOST = 0.25  # share of rows that may be wrong
_ATTEMPTS = 3  # fits, each without the rows that strayed from the one before
_FEW = 12  # touches that tell an arm in space at least
_FEW_OF_ONE = 4  # of them in one socket
# times the usual scatter, within which a stray row was in another socket
_IN_SOCKET = 5.0
# joints that moved less in each socket [rad or m] tell nothing of the arm
_ALIKE = 0.05
# What may have changed since, and by how much: a servo put on anew, a bent tip, origins [rad or m]
_FREED = {"offset": np.radians(2.0), "tool": 5e-3, "placement": 2e-3}
_NATS = 5.0  # of evidence for a change
_CLEARLY = 3.0  # sds by which two sizes of an arm have to differ
_MOST_DOUBT = 0.05  # relative; no drawing is further from its arm's size
_GAUGE = 1e-6  # [m or rad] of what no touch tells, and of what a belief holds for exact
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
    points: Array  # (p, 3) [m], where the sockets are
    used: Mask  # (n,), rows that are in theirs
    tip: Array  # (n, 3) [m], where the arm has its tip
    scatter: float  # [m], median distance of tips from their sockets


def fit_sockets(samples: Samples, seed: int) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit arm and sockets; rows that are not in theirs are left out.

    Returns the samples with their sockets' places as positions: in the arm's base frame, or in the
        sensor's where one measured some rows.
    Raises LogError if the touches tell nothing of the arm, or no arm explains them.
    """
    arm = samples.arm
    touch = samples.touch
    assert touch is not None  # noqa: S101 - samples of touches
    if not isinstance(arm, SpatialArm):
        raise LogError("touches need the robot in space that made them: give its URDF")
    _refuse_alike(samples, touch)
    touched = touch.number >= 0
    base_is_measured = not touched.all()
    structure = structure_of(arm, "rigid" if base_is_measured else "base")
    sockets = _fit_sound_touches(samples, touch, structure, seed)
    sizes: list[str] = []
    if not base_is_measured and _sizes_disagree(sockets, touch):
        drawn = replace(
            touch, known=tuple(fact for fact in touch.known if fact.value is None)
        )
        by_drawing = _fit_sound_touches(samples, drawn, structure, seed)
        words, doubt = _sizes(by_drawing, touch)
        if words:
            sizes = [words]
            sockets = by_drawing
        if words and doubt <= _MOST_DOUBT:
            sockets = _of_doubtful_size(sockets, doubt / 1.96)
    sized = base_is_measured or any(fact.value is not None for fact in touch.known)
    if not sized:
        sockets = _of_doubtful_size(sockets, DRAWN_SIZE)
    fit = sockets.fit
    points = sockets.points
    used = sockets.used
    tip = sockets.tip
    scatter = sockets.scatter
    if scatter > NO_ARM * arm.chain.reach:
        raise LogError(
            f"no arm explains the touches: the tips scatter by {1e3 * scatter:.3g} mm about their "
            "sockets (median); check the joints' order and unit, the tip, and the points' names"
        )
    notes = sizes + _stray_words(
        samples, touch, np.flatnonzero(~used), tip, points, scatter
    )
    if not base_is_measured:
        notes.append(_BASE)
        if not sized:
            notes.append(_SIZE)
    samples = replace(samples, x=_placed(samples, touch, points)).take(used)
    return samples, SmoothPart.of(samples, fit, np.arange(len(samples))), notes


def _fit_sound_touches(
    samples: Samples, touch: Touches, structure: SpatialStructure, seed: int
) -> Sockets:
    """Fit arm and sockets to the rows that are in theirs."""
    used = np.ones(len(samples), dtype=bool)
    points = np.full((len(touch.sockets), 3), np.nan)
    for attempt in range(_ATTEMPTS):
        number, known, sockets = touch.take(used).renumbered()
        fit, points[sockets] = fit_touches(
            structure,
            samples.q[used],
            number,
            known,
            lower=samples.lower,
            upper=samples.upper,
            x=samples.x[used],
            seed=seed,
        )
        tip = fit.body.predict(samples.q)
        distance = np.linalg.norm(tip - points[touch.number], axis=1)
        sound = ~touch.strays(distance)
        # the rows of the fit are those that are returned: what strays from the last one stays
        if (
            (sound == used).all()
            or sound.mean() < 1 - _MOST
            or attempt == _ATTEMPTS - 1
        ):
            break
        used = sound
    scatter = float(np.median(distance[used & (touch.number >= 0)]))
    return Sockets(fit, points, used, tip, scatter)


def _of_doubtful_size(sockets: Sockets, sd: float) -> Sockets:
    """Return the fit of an arm whose size is known to a relative `sd` alone."""
    return replace(
        sockets, fit=replace(sockets.fit, body=with_size(sockets.fit.body, sd))
    )


def _ratios(sockets: Sockets, touch: Touches) -> Array:
    """Return stated distances of sockets over fitted ones, and the sd of each, (k, 2)."""
    ratios = []
    for fact in touch.known:
        if fact.value is None:
            continue
        ends = sockets.points[list(fact.points)]
        fitted = float(np.linalg.norm(ends[0] - ends[1]))
        if np.isfinite(fitted) and fitted > 0:
            doubt = np.hypot(fact.tolerance, sockets.scatter)
            ratios.append((fact.value / fitted, doubt / fitted))
    return np.reshape(ratios, (-1, 2))


def _sizes_disagree(sockets: Sockets, touch: Touches) -> bool:
    """Whether stated distances stretch the arm beyond its drawing, or are not met at all."""
    ratios = _ratios(sockets, touch)
    if not len(ratios):
        return False
    stretched = abs(size_of(sockets.fit.body) - 1.0) > _CLEARLY * DRAWN_SIZE
    missed = np.abs(ratios[:, 0] - 1.0) > _CLEARLY * ratios[:, 1]
    return bool(stretched or missed.any())


def _sizes(by_drawing: Sockets, touch: Touches) -> tuple[str, float]:
    """Return what drawing and stated distances say of the arm's size, and how far they are apart.

    The words are empty where both may be true.
    """
    ratios = _ratios(by_drawing, touch)
    weights = ratios[:, 1] ** -2.0
    ratio = float(ratios[:, 0] @ weights / weights.sum())
    sd = float(weights.sum() ** -0.5)
    apart = abs(ratio - 1.0)
    if apart <= _CLEARLY * float(np.hypot(sd, DRAWN_SIZE)):
        return "", 0.0
    fact = next(fact for fact in touch.known if fact.value is not None)
    value = fact.value or 0.0
    drawn = value / ratio
    names = " and ".join(" ".join(touch.sockets[k]).strip() for k in fact.points)
    widened = "bounds contain both"
    if apart > _MOST_DOUBT:
        widened = "no drawing is so far off, so the distance is left out"
    words = (
        f"the size of the arm: {names} are said to be {1e3 * value:.4g} mm apart, by the drawing's "
        f"size they are {1e3 * drawn:.4g} +- {1.96e3 * drawn * np.hypot(sd, DRAWN_SIZE):.2g} mm: "
        f"one of the two is wrong by {100 * apart:.2g} %; the drawing's is taken, and {widened}"
    )
    return words, apart


def _refuse_alike(samples: Samples, touch: Touches) -> None:
    """Refuse touches that are too few or too much alike to tell anything of the arm."""
    sockets, counts = np.unique(touch.number[touch.number >= 0], return_counts=True)
    spans = [
        np.ptp(samples.q[touch.number == socket], axis=0).max() for socket in sockets
    ]
    alike = max(spans, default=0.0) < _ALIKE
    if alike or counts.sum() < _FEW or counts.max() < _FEW_OF_ONE:
        raise LogError(
            f"{counts.sum()} touches of {len(sockets)} sockets"
            f"{', all alike,' if alike else ''} tell nothing of the arm: expected 20 postures and "
            "more in each socket, from other sides, with the wrist turned each way"
        )


def _stray_words(
    samples: Samples,
    touch: Touches,
    strays: Index,
    tip: Array,
    points: Array,
    scatter: float,
) -> list[str]:
    """Name the rows that were in no socket of theirs, and the socket that one of them was in."""
    if not len(strays):
        return []
    rows = row_numbers(samples, strays)
    notes = [f"{len(strays)} rows were in no socket of theirs and are left out: {rows}"]
    distance = np.linalg.norm(tip[strays, None] - points, axis=2)
    stray, socket = np.unravel_index(np.nanargmin(distance), distance.shape)
    if distance[stray, socket] <= max(_IN_SOCKET * scatter, 1e-9):
        row = row_numbers(samples, strays[[stray]])
        name = " ".join(touch.sockets[socket]).strip()
        notes.append(f"{row} was in the socket {name!r}: a wrong name?")
    return notes


def in_sockets(
    model: Model, samples: Samples, touch: Touches
) -> tuple[Samples, dict[str, Any]]:
    """Touches with the means of the predicted tips as positions, and how tips scatter about them.

    Rows that are in no socket of theirs are left out.
    """
    tip = model.forward(samples.q)
    known = np.flatnonzero(np.isfinite(tip).all(axis=1))
    some = touch.take(known)
    known = known[~some.strays(some.about_medians(tip[known]))]
    samples = samples.take(known)
    touch = touch.take(known)
    tip = tip[known]
    touched = touch.number >= 0
    means = touch.means(tip)
    if not touched.any():
        raise LogError(NOT_LEARNED)
    off = np.linalg.norm(tip - means[touch.number], axis=1)
    points = [
        {
            "setup": setup,
            "point": point,
            "rows": int(own.sum()),
            "scatter": float(off[own].mean()),
        }
        for k, (setup, point) in enumerate(touch.sockets)
        if (own := touch.number == k).any()
    ]
    stated = [
        (each, means[list(each.points)])
        for each in touch.known
        if each.value is not None
    ]
    distances = [
        {
            "points": [list(touch.sockets[k]) for k in each.points],
            "stated": each.value,
            "predicted": float(np.linalg.norm(ends[0] - ends[1])),
        }
        for each, ends in stated
        if np.isfinite(ends).all()
    ]
    samples = replace(samples, x=_placed(samples, touch, means))
    off = off[touched]
    bound = model.expected_error(samples.q[touched])
    size = {
        "mean": off.mean(),
        "rms": np.sqrt((off**2).mean()),
        "p95": np.quantile(off, 0.95),
    }
    size |= {"max": off.max(), "covered": np.mean(off <= bound)}
    scatter = {name: float(value) for name, value in size.items()}
    return samples, {"scatter": scatter, "points": points, "distances": distances}


def as_positions(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions of a model, and what is told of them.

    They are found with the model's belief as prior, as it is and with what may have changed: where
    the evidence speaks clearly for a change they are where the changed arm has them.
    Raises LogError if the model is not of an arm in space.
    """
    body = model.body
    touch = log.touch
    count = len(log)
    assert touch is not None  # noqa: S101 - a log of touches
    structure = None if body is None else body.structure
    if (
        body is None
        or not isinstance(structure, SpatialStructure)
        or structure.outputs != 3
    ):
        raise LogError(
            "the log holds touches: expected a model of an arm in space with a body"
        )
    log, _ = in_sockets(model, log, touch)  # where the model has them
    gone = f"{count - len(log)} touches in no socket of theirs are left out"
    touch = log.touch or touch
    q = model.about.joints_of(log)
    noise = float(body.noise[0]) / structure.metre
    number, known, own = touch.renumbered()
    rows = [
        replace(each, floor=0.5 * noise, noise=noise)
        for each in touching(q, number, known, log.x)
    ]
    seen = together(structure, rows)
    belief = restated(body, seen)
    point = seen.groups["point"]
    at = belief.active
    beta = belief.beta.copy()
    variance = np.zeros((seen.size, seen.size))
    base = structure.pose(q, body.beta)[0]
    beta[point] = np.ravel([base[number == k].mean(axis=0) for k in range(len(own))])
    variance[np.ix_(at, at)] = body.kappa**2 * belief.covariance + _GAUGE**2 * np.eye(
        len(at)
    )
    variance[point, point] = structure.chain.reach**2
    fits = []
    for freed in ({}, _FREED):
        for group, sd in freed.items():
            variance[seen.groups[group], seen.groups[group]] += sd**2
        free = np.flatnonzero(np.diag(variance))
        sd = np.sqrt(np.diag(variance))
        prior = Prior(
            beta, sd, known=np.asarray(np.linalg.inv(variance[np.ix_(free, free)]))
        )
        fits.append(Fit(seen, rows, beta, prior, nu=STUDENT).maximise(steps=8))
    same, other = fits
    if other.evidence - same.evidence > _NATS * other.autocorrelation:
        places = np.full((len(touch.sockets), 3), np.nan)
        sensor = structure.sensor(
            restated(replace(belief, beta=other.beta), structure).beta
        )
        at_sockets = other.beta[point].reshape(-1, 3)
        places[own] = sensor.scale * at_sockets @ sensor.rotation.T + sensor.shift
        log = replace(log, x=_placed(log, touch, places))
    return replace(log, touch=None), [gone] * (len(log) < count)


def _placed(samples: Samples, touch: Touches, places: Array) -> Array:
    """Positions (n, 3): the place of each row's socket, or what a sensor measured."""
    return np.where(touch.number[:, None] >= 0, places[touch.number], samples.x)
