"""The frame: an old belief brought into the frame of a new log.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..arm.rotations import similarity
from ..body.belief import Body
from ..body.parameters import Indices, Prior
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import median_length, row_lengths, spread_rows
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .causes import (
    ANYWHERE,
    AS_SIMULATED,
    FRAME,
    GROUPS,
    WAVE_SIZES,
    Cause,
    indices_of,
    is_sensors,
    sd_if_changed,
)

# Least residual of one log, of the extents; 1e-4 hid a sensor that was moved by .1 mm
LEAST_RESIDUAL = 1e-7


@dataclass(frozen=True)
class FrameSettings:
    """When a log is looked at in another frame."""

    # misfit, of the extents, from which another one is looked for
    far: float = 0.05
    # largest share of it that a mirror, another sense or another unit may leave
    better: float = 0.5
    # ratios of size beyond which positions are in another unit
    scales: tuple[float, float] = (0.5, 2.0)
    # most rows that a frame is looked for with
    rows: int = 200
    # noise that is always allowed, of the extents
    least: float = 1e-4
    # misfit, of the extents, that is none
    exact: float = 1e-6
    # step from angle to angle that is tried for a joint that is stuck [rad]
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
    void: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    # (w,), parameters of joints' waves that the log shows
    waves: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    # the old belief without the tolerances of an arm's making, where it was only simulated
    simulated: Body | None = None

    @property
    def wave_sizes(self) -> tuple[float, ...]:
        """Sizes of the joints' waves that are compared."""
        if self.simulated is None:
            return WAVE_SIZES
        return (AS_SIMULATED, *WAVE_SIZES)

    @property
    def has_discrete_cause(self) -> bool:
        """Whether something changed that is no matter of degree: the frame has no posterior."""
        return bool(self.causes)

    @property
    def is_fitted(self) -> bool:
        """Whether the frame was fitted to the log."""
        return len(self.void) > 0

    @property
    def is_doubtful(self) -> bool:
        """Whether the old frame may explain the log as well as the one that was fitted."""
        return self.is_fitted and not self.has_discrete_cause

    def sd_if_changed(self) -> Array:
        """Standard deviation (d,) by which parameters and waves may have changed.

        Of a frame that was fitted to the log a narrow prior would count rows twice.
        """
        sd = sd_if_changed(self.body)
        frame = indices_of(self.structure, FRAME)
        sd[np.intersect1d(frame, self.void)] *= ANYWHERE
        sd[self.waves] = GROUPS["curve"].freed
        return sd

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
    def residual_sd(self) -> Array:
        """Standard deviation (m,) [unit] of a log's own residual."""
        least = LEAST_RESIDUAL * np.asarray(self.structure.extents)
        return np.maximum(self.body.tau, least)


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    structure = body.structure
    rows = spread_rows(len(q), PLACING.rows)
    q = q[rows]
    z = z[rows]
    if _is_near(structure, body.beta, q, z):
        return Reference(body, body.beta)
    if isinstance(structure, SpatialStructure) and is_camera(structure.view):
        start = _camera_anew(structure, body.beta, q, z)
        beta = _frame_fit(structure, q, z, start, FRAME)
        return Reference(body, beta, void=indices_of(structure, FRAME))
    return _by_best_sense(body, q, z, unit)


def _is_near(structure: Structure, beta: Array, q: Array, z: Array) -> bool:
    """Whether a log needs no other frame than that of the parameters (d,)."""
    residual = z - structure.predict(q, beta)
    positions = residual[:, : structure.blocks[0]]
    far = PLACING.far * float(structure.extents[0])
    return median_length(positions) < far


def _by_best_sense(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """The belief with the axes, the joints and the unit that come nearest to a log."""
    # which axes, joints and unit come nearest?
    placement = _best_placement(body, q, z)
    sense = placement.sense
    scale = 1.0
    fitted: tuple[str, ...] = FRAME
    if placement.in_other_unit:
        scale = placement.ratio
        sense = _in_other_unit(sense, scale, z, unit)
        fitted = (*FRAME, "view.scale")

    # where is their frame?
    structure = sense.structure
    turn = structure.turn_parameters(placement.turn)
    rotation = structure.groups["view.rotation"]
    # its shift is linear, and fitted
    start = structure.after_step(sense.beta, rotation, turn)
    beta = _frame_fit(structure, q, z, start, fitted)

    # what of the old belief holds on?
    void: tuple[str, ...] = FRAME
    if sense.causes:
        void = tuple(filter(is_sensors, structure.groups))
    causes = list(sense.causes)
    if causes and causes[0].cause == "mirror":
        before = body.predict(q)
        after = structure.predict(q, beta)
        if Alignment.between(before, after).is_swapped:
            words = "x and y of the log are exchanged, compared with the model"
            causes[0] = replace(causes[0], words=words)
    return Reference(
        body=_scaled(body, structure, scale),
        beta=beta,
        causes=tuple(causes),
        scale=scale,
        void=indices_of(structure, void),
    )


def _best_placement(body: Body, q: Array, z: Array) -> _Placement:
    """The sense of axes and joints that comes nearest to a log, and how it is placed."""
    structure = body.structure
    extent = float(structure.extents[0])
    positions = z[:, : structure.blocks[0]]
    predicted = structure.predict(q, body.beta)[:, : structure.blocks[0]]
    moved = median_length(predicted - np.median(predicted, axis=0))
    if moved < PLACING.far * extent:
        # rows of one place come as near in any sense and unit
        plain = _Sense(structure, body.beta, unit_is_open=False)
        return _Placement.of(plain, q, positions)
    senses = [
        *_senses(structure, body.beta),
        *_stuck(structure, body.beta),
    ]
    placements = [_Placement.of(sense, q, positions) for sense in senses]
    return min(placements, key=lambda placement: placement.cost(extent))


def _in_other_unit(sense: _Sense, factor: float, z: Array, unit: str) -> _Sense:
    """A sense in the unit of positions (n, m), which are `factor` times the model's."""
    structure = sense.structure
    hint = unit_hint(factor, structure.unit)
    words = f"the log's positions are {factor:.4g} times the model's{hint}"
    cause = Cause("scale", "view.scale", words, factor, unit="1")
    extent = factor * float(structure.extent)
    name = "sensor" if unit == structure.unit else unit
    if isinstance(structure, PlanarStructure):
        middle = z.mean(axis=0)
        structure = structure.with_sensor(centre=tuple(middle.tolist()))
    structure = structure.with_sensor(extent=extent, unit=name)
    beta = sense.beta.copy()
    beta[indices_of(structure, ("view.scale",))] += np.log(factor)
    return _Sense(structure, beta, (*sense.causes, cause))


def _scaled(body: Body, structure: Structure, factor: float) -> Body:
    """The belief with the structure of a log, and its noises in the unit of that."""
    return replace(
        body,
        structure=structure,
        noise=factor * body.noise,
        tau=factor * body.tau,
        residual=factor * body.residual,
    )


def offset_after(
    old: Body, new: Body, beta: Array, q: Array, offset: Array
) -> Array:
    """What maps add to a body, (n, .., m), after a change of the body.

    The maps' offset is turned into joint errors by the old Jacobian, and back into positions by
    the new one: J_new pinv(J_old) offset.
    """
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    inverse = np.linalg.pinv(before, rcond=1e-3)
    joints = np.einsum("ndm,n...m->n...d", inverse, offset)
    moves: Array = np.einsum("nmd,n...d->n...m", after, joints)
    return moves


class _Sense(NamedTuple):
    """A structure with another sense of axes or joints, or with a joint that is stuck."""

    structure: Structure
    beta: Array  # (d,)
    causes: tuple[Cause, ...] = ()  # one a freedom
    unit_is_open: bool = True  # whether positions may be in another unit


class _Placement(NamedTuple):
    """The turn and the ratio of sizes by which a sense comes nearest to a log."""

    sense: _Sense
    misfit: float
    turn: Array
    ratio: float

    @staticmethod
    def of(sense: _Sense, q: Array, z: Array) -> _Placement:
        """Turn predictions to positions (n, m); rows that contradict most are left out."""
        predicted = sense.structure.predict(q, sense.beta)
        p = predicted[:, : z.shape[1]]
        sound = np.ones(len(p), dtype=bool)
        scale = None if sense.unit_is_open else 1.0
        for _ in range(3):
            turn, shift, ratio = similarity(p[sound], z[sound], scale=scale)
            residual = z - (shift + ratio * p @ turn.T)
            distance = row_lengths(residual)
            typical = float(np.median(distance))
            sound = distance <= max(3.0 * typical, 1e-12)
        return _Placement(sense, typical / ratio, turn, ratio)

    @property
    def in_other_unit(self) -> bool:
        """Whether positions are in another unit."""
        low, high = PLACING.scales
        return not low < self.ratio < high

    def cost(self, extent: float) -> float:
        """The misfit for a comparison: each further freedom must halve what is left."""
        freedom = len(self.sense.causes) + int(self.in_other_unit)
        misfit = max(self.misfit, PLACING.exact * extent)
        return float(misfit / PLACING.better**freedom)


def _senses(structure: Structure, beta: Array) -> list[_Sense]:
    """The axes as they are, and in the plane mirrored, and each joint the other way."""
    plain = [_Sense(structure, beta)]
    if not isinstance(structure, PlanarStructure):
        return plain
    words = "the log's positions are mirrored, compared with the model"
    cause = Cause("mirror", "view.mirror", words)
    mirrored = structure.with_sensor(mirror=-structure.mirror)
    plain.append(_Sense(mirrored, beta, (cause,)))
    senses = list(plain)
    for k in np.flatnonzero(structure.revolute).tolist():
        name = structure.joint_names[k]
        words = f"{name} turns the other way than before"
        cause = Cause(f"sign:{name}", "sign", words)
        signs = list(structure.signs)
        signs[k] = -signs[k]
        for sense in plain:
            other = sense.structure.with_fields(signs=tuple(signs))
            causes = (*sense.causes, cause)
            senses.append(_Sense(other, beta, causes))
    return senses


def _stuck(structure: Structure, beta: Array) -> Iterator[_Sense]:
    """Each joint but the first stuck, at angles around the turn."""
    gains = structure.groups.get("gain", np.zeros(0, np.intp))
    for k in range(1, len(gains)):
        if not structure.revolute[k]:
            continue
        name = structure.joint_names[k]
        words = f"{name} no longer moves the tip"
        lost = Cause(f"lost:{name}", "gain", words, 0.0, unit="1")
        for angle in np.arange(-np.pi, np.pi, PLACING.angle):
            stuck = beta.copy()
            stuck[gains[k]] = 0.0
            stuck[structure.groups["offset"][k]] += angle
            yield _Sense(structure, stuck, (lost,), unit_is_open=False)


def _camera_anew(
    structure: SpatialStructure, old: Array, q: Array, z: Array
) -> Array:
    """Parameters (d,) with a camera that may be anywhere, its lens and the arm unchanged."""
    # brings SciPy's linear algebra
    from ..body.frame_starts import best_frame
    from ..body.rows import Rows

    lens = old[structure.groups["lens"]]
    fixed = structure.with_sensor(
        lens=tuple(lens.tolist()),
        lens_sd=(0.0, 0.0, 0.0, 0.0),
    )
    free = indices_of(structure, FRAME)
    beta = old.copy()
    beta[free] = best_frame(fixed, Rows(q, z), old).beta[free]
    return beta


def _frame_fit(
    structure: Structure,
    q: Array,
    z: Array,
    start: Array,
    groups: tuple[str, ...],
) -> Array:
    """Parameters (d,) with some groups fitted to the rows, from a start (d,)."""
    from ..body.fit import Start
    from ..body.rows import Rows

    free = indices_of(structure, groups)
    extent = float(structure.extents[0])
    sd = np.zeros(structure.size)
    sd[free] = 1e3 * max(1.0, extent)
    prior = Prior(start, sd)
    fit = Start(structure, start).run(Rows(q, z), prior, 30)
    return fit.beta
