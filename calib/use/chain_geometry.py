"""The geometry of a chain that fits positions best: joint offsets, joint origins and the tip.

A planar arm is a chain before a sensor that looks straight at its plane and reports two of three
coordinates; the prior holds what that cannot see.  `calib urdf` writes what was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.arm import Arm, PlanarArm, SpatialArm
from ..arm.rotations import logarithm, similarity
from ..arm.urdf import parse_urdf
from ..body.belief import Body
from ..body.fit import Fit
from ..body.normal import Factor, with_prior
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import FREE, SHIFT, STUDENT, UNTOLD
from ..body.spatial import SpatialStructure, structure_of
from ..body.spatial_start import frame
from ..common.arrays import Array
from ..common.scale import METRES
from ..model.alignment import Alignment

_FLOOR = 1e-7  # of the extent: a residual below is rounding
_LEFT_OUT = ("gain", "elastic", "curve")  # what a body has and no URDF can say
_OFFSET = np.radians(10.0)  # prior sd of a planar arm's offset: servos are put on to that
_WIDER = (1.0, 5.0, 20.0)  # times the prior sd of its places, of which the evidence chooses
_EARNED = 5.0  # nats of evidence that a wider prior of its places has to gain


class InPlane(SpatialStructure):
    """A planar arm before a sensor that looks straight at its plane: two of three coordinates."""

    outputs, blocks, camera = 2, (2,), False

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, 2) at joint values (n, dof)."""
        return super().predict(q, beta)[:, :2]

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Outputs (n, 2) and their derivative (n, 2, k) by the parameters `active`."""
        seen, slope = super().linearise(q, beta, active)
        return seen[:, :2], slope[:, :2]


@dataclass(frozen=True, eq=False)
class Geometry:
    """A fitted geometry of an arm; intervals are half widths of 95 %."""

    arm: Arm  # the nominal arm
    structure: SpatialStructure  # its chain and view
    # (d,), parameters and their posterior standard deviations, 0 where nothing was fitted
    beta: Array
    sd: Array
    # whether the sensor's frame was fitted; the first joint's offset and place are nominal then, by
    # convention
    free: bool
    # whether the tip's fitted place belongs to the arm; else it is the sensor's: a probe, a tag
    move_tip: bool
    # [m; px], root mean square distance that this geometry, and the nominal one, do not explain,
    # each with the sensor and the tip where they fit best
    residual: float
    before: float
    reach: float  # [m; px], furthest distance of the tip from the middle of its positions

    @property
    def unit(self) -> str:
        """Unit of `residual`, `before` and `reach`."""
        return self.structure.unit if self.structure.camera else "m"

    @cached_property
    def places(self) -> tuple[str, ...]:
        """Joints whose origins are fitted, mimic joints included, as the URDF names them."""
        path = parse_urdf(self.arm.urdf).path(self.arm.tip)
        return tuple(j.name for j in path if j.movable and j.name not in self.arm.locked)

    def moved(self, joint: str) -> tuple[Array, Array, float]:
        """How far a joint's origin is from where the URDF has it, with all joints at zero.

        As a shift (3,) [m] and a rotation vector (3,) [rad] in the root link's axes, and what the
        joint's own motion is [rad or m]: its offset. Zeros of a joint that is not fitted.
        """
        if joint not in self.places:
            return np.zeros(3), np.zeros(3), 0.0
        k, structure = self.places.index(joint), self.structure
        value = structure.chain.coupling[k] @ self.beta[structure.groups["offset"]]
        return self.beta[structure.shifts[k]], self.beta[structure.turns[k]], float(value)

    def tip(self) -> tuple[Array, Array]:
        """What is written of the tip: a shift (3,) [m] in the root's axes, a turn in its own."""
        groups, written = self.structure.groups, float(self.move_tip)
        shift = self.structure.chain.rotation @ self.beta[groups["tool"]]
        return written * shift, written * self.beta[groups["tool.rotation"]]

    @property
    def ends(self) -> tuple[Array, Array]:
        """Displacements of a planar arm's joints and tip (dof + 1, 2) [m], and intervals."""
        assert isinstance(self.arm, PlanarArm)  # noqa: S101
        axes = np.stack([self.arm.plane.x, self.arm.plane.y])
        index = np.vstack([self.structure.shifts, self.structure.groups["tool"]])
        turned = np.stack([axes] * self.arm.dof + [axes @ self.arm.chain.rotation])
        moved = np.einsum("kij,kj->ki", turned, self.beta[index])
        return moved, 1.96 * np.sqrt(np.einsum("kij,kj->ki", turned**2, self.sd[index] ** 2))

    @property
    def frame(self) -> Alignment | None:
        """From a planar arm's coordinates in its plane to what the model answers in."""
        if not isinstance(self.arm, PlanarArm):
            return None
        sensor, plane = self.structure.sensor(self.beta), self.arm.plane
        turned = sensor.scale * sensor.rotation
        matrix = turned @ np.stack([plane.x, plane.y], axis=1)
        return Alignment(matrix[:2], (turned @ plane.origin + sensor.shift)[:2])

    def to_json(self) -> dict[str, Any]:
        """Plain data; intervals are half widths of 95 %."""
        told: dict[str, Any] = {"offsets": self.offsets()}
        groups, structure = self.structure.groups, self.structure
        if (seen := self.frame) is not None:
            base, *ends = map(_with_interval, *self.ends)
            told["moved"] = dict(zip(self.arm.joint_names, ends, strict=True))
            told["base"] = base
            told["frame"] = {"matrix": seen.matrix.tolist(), "shift": seen.shift.tolist()}
        else:
            places = zip(self.places, structure.shifts, structure.turns, strict=True)
            told["places"] = {
                n: {"shift": self._told(s), "turn": self._told(t)} for n, s, t in places
            }
            shift, turn = self._told(groups["tool"]), self._told(groups["tool.rotation"])
            told["tip"] = {"shift": shift, "turn": turn, "written": self.move_tip}
        sizes = {name: getattr(self, name) for name in ("residual", "before", "reach")}
        return {**told, "frame_fitted": self.free, **sizes}

    def offsets(self) -> dict[str, Any]:
        """Where the nominal arm stands when joints read zero [rad or m], with intervals."""
        joints = zip(self.arm.joint_names, self.structure.groups["offset"], strict=True)
        return {name: self._told(k) for name, k in joints}

    def _told(self, index: Any) -> dict[str, Any]:
        return _with_interval(self.beta[index], 1.96 * self.sd[index])


def _with_interval(value: Array, half: Array) -> dict[str, Any]:
    return {"value": value.tolist(), "interval": half.tolist()}


def fit_in_space(
    arm: SpatialArm,
    body: Body | None,
    q: Array,
    x: Array,
    *,
    unit: str,
    free: bool,
    probe: bool,
    move_base: bool,
    move_tip: bool,
) -> Geometry:
    """Fit offsets, joint origins and the tip to positions `x` (n, m) at joints `q` (n, dof).

    With `probe` the sensed point may be anywhere on the last link; else it is the tip, as in a
    simulation, and moves only with `move_tip`.  The prior is that of a body: joint origins to 1 mm
    and 0.1 deg, or as many times that as the evidence takes. What the rows do not tell apart is
    within the intervals.
    """
    own = body.structure if body is not None else None
    known = None  # the body's own parameters, where they are of this structure
    if body is not None and isinstance(own, SpatialStructure) and own.informed:
        view = "rigid" if free and own.view == "pose" else own.view if free else "base"
        structure = replace(own, view=view)
        known = body.beta if own.view == view else None
    else:
        view = "base" if not free else "rigid" if unit in METRES else "similarity"
        structure = structure_of(
            arm, view, unit=unit, metre=METRES.get(unit, 1.0), extent=_rms(x - x.mean(axis=0))
        )
    groups, free_groups = structure.groups, structure.frame_groups
    tool, first = groups["tool"], np.concatenate([structure.shifts[0], structure.turns[0]])
    start = structure.neutral() if known is None else known
    if known is None and probe:
        start = frame(structure, q, x)
    prior = _held(structure.prior(free_groups), first[:0] if probe else tool)
    nominal = _fitted(structure, q, x, start, prior).beta if len(prior.active) else start
    prior = structure.prior((*free_groups, "placement", "offset"))
    if not probe:  # a simulation's point is the tip, as sure as any other place
        prior.sd[tool] = SHIFT
    still = [*(() if probe or move_tip else tool), *(() if move_base else first)]
    fit = _fitted(structure, q, x, nominal, _held(prior, np.array(still, dtype=np.intp)))
    reach, metre = _reach(x), 1.0 if structure.camera else structure.metre
    found = _geometry(arm, fit, nominal, free, move_tip, reach / metre, metre)
    last = groups["offset"][-1]
    if probe and arm.revolute[-1] and found.sd[last] >= UNTOLD * fit.scales["offset"]:
        found.sd[last] = np.pi / 1.96  # nothing tells it apart from the probe's place
    return found


def fit_in_plane(
    arm: PlanarArm,
    q: Array,
    x: Array,
    unit: str,
    *,
    free: bool,
    move_base: bool = False,
    error: float = 0.0,
) -> Geometry:
    """Fit offsets, places and, with a `free` frame, the sensor's place to positions `x` (n, 2).

    `error` [unit] is the least noise along an axis that positions are credited with: an adapted
    model answers without noise, yet with the error of its rows.
    """
    structure = structure_of(arm, unit=unit, extent=_rms(x - x.mean(axis=0)), kind=InPlane)
    groups, beta, scaled = structure.groups, structure.neutral(), free and unit != "m"
    points, seen = arm.chain.positions(q), np.c_[x, np.zeros(len(x))]
    turn, shift, scale = arm.plane.basis, -arm.plane.basis @ arm.plane.origin, 1.0
    if free:  # before a sensor that sees the plane from behind it is turned half round
        turn, shift, scale = similarity(points, seen)
        if not scaled:
            shift, scale = seen.mean(axis=0) - turn @ points.mean(axis=0), 1.0
    beta[groups["view.rotation"]] = logarithm(turn)
    beta[groups["view.shift"]], beta[groups["view.scale"]] = shift, np.log(scale)
    priors = [_planar_prior(structure, arm, beta, w, free, scaled, move_base) for w in _WIDER]
    fits = [_fitted(structure, q, x, beta, prior, error) for prior in priors]
    best = max(fits, key=lambda fit: fit.evidence - _EARNED * fits.index(fit))
    nominal = best.beta.copy()
    for group in ("offset", "placement", "tool"):
        nominal[groups[group]] = 0.0
    unit_size = structure.sensor(best.beta).scale
    return _geometry(arm, best, nominal, free, True, _reach(points), unit_size)


def _planar_prior(
    structure: SpatialStructure,
    arm: PlanarArm,
    start: Array,
    wider: float,
    free: bool,
    scaled: bool,
    move_base: bool,
) -> Prior:
    """What may move, from a start on; the sensor turns about the plane's normal alone.

    Across a link its far end keeps the narrow width: there a displacement is the same as a turn,
    which an offset should carry.
    """
    groups, shifts, chain = structure.groups, structure.shifts, structure.chain
    ends, sd = np.vstack([shifts[1:], groups["tool"]]), np.zeros(structure.size)
    sd[groups["offset"]] = np.where(structure.revolute, _OFFSET, SHIFT * wider)
    sd[ends] = SHIFT * wider
    if free:  # the first joint's offset and a turn of the frame are one
        sd[groups["offset"][0]] = 0.0
        sd[groups["view.rotation"][2]] = 100.0
        sd[groups["view.shift"][:2]] = FREE * structure.extent
    if scaled:
        sd[groups["view.scale"]] = 100.0
    if move_base:
        sd[shifts[0]] = FREE * chain.reach
    active = np.flatnonzero(sd)
    precision = np.diag(sd[active] ** -2)
    links = np.diff(np.vstack([chain.points, chain.tip]), axis=0)
    for k, (end, turns) in enumerate(zip(ends, structure.revolute, strict=True)):
        across = np.cross(arm.plane.normal, links[k])
        length = float(np.linalg.norm(across))
        if turns and length > SHIFT:
            across = (across if k + 1 < arm.dof else across @ chain.rotation) / length
            own = np.ix_(*[np.searchsorted(active, end)] * 2)
            precision[own] += (1 - wider**-2) / SHIFT**2 * np.outer(across, across)
    return Prior(start, sd, known=precision)


def _held(prior: Prior, still: Sequence[int] | Indices) -> Prior:
    sd, hypers = prior.sd.copy(), []
    sd[still] = 0.0
    for hyper in prior.hypers:
        kept = ~np.isin(hyper.indices, still)
        if kept.any():
            hypers.append(hyper._replace(indices=hyper.indices[kept], shape=hyper.shape[kept]))
    return Prior(prior.mean, sd, tuple(hypers))


def _fitted(
    structure: SpatialStructure, q: Array, x: Array, beta: Array, prior: Prior, error: float = 0.0
) -> Fit:
    """The most probable parameters from `beta` on; `error` is the least noise [unit]."""
    floor = np.maximum(_FLOOR * structure.extents, error)
    fit = Fit(structure, [Rows(q, x, floor=floor)], beta, prior, nu=STUDENT)
    return fit.maximise(steps=15, tolerance=1e-3)


def _geometry(
    arm: Arm, fit: Fit, nominal: Array, free: bool, move_tip: bool, reach: float, metre: float
) -> Geometry:
    """What a fit found, beside the nominal arm's parameters; `metre` are units of a metre."""
    misfit = fit.parts[0].residual_at(nominal)
    sizes = (_rms(fit.residual) / metre, _rms(misfit) / metre, reach)
    structure: Any = fit.structure
    return Geometry(arm, structure, fit.beta, _deviations(fit), free, move_tip, *sizes)


def _deviations(fit: Fit) -> Array:
    """Standard deviations (d,) of a fitted geometry.

    Gains, elasticity and joint curves that it leaves out bend it by ``P X' W Xc c`` (Schmidt's
    "consider" covariance), with c as the rows and the priors of an arm leave them.  As noise alone,
    waves of 1 mrad left 1 of 4 displacements within its interval.
    """
    structure, active = fit.structure, fit.active
    usual = structure.prior(_LEFT_OUT).sd
    usual[active] = 0.0
    both = np.union1d(active, np.flatnonzero(usual))
    own = np.isin(both, active)
    root = (np.sqrt(fit.weight) / fit.noise).ravel()
    x = (
        structure.linearise(fit.parts[0].q, fit.beta, both)[1].reshape(len(root), -1)
        * root[:, None]
    )
    gram = x.T @ x
    free = fit.told * gram
    free[np.ix_(own, own)] = with_prior(free[np.ix_(own, own)], fit.sd, fit.known)
    free[~own, ~own] += usual[both[~own]] ** -2.0
    spread = Factor(free).inverse()[np.ix_(~own, ~own)]
    mean = spread @ (fit.told * (x.T @ (root * fit.residual.ravel()))[~own])
    bent = Factor(fit.precision).solve(gram[np.ix_(own, ~own)])
    total = fit.covariance + bent @ (spread + np.outer(mean, mean)) @ bent.T
    sd = np.zeros(structure.size)
    sd[active] = np.sqrt(np.diag(total))
    return sd


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def _reach(x: Array) -> float:
    return float(np.linalg.norm(x - x.mean(axis=0), axis=1).max())
