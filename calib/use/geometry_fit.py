"""Fitting the nominal chain to what a model learned.

A planar arm is a chain before a sensor that looks straight at its plane; the prior holds what that
cannot see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import PlanarArm, SpatialArm
from ..arm.rotations import similarity
from ..body.belief import Body, knows_orientation
from ..body.covariance import Z95, Factor
from ..body.fit import Fit
from ..body.frame_starts import frame_of_drawing
from ..body.parameters import Hyper, Indices, Prior
from ..body.rows import Rows
from ..body.settings import DRAWN_SHIFT_SD, FLAT_SD, PRIOR, PRIOR_SHARE, STUDENT
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..common.rows import finite_rows, rms_spread, row_lengths
from ..common.scale import METRES
from ..errors import CalibError, OptionError
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.nominal import (
    frame_moves,
    has_free_frame,
    is_simulated,
    nominal_arm,
    nominal_in_plane,
    visited_joints,
)
from .geometry import Geometry
from .settings import FITTING


class PlaneView(SpatialStructure):
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
        x, slope = super().linearise(q, beta, active)
        return x[:, :2], slope[:, :2]


@dataclass(frozen=True, eq=False)
class Points:
    """Positions of a tip at joint values, which a chain is fitted to."""

    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit]
    unit: str = "m"
    error: float = 0.0  # least sd of their mean along an axis [unit]

    @property
    def extent(self) -> float:
        """Root mean square distance from their middle [unit]."""
        return rms_spread(self.x)

    @classmethod
    def of(cls, model: Model) -> Points:
        """Return the rows that a model learned, or its answers where it was adapted or has none."""
        if model.rows is None or model.history:
            return cls._of_answers(model)
        every = -(-len(model.rows) // FITTING.rows)
        q = model.rows.q[::every]
        x = model.rows.x[::every]
        return cls(q, x, model.about.unit)

    @classmethod
    def _of_answers(cls, model: Model) -> Points:
        """A model's answers at visited nodes.

        Their error is that of the rows that the model learned: its bound of 95 % in a plane is 2.45
        sd along an axis, and answers of many nodes are no more certain than the rows behind them.
        """
        q = visited_joints(model, FITTING.nodes)
        x = model.forward(q)
        noise = float(np.nanmedian(model.bounds)) / 2.45
        independent = max(model.about.samples, 10)
        if model.body is None:
            independent = min(independent, FITTING.patches)
        error = noise * math.sqrt(len(q) / independent)
        answered = finite_rows(x)
        return cls(q[answered], x[answered], model.about.unit, error)


def fit_geometry(model: Model, *, geometry_is_drawn: bool = False) -> Geometry:
    """Fit the nominal chain to what was learned, where rows were, by Gauss-Newton.

    Unknown are the joints' offsets and places (of an arm in space six numbers for each joint
    origin), and with a free frame the sensor's place and, for pixels, its scale.  The
    prior settles what the data cannot distinguish, such as an offset and a turned link; the
    intervals hold that freedom.

    model : it must have a URDF
    geometry_is_drawn : whether the drawing's lengths and axes are true, so that only the joints'
        zeros are fitted, with the sensor's frame and the probe, as of a model that was trained so
    """
    geometry_is_drawn |= model.about.options.get("free") == "offsets"
    arm = nominal_arm(model)
    frame_is_free = has_free_frame(model)
    points = Points.of(model)
    metre = METRES.get(points.unit)
    if not frame_is_free and metre is None:
        raise OptionError(
            f"the model's positions are in {points.unit!r}, a URDF's are in m",
            hint="adapt it with a log in m (or `unit='mm'`)",
            parameter="unit",
            value=points.unit,
        )
    points = replace(points, x=_before_adaptations(model, points.x))
    if isinstance(arm, SpatialArm):
        return fit_in_space(
            arm, model, points, frame_is_free, geometry_is_drawn
        )
    if (
        frame_is_free
        and metre is not None
        and model.history
        and model.body is not None
    ):
        # the body and the adaptations determine the sensor's frame: fitted again, it would absorb
        # the change of the first joint that the adaptations found
        structure, beta = nominal_in_plane(model)
        x = _before_adaptations(model, structure.predict(points.q, beta))
        to_base = Alignment.between(arm.forward(points.q), x).inverse()
        x = to_base.apply(points.x)
        points = Points(points.q, x, error=points.error / metre)
        frame_is_free = False
    return fit_in_plane(arm, points, frame_is_free, geometry_is_drawn)


def seen_in_lengths(model: Model) -> Model:
    """Return a model as the first of its sensors that measures lengths sees the arm, if one does.

    A geometry is fitted to the rows of one sensor: pixels determine no lengths.
    """
    models = (model.by(name) for name in model.sensors)
    return next((seen for seen in models if seen.about.unit in METRES), model)


def body_with_zeros(model: Model) -> Body | None:
    """Return a model's body with the zeros and intervals that `calib urdf` and `export` write.

    A zero is one number: the body's own share of it, beside turned origins and gears that are the
    same to the rows, would be another.
    """
    about = model.about
    body = model.body
    if body is None or is_simulated(model) or not about.urdf:
        return body
    try:
        geometry = fit_geometry(seen_in_lengths(model))
    except CalibError:  # no geometry is fitted to pixels of a plane in space
        return body
    if not geometry.is_explained:  # as of a joint that counts the other way
        return body
    offsets = geometry.offsets()
    structure = body.structure
    beta = body.beta.copy()
    root = body.root.copy()
    units = about.units_of_joints
    for k, offset in enumerate(offsets.values()):
        index = structure.groups["offset"][k]
        if structure.labels[index].unit != units[k]:
            continue  # the direction of a planar arm's slide, which has no zero
        change = structure.senses[index] * offset.value
        beta[index] = structure.neutral()[index] + change
        for row in np.flatnonzero(body.active == index):
            root[row] *= offset.interval / (Z95 * np.linalg.norm(root[row]))
    return replace(body, beta=beta, root=root)


def _before_adaptations(model: Model, x: Array) -> Array:
    """Positions (n, m) in the sensor's frame as it was before adaptations found it moved."""
    for alignment in reversed(frame_moves(model)):
        x = alignment.inverse().apply(x)
    return x


def fit_in_space(
    arm: SpatialArm,
    model: Model,
    points: Points,
    frame_is_free: bool,
    geometry_is_drawn: bool,
) -> Geometry:
    """Fit an arm in space; the prior and the view are those of a model's body, if it has one."""
    structure, start, z = _spatial_readings(
        arm, model.body, points, frame_is_free
    )
    groups = structure.groups
    nominal = structure.neutral() if start is None else start
    simulated = is_simulated(model)
    parts: list[str] = []
    if not simulated:  # a simulation's point is the tip, in the base frame
        parts += structure.frame_groups
        if start is None:
            rows = Rows(points.q, z)
            nominal = frame_of_drawing(structure, rows)
        prior = structure.prior(parts)
        nominal = _maximum(structure, points, z, nominal, prior).beta
    parts.append("offset")
    if not geometry_is_drawn:
        parts.append("placement")
    fit = _maximum(structure, points, z, nominal, structure.prior(parts))
    metre = 1.0 if structure.camera else structure.metre
    covariance = _covariance(fit)
    last = groups["offset"][-1]
    untold = (
        np.sqrt(covariance[last, last]) >= PRIOR_SHARE * fit.scales["offset"]
    )
    if not simulated and arm.revolute[-1] and untold:
        # nothing distinguishes the last joint's offset from the probe's place
        covariance[last] = covariance[:, last] = 0.0
        covariance[last, last] = (np.pi / Z95) ** 2
    return Geometry(
        arm,
        structure,
        fit.beta,
        covariance,
        frame_is_free=frame_is_free,
        residual=_misfit(fit, fit.beta) / metre,
        nominal_residual=_misfit(fit, nominal) / metre,
        reach=_reach(z[:, structure.position]) / metre,
    )


def _spatial_readings(
    arm: SpatialArm, body: Body | None, points: Points, frame_is_free: bool
) -> tuple[SpatialStructure, Array | None, Array]:
    """Return the chain behind its sensor, parameters that are known, and readings (n, m)."""
    structure = None if body is None else body.structure
    if not isinstance(structure, SpatialStructure) or not structure.informed:
        view = "base"
        if frame_is_free:
            view = "rigid" if points.unit in METRES else "similarity"
        metre = METRES.get(points.unit, 1.0)
        structure = structure_of(
            arm, view, unit=points.unit, metre=metre, extent=points.extent
        )
        return structure, None, points.x
    assert body is not None  # noqa: S101 - it has the structure
    view = structure.view
    if not frame_is_free:
        view = "base"
    elif knows_orientation(body):
        view = "pose"
    elif view == "pose":
        view = "rigid"
    seen = structure.with_sensor(view=view)
    if view == "pose":
        # orientations determine turns of the tool and of the wrist that positions do not
        turns = seen.predict(points.q, body.beta)[:, points.x.shape[1] :]
        return seen, body.beta, np.hstack([points.x, turns])
    return seen, body.beta if structure.view == view else None, points.x


def fit_in_plane(
    arm: PlanarArm, points: Points, frame_is_free: bool, geometry_is_drawn: bool
) -> Geometry:
    """Fit a planar arm, whose sensor turns about the plane's normal alone.

    frame_is_free : whether the sensor's frame is fitted, and its scale if the unit is no length
    geometry_is_drawn : whether the drawing's lengths are true
    """
    in_space = structure_of(arm, unit=points.unit, extent=points.extent)
    structure = PlaneView(**vars(in_space))
    tips = arm.chain.poses(points.q)[0]
    start = _start_in_plane(arm, structure, tips, points, frame_is_free)
    prior = _prior_in_plane(structure, start, frame_is_free, geometry_is_drawn)
    fit = _maximum(structure, points, points.x, start, prior)
    nominal = fit.beta.copy()
    for group in ("offset", "placement", "tool"):
        nominal[structure.groups[group]] = 0.0
    metre = structure.sensor(fit.beta).scale
    return Geometry(
        arm,
        structure,
        fit.beta,
        _covariance(fit),
        frame_is_free=frame_is_free,
        residual=_misfit(fit, fit.beta) / metre,
        nominal_residual=_misfit(fit, nominal) / metre,
        reach=_reach(tips),
    )


def _start_in_plane(
    arm: PlanarArm,
    structure: PlaneView,
    tips: Array,
    points: Points,
    frame_is_free: bool,
) -> Array:
    """Parameters (d,) of the drawn arm before its sensor.

    tips : (n, 3) [m], where the drawn arm has the tip at the points' joint values
    """
    metre = METRES.get(points.unit)
    neutral = structure.neutral()
    if frame_is_free:
        # a sensor that sees the plane from behind is turned half round
        readings = np.column_stack([points.x, np.zeros(len(points.x))])
        sensor = similarity(tips, readings, scale=metre)
        return structure.with_sensor_at(neutral, *sensor)
    assert metre is not None  # noqa: S101 - `fit_geometry` refuses others
    turn = arm.plane.basis
    shift = -metre * turn @ arm.plane.origin
    return structure.with_sensor_at(neutral, turn, shift, metre)


def _prior_in_plane(
    structure: PlaneView,
    start: Array,
    frame_is_free: bool,
    geometry_is_drawn: bool,
) -> Prior:
    """The prior around the drawn arm (d,): offsets, then ends of links, then the sensor's frame."""
    groups = structure.groups
    sd = np.zeros(structure.size)
    sd[groups["offset"]] = np.where(
        structure.revolute, FITTING.offset, FITTING.along
    )
    hypers: tuple[Hyper, ...] = ()
    if not geometry_is_drawn:
        ends = np.vstack([structure.shifts[1:], groups["tool"]])
        sd[ends] = DRAWN_SHIFT_SD
        shape = np.ones(ends.size)
        hypers = (
            Hyper(
                "link", DRAWN_SHIFT_SD, PRIOR.wider, 0.0, ends.ravel(), shape
            ),
        )
    # the first joint's offset and a turn of the frame are one
    if frame_is_free:
        sd[groups["offset"][0]] = 0.0
        sd[groups["view.rotation"][2]] = FITTING.flat
        sd[groups["view.shift"][:2]] = FLAT_SD * structure.extent
        if structure.unit not in METRES:
            sd[groups["view.scale"]] = FITTING.flat
    return Prior(start, sd, hypers)


def _maximum(
    structure: SpatialStructure,
    points: Points,
    z: Array,
    start: Array,
    prior: Prior,
) -> Fit:
    """Return the fit of readings `z` (n, m) at its most probable parameters."""
    floor = np.maximum(FITTING.floor * structure.extents, points.error)
    fit = Fit(
        structure, [Rows(points.q, z, floor=floor)], start, prior, nu=STUDENT
    )
    return fit.maximise(steps=15, tolerance=1e-3)


def _covariance(fit: Fit) -> Array:
    """Covariance (d, d) of a fit's parameters a, with what no URDF can express.

    Gears, loads and curves c that it leaves out bend it.  Of the posterior C of both together its
    part of a, and how far a would move if c were fitted, too::

        C_aa + shift shift',    shift = C_ac X_c' W r

    As noise alone, waves of 1 mrad left 1 of 4 displacements within its interval.
    """
    structure = fit.structure
    measured = fit.readings[0]
    active = fit.active
    other_sd = structure.prior(("gain", "elastic", "curve")).sd
    other_sd[active] = 0.0
    others = np.flatnonzero(other_sd)
    a = slice(len(active))
    c = slice(len(active), None)
    root_weight = measured.root_weights().ravel()
    both = np.concatenate([active, others])
    _, slope = structure.linearise(measured.q, fit.beta, both)
    x = slope.reshape(len(root_weight), -1) * root_weight[:, None]
    pull = x[:, c].T @ (root_weight * measured.residual.ravel())
    precision = fit.information_share * (x.T @ x)
    precision[a, a] += fit.prior_precision
    precision[c, c] += np.diag(other_sd[others] ** -2.0)
    inverse = Factor(precision).inverse()
    shift = inverse[a, c] @ (fit.information_share * pull)
    covariance = np.zeros((structure.size, structure.size))
    covariance[np.ix_(active, active)] = inverse[a, a] + np.outer(shift, shift)
    return covariance


def _misfit(fit: Fit, beta: Array) -> float:
    """Root mean square distance that parameters leave unexplained [unit]."""
    positions = fit.structure.position
    return _rms(fit.readings[0].residual_at(beta)[:, positions])


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def _reach(x: Array) -> float:
    return float(row_lengths(x - x.mean(axis=0)).max())
