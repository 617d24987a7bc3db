"""The geometry of a chain that fits a model best: offsets, joint origins, the tip, the sensor.

A planar arm is a chain before a sensor that looks straight at its plane; the prior holds what that
cannot see.  `calib urdf` writes what was found, `calib correct` takes the sensor's frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.arm import Arm, PlanarArm, SpatialArm
from ..arm.description import parse_robot
from ..arm.rotations import logarithm, similarity
from ..body.belief import Body, knows_orientation
from ..body.fit import Fit
from ..body.normal import Factor, with_prior
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import FREE, SHIFT, STUDENT, UNTOLD
from ..body.spatial import SpatialStructure, structure_of
from ..body.starts import frame
from ..common.arrays import Array
from ..common.scale import METRES
from ..errors import OptionError
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.nominal import nominal_arm, nominal_in_plane, visited_joints
from .frames import frame_is_free, frames, is_simulated

_POINTS = 500
_ROWS = 2_000
_FLOOR = 1e-7  # of the extent: a residual below is rounding
_LEFT_OUT = ("gain", "elastic", "curve")  # what a body has and no URDF can say
_OFFSET = np.radians(
    10.0
)  # prior sd of a planar arm's offset: servos are put on to that
_ALONG = 5.0 * SHIFT  # [m], prior sd of a planar arm's places, but for turns of a link


class InPlane(SpatialStructure):
    """A planar arm before a sensor that looks straight at its plane: two of three coordinates."""

    outputs = 2
    blocks = (2,)
    camera = False

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
    beta: Array  # (d,)
    sd: Array  # (d,), of the posterior, 0 where nothing was fitted
    free: bool  # whether the sensor's frame was fitted; the first joint is nominal then
    move_tip: (
        bool  # whether the tip's fitted place is the arm's; else a probe's or a tag's
    )
    # [m; px], root mean square distance that this geometry, and the nominal one, do not explain,
    # each with the sensor and the tip where they fit best
    residual: float
    before: float
    reach: (
        float  # [m; px], furthest distance of the tip from the middle of its positions
    )

    @property
    def unit(self) -> str:
        """Unit of `residual`, `before` and `reach`."""
        return self.structure.unit if self.structure.camera else "m"

    @property
    def places(self) -> tuple[str, ...]:
        """Joints whose origins are fitted, mimic joints included, as the URDF names them."""
        path = parse_robot(self.arm.urdf).path(self.arm.tip)
        return tuple(
            j.name for j in path if j.movable and j.name not in self.arm.locked
        )

    @property
    def ends(self) -> tuple[Array, Array]:
        """Displacements of a planar arm's joints and tip (dof + 1, 2) [m], and intervals."""
        assert isinstance(self.arm, PlanarArm)  # noqa: S101
        axes = self.arm.plane.basis[:2]
        index = np.vstack([self.structure.shifts, self.structure.groups["tool"]])
        turned = np.stack([axes] * self.arm.dof + [axes @ self.arm.chain.rotation])
        moved = np.einsum("kij,kj->ki", turned, self.beta[index])
        return moved, 1.96 * np.sqrt(
            np.einsum("kij,kj->ki", turned**2, self.sd[index] ** 2)
        )

    @property
    def frame(self) -> Alignment | None:
        """From a planar arm's coordinates in its plane to what the model answers in."""
        if not isinstance(self.arm, PlanarArm):
            return None
        sensor = self.structure.sensor(self.beta)
        plane = self.arm.plane
        turned = sensor.scale * sensor.rotation
        matrix = turned @ plane.basis[:2].T
        return Alignment(matrix[:2], (turned @ plane.origin + sensor.shift)[:2])

    def to_json(self) -> dict[str, Any]:
        """Plain data; intervals are half widths of 95 %."""
        told: dict[str, Any] = {"offsets": self.offsets()}
        groups = self.structure.groups
        structure = self.structure
        if (seen := self.frame) is not None:
            told["base"], *ends = map(_with_interval, *self.ends)
            told["moved"] = dict(zip(self.arm.joint_names, ends, strict=True))
            told["frame"] = {
                "matrix": seen.matrix.tolist(),
                "shift": seen.shift.tolist(),
            }
        else:
            parts = (
                [structure.shifts, groups["tool"]],
                [structure.turns, groups["tool.rotation"]],
            )
            shifts, turns = (map(self._told, np.vstack(part)) for part in parts)
            *places, tip = (
                {"shift": a, "turn": b} for a, b in zip(shifts, turns, strict=True)
            )
            told["places"] = dict(zip(self.places, places, strict=True))
            told["tip"] = {**tip, "written": self.move_tip}
        sizes = {name: getattr(self, name) for name in ("residual", "before", "reach")}
        return {**told, "frame_fitted": self.free, **sizes}

    def offsets(self) -> dict[str, Any]:
        """Where the nominal arm stands when joints read zero [rad or m], with intervals."""
        told = map(self._told, self.structure.groups["offset"])
        return dict(zip(self.arm.joint_names, told, strict=True))

    def _told(self, index: Any) -> dict[str, Any]:
        return _with_interval(self.beta[index], 1.96 * self.sd[index])


def _with_interval(value: Array, half: Array) -> dict[str, Any]:
    return {"value": value.tolist(), "interval": half.tolist()}


def fit_geometry(
    model: Model,
    *,
    view: str = "auto",
    cause: str = "sensor",
    move_base: bool = False,
    move_tip: bool = False,
    drawn: bool = False,
) -> Geometry:
    """Fit the nominal chain to what was learned, where rows were, by Gauss-Newton.

    Unknown are the joints' offsets and places and the tip's (of an arm in space six numbers for
    each joint origin), and with a free frame the sensor's place and, for other units than m, its
    scale.  The prior settles what the data cannot tell apart, such as an offset and a turned link;
    the intervals hold that freedom.

    model : it must have a URDF
    view : {"auto", "base"}, "base" says that a log's positions are in the root link's frame
    cause : {"sensor", "joints"}, what an adaptation found that turns the sensor's frame and the
        first joint alike; with "joints" the frame is taken to have stayed
    move_base : whether the first joint's place is fitted too; only in a known frame
    move_tip : whether the sensed point of a spatial arm is the tip itself and belongs to the
        geometry; else it is a probe or tag that was put on, and the tip stays where the URDF has it
    drawn : whether the drawing's lengths and axes are true, so that joints' zeros alone are fitted,
        beside the sensor's frame and the probe
    """
    arm = nominal_arm(model)
    free = frame_is_free(model, view)
    unit = model.about.unit
    if move_base and free:
        raise OptionError(
            "the base cannot be told from the sensor's frame",
            hint="say that the log is in the robot's root frame with `view='base'`",
            parameter="view",
        )
    if not free and unit != "m":
        raise OptionError(
            f"the model's positions are in {unit!r}, a URDF's are in m",
            hint="adapt it with a log in m (or `unit='mm'`)",
            parameter="unit",
            value=unit,
        )
    q, x, error = _points(model)
    for moved in reversed(
        frames(model, cause)
    ):  # what adaptations found to be the sensor's
        x = moved.inverse().apply(x)
    if isinstance(arm, SpatialArm):
        probe = not is_simulated(model)
        return fit_in_space(
            arm,
            model.body,
            q,
            x,
            unit=unit,
            free=free,
            probe=probe,
            move_base=move_base,
            move_tip=move_tip,
            drawn=drawn,
        )
    if free and cause == "joints" and model.history and model.body is not None:
        # the sensor stayed where it was before the adaptations; fitted again, its frame would
        # take what they found of the first joint
        structure, beta = nominal_in_plane(model)
        seen = structure.predict(q, beta)
        for moved in reversed(frames(model)):
            seen = moved.inverse().apply(seen)
        x = Alignment.between(arm.forward(q), seen).inverse().apply(x)
        free = False
    return fit_in_plane(
        arm, q, x, unit, free=free, move_base=move_base, drawn=drawn, error=error
    )


def _points(model: Model) -> tuple[Array, Array, float]:
    """Joint values, positions [unit] and the least error of their mean: rows, or visited nodes.

    The model's error at nodes is that of its own rows, and larger than the residual.
    """
    if model.rows is not None and not model.history:
        some = slice(None, None, -(-len(model.rows) // _ROWS))
        return model.rows.q[some], model.rows.x[some], 0.0
    q = visited_joints(model, _POINTS)
    x = model.forward(q)
    known = np.isfinite(x).all(axis=1)
    noise = float(np.nanmedian(model.bounds)) / 2.45  # standard deviation along an axis
    error = noise * math.sqrt(len(q) / max(model.about.samples, 10))
    return q[known], x[known], error


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
    drawn: bool = False,
) -> Geometry:
    """Fit offsets, joint origins and the tip to positions `x` (n, m) at joints `q` (n, dof).

    With `probe` the sensed point may be anywhere on the last link; else it is the tip, as in a
    simulation, and moves only with `move_tip`.  The prior is that of a body.
    """
    own: Any = None if body is None else body.structure
    known = None  # the body's own parameters, where they are of this structure
    posed = free and knows_orientation(body)
    if body is not None and posed and own.informed:
        # orientations tell turns of the tool and of the wrist that positions leave open
        structure = own.with_view("pose")
        known = body.beta
        x = np.hstack([x, structure.predict(q, body.beta)[:, x.shape[1] :]])
    elif body is not None and isinstance(own, SpatialStructure) and own.informed:
        view = "rigid" if free and own.view == "pose" else own.view if free else "base"
        structure = own.with_view(view)
        known = body.beta if own.view == view else None
    else:
        view = "base" if not free else "rigid" if unit in METRES else "similarity"
        structure = structure_of(
            arm,
            view,
            unit=unit,
            metre=METRES.get(unit, 1.0),
            extent=_rms(x - x.mean(axis=0)),
        )
    groups = structure.groups
    free_groups = structure.frame_groups
    tool = groups["tool"]
    first = np.concatenate([structure.shifts[0], structure.turns[0]])
    start = structure.neutral() if known is None else known
    if known is None and probe:
        start = frame(structure, q, x)
    prior = _held(structure.prior(free_groups), first[:0] if probe else tool)
    nominal = (
        _fitted(structure, q, x, start, prior).beta if len(prior.active) else start
    )
    placement = () if drawn else ("placement",)
    prior = structure.prior((*free_groups, *placement, "offset"))
    if not probe:  # a simulation's point is the tip, as sure as any other place
        prior.sd[tool] = SHIFT
    still = [*(() if probe or move_tip else tool), *(() if move_base else first)]
    fit = _fitted(
        structure, q, x, nominal, _held(prior, np.array(still, dtype=np.intp))
    )
    reach = _reach(x[:, : structure.blocks[0]])
    metre = 1.0 if structure.camera else structure.metre
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
    drawn: bool = False,
    error: float = 0.0,
) -> Geometry:
    """Fit offsets, places and, with a `free` frame, the sensor's place to positions `x` (n, 2).

    `error` [unit] is the least noise along an axis: a model's answers have that of its rows.
    """
    structure = structure_of(
        arm, unit=unit, extent=_rms(x - x.mean(axis=0)), kind=InPlane
    )
    groups = structure.groups
    start = structure.neutral()
    scaled = free and unit != "m"
    points = arm.chain.poses(q)[0]
    seen = np.c_[x, np.zeros(len(x))]
    turn = arm.plane.basis
    shift = -arm.plane.basis @ arm.plane.origin
    scale = 1.0
    if free:  # before a sensor that sees the plane from behind it is turned half round
        turn, shift, scale = similarity(points, seen)
        if not scaled:
            shift = seen.mean(axis=0) - turn @ points.mean(axis=0)
            scale = 1.0
    start[groups["view.rotation"]] = logarithm(turn)
    start[groups["view.shift"]], start[groups["view.scale"]] = shift, np.log(scale)
    # the sensor turns about the plane's normal alone
    ends = np.vstack([structure.shifts[1:], groups["tool"]])
    sd = np.zeros(structure.size)
    sd[groups["offset"]] = np.where(structure.revolute, _OFFSET, _ALONG)
    if not drawn:
        sd[ends] = _ALONG
    if free:  # the first joint's offset and a turn of the frame are one
        sd[groups["offset"][0]] = 0.0
        sd[groups["view.rotation"][2]] = 100.0
        sd[groups["view.shift"][:2]] = FREE * structure.extent
        sd[groups["view.scale"]] = 100.0 * scaled
    if move_base:
        sd[structure.shifts[0]] = FREE * structure.chain.reach
    prior = (
        Prior(start, sd) if drawn else Prior(start, sd, known=_precision(arm, ends, sd))
    )
    fit = _fitted(structure, q, x, start, prior, error)
    nominal = fit.beta.copy()
    for group in ("offset", "placement", "tool"):
        nominal[groups[group]] = 0.0
    unit_size = structure.sensor(fit.beta).scale
    return _geometry(arm, fit, nominal, free, True, _reach(points), unit_size)


def _precision(arm: PlanarArm, ends: Indices, sd: Array) -> Array:
    """Prior precision (k, k); links' `ends` (dof, 3) are narrow across, where an offset turns."""
    active = np.flatnonzero(sd)
    chain = arm.chain
    precision = np.diag(sd[active] ** -2)
    links = np.diff(np.vstack([chain.points, chain.tip]), axis=0)
    for k, (end, turns) in enumerate(zip(ends, arm.revolute, strict=True)):
        across = np.cross(arm.plane.normal, links[k])
        length = float(np.linalg.norm(across))
        if turns and length > SHIFT:
            across = (across if k + 1 < arm.dof else across @ chain.rotation) / length
            own = np.ix_(*[np.searchsorted(active, end)] * 2)
            precision[own] += (SHIFT**-2 - _ALONG**-2) * np.outer(across, across)
    return precision


def _held(prior: Prior, still: Indices) -> Prior:
    sd = prior.sd.copy()
    sd[still] = 0.0
    kept = [(hyper, ~np.isin(hyper.indices, still)) for hyper in prior.hypers]
    hypers = (
        h._replace(indices=h.indices[k], shape=h.shape[k]) for h, k in kept if k.any()
    )
    return Prior(prior.mean, sd, tuple(hypers))


def _fitted(
    structure: SpatialStructure,
    q: Array,
    x: Array,
    beta: Array,
    prior: Prior,
    error: float = 0.0,
) -> Fit:
    """The most probable parameters from `beta` on; `error` is the least noise [unit]."""
    floor = np.maximum(_FLOOR * structure.extents, error)
    fit = Fit(structure, [Rows(q, x, floor=floor)], beta, prior, nu=STUDENT)
    return fit.maximise(steps=15, tolerance=1e-3)


def _geometry(
    arm: Arm,
    fit: Fit,
    nominal: Array,
    free: bool,
    move_tip: bool,
    reach: float,
    metre: float,
) -> Geometry:
    """What a fit found, beside the nominal arm's parameters; `metre` are units of a metre.

    Parameters c that it leaves out bend it by ``P X' W Xc c`` (Schmidt's "consider" covariance):
    as noise alone, waves of 1 mrad left 1 of 4 displacements within its interval.
    """
    structure: Any = fit.structure
    active = fit.active
    sd = np.zeros(structure.size)
    usual = structure.prior(_LEFT_OUT).sd
    usual[active] = 0.0
    both = np.union1d(active, np.flatnonzero(usual))
    own = np.isin(both, active)
    root = (np.sqrt(fit.weight) / fit.noise).ravel()
    x = structure.linearise(fit.parts[0].q, fit.beta, both)[1].reshape(len(root), -1)
    x = x * root[:, None]
    gram = x.T @ x
    precision = fit.information_share * gram
    precision[np.ix_(own, own)] = with_prior(
        precision[np.ix_(own, own)], fit.sd, fit.known
    )
    precision[~own, ~own] += usual[both[~own]] ** -2.0
    spread = Factor(precision).inverse()[np.ix_(~own, ~own)]
    mean = spread @ (
        fit.information_share * (x.T @ (root * fit.residual.ravel()))[~own]
    )
    bent = Factor(fit.precision).solve(gram[np.ix_(own, ~own)])
    sd[active] = np.sqrt(
        np.diag(fit.covariance + bent @ (spread + np.outer(mean, mean)) @ bent.T)
    )
    positions = slice(structure.blocks[0])
    residual = fit.residual[:, positions]
    nominal_residual = fit.parts[0].residual_at(nominal)[:, positions]
    rms = _rms(residual) / metre
    before = _rms(nominal_residual) / metre
    return Geometry(arm, structure, fit.beta, sd, free, move_tip, rms, before, reach)


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def _reach(x: Array) -> float:
    return float(np.linalg.norm(x - x.mean(axis=0), axis=1).max())
