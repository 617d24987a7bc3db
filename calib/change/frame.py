"""The frame: an old belief brought into the frame of a new log.

A camera that hangs elsewhere, is mirrored or has another unit moves every position far more than
any other change does; so the frame comes first, and small changes after it.
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

# Least sd of a log's own smooth residual [extents]; 1e-4 hid a sensor that was moved by .1 mm
LEAST_RESIDUAL = 1e-7


@dataclass(frozen=True)
class FrameSearchSettings:
    """When and how another frame of the sensor is searched."""

    # misfit from which another frame is searched [extents]
    far: float = 0.05
    # largest share of the misfit that a mirror, a reversed joint or another unit may leave
    better: float = 0.5
    # ratios of size beyond which positions are in another unit
    scales: tuple[float, float] = (0.5, 2.0)
    # most rows of the search
    rows: int = 200
    # least expected noise [extents]
    least: float = 1e-4
    # misfit that counts as zero [extents]
    exact: float = 1e-6
    # step between the angles at which a joint may be stuck [rad]
    angle: float = 0.1


FRAME_SEARCH = FrameSearchSettings()


@dataclass(frozen=True)
class Reference:
    """The old belief, in the frame of a log."""

    # the old belief with the structure of the log: mirrored, or with a joint reversed
    body: Body
    beta: Array  # (d,), the old parameters with the view's refitted
    # discrete changes: a mirror, a reversed joint, another unit; where there is one, the frame is
    # free in every hypothesis
    causes: tuple[Cause, ...] = ()
    # new over old unit of the positions
    scale: float = 1.0
    # (g,), view parameters that were refitted to the log: their old posterior is dropped
    refitted: Indices = field(
        default_factory=lambda: np.zeros(0, dtype=np.intp)
    )
    # (w,), parameters of joints' waves that the log shows
    waves: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    # the old belief of a simulated arm, without the tolerances of making an arm
    simulated: Body | None = None

    @property
    def wave_sizes(self) -> tuple[float, ...]:
        """Sizes of the joints' waves that are compared, over the prior of their curves."""
        if self.simulated is None:
            return WAVE_SIZES
        return (AS_SIMULATED, *WAVE_SIZES)

    @property
    def has_discrete_cause(self) -> bool:
        """Whether there is a discrete change, after which the frame has no posterior."""
        return bool(self.causes)

    @property
    def is_fitted(self) -> bool:
        """Whether the frame was fitted to the log."""
        return len(self.refitted) > 0

    @property
    def is_doubtful(self) -> bool:
        """Whether the old frame may explain the log as well as the fitted one."""
        return self.is_fitted and not self.has_discrete_cause

    def sd_if_changed(self) -> Array:
        """Standard deviation (d,) by which parameters and waves may have changed.

        A frame that was fitted to the log gets a wide one: a narrow prior would count rows twice.
        """
        sd = sd_if_changed(self.body)
        frame = indices_of(self.structure, FRAME)
        sd[np.intersect1d(frame, self.refitted)] *= ANYWHERE
        sd[self.waves] = GROUPS["curve"].change_sd
        return sd

    @property
    def structure(self) -> Structure:
        """Structure of the log."""
        return self.body.structure

    @property
    def expected_noise(self) -> Array:
        """Expected noise (m,) of each output [unit], which residuals are divided by."""
        least = FRAME_SEARCH.least * np.asarray(self.structure.extents)
        return np.maximum(self.body.noise, least)

    @property
    def residual_sd(self) -> Array:
        """Standard deviation (m,) [unit] of a log's own residual."""
        least = LEAST_RESIDUAL * np.asarray(self.structure.extents)
        return np.maximum(self.body.tau, least)


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    structure = body.structure
    rows = spread_rows(len(q), FRAME_SEARCH.rows)
    q = q[rows]
    z = z[rows]
    residual = z - structure.predict(q, body.beta)
    far = FRAME_SEARCH.far * float(structure.extents[0])
    if median_length(residual[:, structure.position]) < far:
        return Reference(body, body.beta)
    if isinstance(structure, SpatialStructure) and is_camera(structure.view):
        start = _camera_anew(structure, body.beta, q, z)
        beta = _frame_fit(structure, q, z, start, FRAME)
        return Reference(body, beta, refitted=indices_of(structure, FRAME))
    return _by_best_variant(body, q, z, unit)


def _by_best_variant(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """The belief in the variant of axes, joints and unit that comes nearest to a log."""
    placement = _best_placement(body, q, z)
    variant = placement.variant
    scale = 1.0
    fitted: tuple[str, ...] = FRAME
    if placement.in_other_unit:
        scale = placement.ratio
        variant = _in_other_unit(variant, scale, z, unit)
        fitted = (*FRAME, "view.scale")

    # the frame: its rotation is that of the placement, its shift is linear and fitted
    structure = variant.structure
    turn = structure.turn_parameters(placement.turn)
    rotation = structure.groups["view.rotation"]
    start = structure.after_step(variant.beta, rotation, turn)
    beta = _frame_fit(structure, q, z, start, fitted)

    # which groups lose their old posterior?
    refitted: tuple[str, ...] = FRAME
    if variant.causes:
        refitted = tuple(filter(is_sensors, structure.groups))
    causes = list(variant.causes)
    if causes and causes[0].cause == "mirror":
        before = body.predict(q)
        after = structure.predict(q, beta)
        if Alignment.between(before, after).is_swapped:
            words = "x and y of the log are exchanged, compared with the model"
            causes[0] = replace(causes[0], words=words)
    scaled = replace(
        body,
        structure=structure,
        noise=scale * body.noise,
        tau=scale * body.tau,
        residual=scale * body.residual,
    )
    return Reference(
        body=scaled,
        beta=beta,
        causes=tuple(causes),
        scale=scale,
        refitted=indices_of(structure, refitted),
    )


def _best_placement(body: Body, q: Array, z: Array) -> _Placement:
    """The variant of axes and joints that comes nearest to a log, with its placement."""
    structure = body.structure
    extent = float(structure.extents[0])
    positions = z[:, structure.position]
    predicted = structure.predict(q, body.beta)[:, structure.position]
    spread = median_length(predicted - np.median(predicted, axis=0))
    if spread < FRAME_SEARCH.far * extent:
        # rows of one place are as near in every variant and unit
        plain = _Variant(structure, body.beta, unit_is_open=False)
        return _Placement.of(plain, q, positions)
    variants = [
        *_variants(structure, body.beta),
        *_stuck_variants(structure, body.beta),
    ]
    placements = [_Placement.of(variant, q, positions) for variant in variants]
    return min(placements, key=lambda placement: placement.cost(extent))


def _in_other_unit(
    variant: _Variant, factor: float, z: Array, unit: str
) -> _Variant:
    """The variant in the unit of positions (n, m), which are `factor` times the model's."""
    structure = variant.structure
    hint = unit_hint(factor, structure.unit)
    words = f"the log's positions are {factor:.4g} times the model's{hint}"
    cause = Cause("scale", "view.scale", words, factor, unit="1")
    extent = factor * float(structure.extent)
    name = "sensor" if unit == structure.unit else unit
    if isinstance(structure, PlanarStructure):
        middle = z.mean(axis=0)
        structure = structure.with_sensor(centre=tuple(middle.tolist()))
    structure = structure.with_sensor(extent=extent, unit=name)
    beta = variant.beta.copy()
    beta[indices_of(structure, ("view.scale",))] += np.log(factor)
    return _Variant(structure, beta, (*variant.causes, cause))


def offset_after(
    old: Body, new: Body, beta: Array, q: Array, offset: Array
) -> Array:
    """The offset (n, .., m) that maps add to a body, carried over to the changed body.

    The old Jacobian turns it into joint errors, the new one turns these into positions:
    J_new pinv(J_old) offset.
    """
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    inverse = np.linalg.pinv(before, rcond=1e-3)
    joints = np.einsum("ndm,n...m->n...d", inverse, offset)
    moves: Array = np.einsum("nmd,n...d->n...m", after, joints)
    return moves


class _Variant(NamedTuple):
    """A structure with mirrored axes, reversed joints, or a joint that is stuck."""

    structure: Structure
    beta: Array  # (d,)
    causes: tuple[
        Cause, ...
    ] = ()  # one for each difference from the old structure
    unit_is_open: bool = True  # whether positions may be in another unit


class _Placement(NamedTuple):
    """The turn and the ratio of sizes that bring a variant nearest to a log."""

    variant: _Variant
    misfit: float  # median distance from the log, in the model's unit
    turn: Array  # (p, p)
    ratio: float  # size of the log's positions over the model's

    @staticmethod
    def of(variant: _Variant, q: Array, z: Array) -> _Placement:
        """Place predictions at positions (n, m), without the rows that are far off."""
        predicted = variant.structure.predict(q, variant.beta)
        p = predicted[:, : z.shape[1]]
        sound = np.ones(len(p), dtype=bool)
        scale = None if variant.unit_is_open else 1.0
        for _ in range(3):
            turn, shift, ratio = similarity(p[sound], z[sound], scale=scale)
            residual = z - (shift + ratio * p @ turn.T)
            distance = row_lengths(residual)
            typical = float(np.median(distance))
            sound = distance <= max(3.0 * typical, 1e-12)
        return _Placement(variant, typical / ratio, turn, ratio)

    @property
    def in_other_unit(self) -> bool:
        """Whether positions are in another unit."""
        low, high = FRAME_SEARCH.scales
        return not low < self.ratio < high

    def cost(self, extent: float) -> float:
        """The misfit for a comparison: each discrete change must halve it to be worthwhile."""
        changes = len(self.variant.causes) + int(self.in_other_unit)
        misfit = max(self.misfit, FRAME_SEARCH.exact * extent)
        return float(misfit / FRAME_SEARCH.better**changes)


def _variants(structure: Structure, beta: Array) -> list[_Variant]:
    """The axes as they are and, in the plane, mirrored, each with every joint reversed in turn."""
    plain = [_Variant(structure, beta)]
    if not isinstance(structure, PlanarStructure):
        return plain
    words = "the log's positions are mirrored, compared with the model"
    cause = Cause("mirror", "view.mirror", words)
    mirrored = structure.with_sensor(mirror=-structure.mirror)
    plain.append(_Variant(mirrored, beta, (cause,)))
    variants = list(plain)
    for k in np.flatnonzero(structure.revolute).tolist():
        name = structure.joint_names[k]
        words = f"{name} turns the other way than before"
        cause = Cause(f"sign:{name}", "sign", words)
        signs = list(structure.signs)
        signs[k] = -signs[k]
        for variant in plain:
            other = variant.structure.with_fields(signs=tuple(signs))
            causes = (*variant.causes, cause)
            variants.append(_Variant(other, beta, causes))
    return variants


def _stuck_variants(structure: Structure, beta: Array) -> Iterator[_Variant]:
    """Each turning joint but the first stuck, at angles all around the turn."""
    gains = structure.groups.get("gain", np.zeros(0, np.intp))
    for k in range(1, len(gains)):
        if not structure.revolute[k]:
            continue
        name = structure.joint_names[k]
        words = f"{name} no longer moves the tip"
        stuck_cause = Cause(f"lost:{name}", "gain", words, 0.0, unit="1")
        for angle in np.arange(-np.pi, np.pi, FRAME_SEARCH.angle):
            stuck = beta.copy()
            stuck[gains[k]] = 0.0
            stuck[structure.groups["offset"][k]] += angle
            yield _Variant(structure, stuck, (stuck_cause,), unit_is_open=False)


def _camera_anew(
    structure: SpatialStructure, old: Array, q: Array, z: Array
) -> Array:
    """Parameters (d,) with the camera placed anew, its lens and the arm unchanged."""
    # imports SciPy's linear algebra
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
