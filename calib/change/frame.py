"""The frame: an old belief brought into the frame of a new log.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm.rotations import logarithm, similarity
from ..body.belief import Body
from ..body.parameters import Indices, Prior
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import thinned
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .causes import FRAME, Cause, indices_of, is_sensors
from .settings import LEAST_OWN


@dataclass(frozen=True)
class FrameSettings:
    """When a log is looked at in another frame."""

    # misfit, of the extents, from which another one is looked for
    far: float = 0.05
    # share of it that a mirror, another sense or another unit must leave at most
    better: float = 0.5
    # beyond these ratios of size positions are in another unit
    scales: tuple[float, float] = (0.5, 2.0)
    # that a frame is looked for with
    rows: int = 200
    # noise that is always allowed, of the extents
    least: float = 1e-4
    # misfit, of the extents, that is none
    exact: float = 1e-6
    # between the angles that are tried for a joint that is held [rad]
    angle: float = 0.1


PLACING = FrameSettings()


@dataclass(frozen=True)
class Reference:
    """The old belief, in the frame of a log."""

    # the old belief with the structure of the log: mirrored, or with a joint turned round
    body: Body
    beta: Array  # (d,), its parameters, the view's moved
    # a mirror, a joint that turns the other way, another unit: what is no matter of degree;
    # where there is one only hypotheses with a free frame make sense
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
        least = PLACING.least * np.asarray(self.structure.extents)
        return np.maximum(self.body.noise, least)

    @property
    def own_sd(self) -> Array:
        """Standard deviation (m,) [unit] of the residual that a log may have of its own."""
        least = LEAST_OWN * np.asarray(self.structure.extents)
        return np.maximum(self.body.tau, least)


@dataclass(frozen=True)
class _Sense:
    """A body with another sense of axes or joints, or a joint held, as it fits a log best."""

    structure: Structure
    beta: Array  # (d,)
    causes: tuple[Cause, ...] = ()  # one a freedom
    unit_is_open: bool = True  # whether positions may be in another unit
    misfit: float = np.inf
    turn: Array = field(default_factory=lambda: np.eye(2))
    ratio: float = 1.0  # of the sizes

    @property
    def rescaled(self) -> bool:
        """Whether positions are in another unit."""
        low, high = PLACING.scales
        return not low < self.ratio < high

    def fitted(self, p: Array, z: Array) -> _Sense:
        """Turn it from predictions (n, p) to positions; rows that contradict most are left out."""
        sound = np.ones(len(p), dtype=bool)
        for _ in range(3):
            turn, shift, ratio = similarity(p[sound], z[sound])
            if not self.unit_is_open:
                ratio = 1.0
                shift = (z[sound] - p[sound] @ turn.T).mean(axis=0)
            distance = np.linalg.norm(z - shift - ratio * p @ turn.T, axis=1)
            sound = distance <= max(3.0 * float(np.median(distance)), 1e-12)
        misfit = float(np.median(distance)) / ratio
        return replace(self, misfit=misfit, turn=turn, ratio=ratio)


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    old = body.structure
    rows = thinned(len(q), PLACING.rows)
    q = q[rows]
    z = z[rows]
    places = slice(old.blocks[0])
    extent = float(old.extents[0])
    predicted = old.predict(q, body.beta)
    missed = np.linalg.norm((z - predicted)[:, places], axis=1)
    if float(np.median(missed)) < PLACING.far * extent:
        return Reference(body, body.beta)
    if is_camera(old.view):
        beta = _placed(old, q, z, _camera_anew(body, q, z), FRAME)
        return Reference(body, beta, forgotten=indices_of(old, FRAME))
    fits = []
    for sense in (*_senses(old, body.beta), *_held(old, body.beta)):
        p = sense.structure.predict(q, sense.beta)
        fits.append(sense.fitted(p[:, places], z[:, places]))
    best = min(fits, key=lambda fit: _judged_misfit(fit, extent))
    structure = best.structure
    causes = list(best.causes)
    factor = 1.0
    groups: tuple[str, ...] = FRAME
    if best.rescaled:  # in the log's own unit
        factor = best.ratio
        groups = (*FRAME, "view.scale")
        structure = _with_fields(
            structure,
            extent=factor * old.extent,
            centre=tuple(z.mean(axis=0).tolist()),
            unit="sensor" if unit == old.unit else unit,
        )
        words = f"the log's positions are {factor:.4g} times the model's{unit_hint(factor)}"
        causes.append(Cause("scale", "view.scale", words, factor, None, "1"))
    start = _turned(structure, best, factor)
    shift = structure.groups["view.shift"]
    residual = structure.residual(z, structure.predict(q, start))
    start[shift] += np.median(residual, axis=0)[: len(shift)]
    beta = _placed(structure, q, z, start, groups)
    if causes and causes[0].cause == "mirror":
        seen = structure.predict(q, beta)
        if Alignment.between(predicted, seen).swapped:
            words = "x and y of the log are exchanged, compared with the model"
            causes[0] = replace(causes[0], words=words)
    view: tuple[str, ...] = FRAME
    if causes:
        view = tuple(filter(is_sensors, structure.groups))
    body = replace(
        body,
        structure=structure,
        noise=factor * body.noise,
        tau=factor * body.tau,
        residual=factor * body.residual,
    )
    forgotten = indices_of(structure, view)
    return Reference(body, beta, tuple(causes), factor, forgotten)


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


def _senses(structure: Structure, beta: Array) -> Iterator[_Sense]:
    """The axes as they are and mirrored, and each joint the other way, as far as that may be."""
    plain = [_Sense(structure, beta)]
    mirror = getattr(structure, "mirror", None)
    if mirror is not None:
        words = "the log's positions are mirrored, compared with the model"
        cause = Cause("mirror", "view.mirror", words)
        mirrored = _with_fields(structure, mirror=-mirror)
        plain.append(_Sense(mirrored, beta, (cause,)))
    yield from plain
    signs = getattr(structure, "signs", ())
    for k in np.flatnonzero(structure.revolute).tolist() if signs else ():
        name = structure.joint_names[k]
        words = f"{name} turns the other way than before"
        cause = Cause(f"sign:{name}", "sign", words)
        other = (*signs[:k], -signs[k], *signs[k + 1 :])
        for sense in plain:
            turned = sense.structure.changed(signs=other)
            yield _Sense(turned, beta, (*sense.causes, cause))


def _held(structure: Structure, beta: Array) -> Iterator[_Sense]:
    """Each joint but the first held, at angles around the turn."""
    for k in np.flatnonzero(structure.revolute).tolist():
        if k == 0 or "gain" not in structure.groups:
            continue
        words = f"{structure.joint_names[k]} no longer moves the tip"
        cause = f"lost:{structure.joint_names[k]}"
        for angle in np.arange(-np.pi, np.pi, PLACING.angle):
            stuck = beta.copy()
            stuck[structure.groups["gain"][k]] = 0.0
            stuck[structure.groups["offset"][k]] += angle
            lost = Cause(cause, "gain", words, 0.0, None, "1")
            yield _Sense(structure, stuck, (lost,), unit_is_open=False)


def _judged_misfit(sense: _Sense, extent: float) -> float:
    """A misfit beside those of others: each further freedom must halve what is left."""
    freedom = len(sense.causes) + int(sense.rescaled)
    misfit = max(sense.misfit, PLACING.exact * extent)
    return float(misfit / PLACING.better**freedom)


def _with_fields(structure: Structure, **change: Any) -> Structure:
    """The structure with other values of those fields that its sensor has."""
    fields = vars(structure.viewpoint)
    sensor = {name: value for name, value in change.items() if name in fields}
    return structure.with_sensor(**sensor)


def _turned(structure: Structure, sense: _Sense, factor: float) -> Array:
    """Parameters (d,) with the frame turned and scaled as it fits best."""
    about = structure.groups["view.rotation"]
    turn = sense.turn
    step = np.zeros(structure.size)
    step[indices_of(structure, ("view.scale",))] = np.log(factor)
    if len(about) > 1:
        step[about] = logarithm(turn)
    else:
        step[about] = np.arctan2(turn[1, 0], turn[0, 0])
    return structure.retract(sense.beta, step)


def _placed(
    structure: Structure,
    q: Array,
    z: Array,
    start: Array,
    groups: tuple[str, ...],
) -> Array:
    """The frame alone fitted to the rows, from a start (d,)."""
    from ..body.starts import Start

    sd = np.zeros(structure.size)
    anywhere = 1e3 * max(1.0, float(structure.extents[0]))
    sd[indices_of(structure, groups)] = anywhere
    return Start(structure, start).run(q, z, Prior(start, sd), 30).beta
