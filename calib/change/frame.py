"""The frame: an old belief brought into the frame of a new log.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..arm.rotations import logarithm, similarity
from ..body.belief import Body
from ..body.fit import Fit
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import SIMULATED_FLOOR, STUDENT
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import thinned
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .causes import FRAME, Cause, indices_of, is_sensors
from .settings import LEAST_OWN

_FAR = 0.05  # misfit, of the extents, from which another frame is looked for
# misfit by which a mirror, another sense or a locked joint must be better
_BETTER = 0.5
_SCALES = (0.5, 2.0)  # beyond these the positions are in another unit
_ROWS = 200
_LEAST = 1e-4  # noise that is always allowed, of the extents
_EXACT = 1e-6  # misfit, of the extents, that is none
# between the angles that are tried for a joint that is held [rad]
_LOCKED_STEP = 0.1


@dataclass(frozen=True)
class Reference:
    """The old belief, in the frame of a log."""

    # the old belief with the structure of the log: mirrored, or with a joint turned round
    body: Body
    beta: Array  # (d,), its parameters, the view's moved
    # a mirror, joints that turn the other way or no more, another unit: what is no matter of
    # degree; where there is one only hypotheses with a free frame make sense
    causes: tuple[Cause, ...] = ()
    # size of positions over what it was; 1 where they are in the old unit
    scale: float = 1.0
    # (g,), parameters of the view whose old posterior does not count any more
    forgotten: Indices = field(
        default_factory=lambda: np.zeros(0, dtype=np.intp)
    )

    @property
    def new(self) -> bool:
        """Whether the frame is one that no posterior tells of."""
        return bool(self.causes)

    @property
    def structure(self) -> Structure:
        """Structure of the log."""
        return self.body.structure

    @property
    def sizes(self) -> Array:
        """What residuals of each output are divided by, (m,) [unit]: the noise that is expected."""
        return np.maximum(
            self.body.noise, _LEAST * np.asarray(self.structure.extents)
        )

    @property
    def own_sd(self) -> Array:
        """Standard deviation (m,) [unit] of the residual that a log may have of its own."""
        return np.maximum(
            self.body.tau, LEAST_OWN * np.asarray(self.structure.extents)
        )


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    old = body.structure
    rows = thinned(len(q), _ROWS)
    q = q[rows]
    z = z[rows]
    places = slice(old.blocks[0])
    extent = float(old.extents[0])
    predicted = old.predict(q, body.beta)
    missed = np.linalg.norm((z - predicted)[:, places], axis=1)
    if float(np.median(missed)) < _FAR * extent:
        return Reference(body, body.beta)
    if is_camera(old.view):
        beta = _placed(old, q, z, [body.beta, _camera_anew(body, q, z)], FRAME)
        return Reference(body, beta, forgotten=indices_of(old, FRAME))
    fits = []
    for variant in _variants(body):
        p = variant.structure.predict(q, variant.beta)[:, places]
        fits += [
            _fit_of(variant, p, z[:, places], scaled, extent)
            for scaled in variant.scaled
        ]
    best = min(fits, key=lambda fit: fit.error)
    structure = best.variant.structure
    causes = list(best.variant.causes)
    factor = 1.0
    groups: tuple[str, ...] = FRAME
    if not _SCALES[0] < best.ratio < _SCALES[1]:  # in the log's own unit
        factor = best.ratio
        groups = (*FRAME, "view.scale")
        unit = "sensor" if unit == old.unit else unit
        centre = tuple(z.mean(axis=0).tolist())
        structure = _replaced(
            structure, extent=factor * old.extent, centre=centre, unit=unit
        )
    beta = _placed(
        structure, q, z, _starts(structure, best, factor, q, z), groups
    )
    turn = structure.groups["view.rotation"]
    if len(turn) == 1:  # the same angle, the short way round
        turns = (beta[turn] - best.variant.beta[turn]) / (2 * np.pi)
        beta[turn] -= 2 * np.pi * np.round(turns)
    if causes and causes[0].cause == "mirror":
        seen = structure.predict(q, beta)
        if Alignment.between(predicted, seen).swapped:
            words = "x and y of the log are exchanged, compared with the model"
            causes[0] = replace(causes[0], words=words)
    if factor != 1.0:
        words = f"the log's positions are {factor:.4g} times the model's{unit_hint(factor)}"
        causes.append(Cause("scale", "view.scale", words, factor, None, "1"))
    view = (
        [group for group in structure.groups if is_sensors(group)]
        if causes
        else FRAME
    )
    body = replace(
        body,
        structure=structure,
        noise=factor * body.noise,
        tau=factor * body.tau,
        residual=factor * body.residual,
    )
    return Reference(
        body, beta, tuple(causes), factor, indices_of(structure, view)
    )


def carried_offset(
    old: Body, new: Body, beta: Array, q: Array, offset: Array
) -> Array:
    """What maps add to a body, (n, m), after a change: as the joints that cause it move the tip."""
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))


def _camera_anew(body: Body, q: Array, z: Array) -> Array:
    """Parameters of a camera that stands anywhere, its lens and the arm as they were."""
    from ..body.starts import frame  # brings SciPy's linear algebra

    structure: Any = body.structure
    lens = tuple(body.beta[structure.groups["lens"]].tolist())
    known = structure.with_sensor(lens=lens, lens_sd=(0.0, 0.0, 0.0, 0.0))
    beta = body.beta.copy()
    free = indices_of(structure, FRAME)
    beta[free] = frame(known, q, z, body.beta)[free]
    return beta


@dataclass(frozen=True)
class _Variant:
    """What is no matter of degree: a mirror, joints that turn the other way, or no more."""

    structure: Structure
    beta: Array  # (d,)
    causes: tuple[Cause, ...] = ()  # one a freedom
    scaled: tuple[bool, ...] = (
        False,
        True,
    )  # whether the log may be in another unit


class _Fit(NamedTuple):
    """A variant after the best motion."""

    error: float
    variant: _Variant
    ratio: float  # of the sizes
    turn: Array


def _variants(body: Body) -> Iterator[_Variant]:
    """Other senses of the axes and of the joints."""
    structure = body.structure
    beta = body.beta
    plain = [_Variant(structure, beta)]
    mirror = getattr(structure, "mirror", None)
    if mirror is not None:
        words = "the log's positions are mirrored, compared with the model"
        cause = Cause("mirror", "view.mirror", words)
        plain.append(
            _Variant(_replaced(structure, mirror=-mirror), beta, (cause,))
        )
    yield from plain
    if not {"offset", "gain"} <= set(structure.groups):
        return
    signs = getattr(structure, "signs", ())
    for k in np.flatnonzero(structure.revolute).tolist():
        name = structure.joint_names[k]
        if signs:
            other = (*signs[:k], -signs[k], *signs[k + 1 :])
            turned = Cause(
                f"sign:{name}",
                "sign",
                f"{name} turns the other way than before",
            )
            for variant in plain:
                turned_round = _replaced(variant.structure, signs=other)
                yield _Variant(turned_round, beta, (*variant.causes, turned))
        words = f"{name} no longer moves the tip"
        lost = Cause(f"lost:{name}", "gain", words, 0.0, None, "1")
        for angle in np.arange(-np.pi, np.pi, _LOCKED_STEP) if k else ():
            stuck = beta.copy()
            stuck[structure.groups["gain"][k]] = 0.0
            stuck[structure.groups["offset"][k]] += angle
            yield _Variant(structure, stuck, (lost,), (False,))


def _replaced(structure: Structure, **change: Any) -> Structure:
    """The structure with other values of those fields that it has."""
    fields = vars(structure.viewpoint)
    sensor = {name: value for name, value in change.items() if name in fields}
    if sensor:
        structure = structure.with_sensor(**sensor)
    signs = change.get("signs")
    return structure if signs is None else structure.changed(signs=signs)


def _fit_of(
    variant: _Variant, p: Array, z: Array, scaled: bool, extent: float
) -> _Fit:
    """A variant's typical distance after the best motion.

    Rows that contradict most others are left out of a second fit.
    """
    sound = np.ones(len(p), dtype=bool)
    for _ in range(3):
        turn, _, ratio = similarity(p[sound], z[sound])
        size = ratio if scaled else 1.0
        away = (
            z
            - z[sound].mean(axis=0)
            - size * (p - p[sound].mean(axis=0)) @ turn.T
        )
        distance = np.linalg.norm(away, axis=1)
        sound = distance <= max(3.0 * float(np.median(distance)), 1e-12)
    # each further freedom must halve what is left; a scale near one is none
    freedom = len(variant.causes) + (
        scaled and not _SCALES[0] < ratio < _SCALES[1]
    )
    error = (
        max(float(np.median(distance)) / size, _EXACT * extent)
        / _BETTER**freedom
    )
    return _Fit(error, variant, ratio, turn)


def _starts(
    structure: Structure, fit: _Fit, factor: float, q: Array, z: Array
) -> list[Array]:
    """Parameters (d,) with the frame as it was, and turned as it fits best; both shifted."""
    about = structure.groups["view.rotation"]
    shift = structure.groups["view.shift"]
    starts = []
    for turn in (np.eye(len(fit.turn)), fit.turn):
        beta = fit.variant.beta.copy()
        beta[indices_of(structure, ("view.scale",))] += np.log(factor)
        step = np.zeros(structure.size)
        step[about] = (
            logarithm(turn)
            if len(about) > 1
            else np.arctan2(turn[1, 0], turn[0, 0])
        )
        beta = structure.retract(beta, step)
        residual = structure.residual(z, structure.predict(q, beta))
        beta[shift] += np.median(residual, axis=0)[: len(shift)]
        starts.append(beta)
    return starts


def _placed(
    structure: Structure,
    q: Array,
    z: Array,
    starts: list[Array],
    groups: tuple[str, ...],
) -> Array:
    """The frame alone fitted to the rows, from the best of some starts."""
    sd = np.zeros(structure.size)
    sd[indices_of(structure, groups)] = 1e3 * max(
        1.0, float(structure.extents[0])
    )
    found = []
    for start in starts:
        rows = [Rows(q, z, floor=SIMULATED_FLOOR * structure.extents)]
        fit = Fit(structure, rows, start, Prior(start, sd), nu=STUDENT)
        beta, cost, _ = fit.settle(30)
        found.append((cost, beta))
    return min(found, key=lambda each: each[0])[1]
