"""Correcting: joint values that bring the real arm to where the nominal one would be.

Use it on what a controller that trusts its URDF is about to command.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..common.rows import number_rows
from ..common.scale import TURN
from ..errors import OptionError, QueryError
from ..model.alignment import Alignment
from ..samples.joint_values import check_joint_values
from ..samples.log_ranges import wrap
from .geometry import Geometry, fit_geometry, frame_is_free, frames, is_simulated, nominal_arm
from .nominal import NominalArm, nominal_in_base, nominal_in_space, nominal_in_view
from .spatial_geometry import SpatialGeometry

if TYPE_CHECKING:
    from ..model.answers import Answer
    from ..model.model import Model

Array = NDArray[np.float64]

_USUAL = 3.0  # a correction this many times the 95 % quantile of the model's own is not trusted
_LEAST = 0.01  # [rad or m]; a limit below would refuse what is harmless
_NODES = 200
_TURNED = 1e-4  # a turn of the frame that is worth a word [rad]

FREE_FRAME = (
    "the sensor's frame is fitted to the log, so the first joint's offset is taken as zero; if "
    "the log is in the robot's root frame, give `view='base'`"
)

TURNED_FRAME = (
    "an adaptation found that the sensor's frame turned, which is not corrected; an offset of the "
    "first joint looks the same: if the sensor stayed, give `cause='joints'`"
)


POSITIONS = (
    "positions alone are corrected; the tool's orientation goes along as the joints move least"
)


@dataclass(frozen=True, eq=False)
class Corrected:
    """Corrected joint values, one row each.

    Attributes
    ----------
    q : (n, dof) array [rad or m]
        What to command; NaN where the real arm cannot get there.
    target : (n, 2) array [unit]
        Where the nominal arm would be, in the sensor's frame.
    distance : (n,) array [unit]
        From the target to where the corrected joints lead, by the learned map.
    expected_error : (n,) array [unit]
        95 % bound on the error of that map.
    reachable : (n,) bool array
        Whether the target was reached.
    change : (n, dof) array [rad or m]
        Corrected minus given; NaN where there is no answer.
    limit : (dof,) array [rad or m]
        Largest change of each joint that is trusted.
    exceeded : (n,) bool array
        Rows that change by more.
    notes : tuple of str
        What was assumed.
    single : bool
        Whether one vector was given rather than rows.
    """

    q: Array
    target: Array
    distance: Array
    expected_error: Array
    reachable: NDArray[np.bool_]
    change: Array
    limit: Array
    exceeded: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
    single: bool = False


def correct(
    model: Model,
    q: ArrayLike,
    *,
    limit: ArrayLike | None = None,
    view: str = "auto",
    cause: str = "sensor",
) -> Corrected:
    """Compensate for what the nominal kinematics do not know.

    A controller that trusts its URDF commands `q` to bring the tip to a place.  The real
    arm gets there with other joint values: those for which the learned map says that
    place, nearest to `q` and on the same turn.

    Parameters
    ----------
    model : Model
        Learned of or adapted to the real arm; it must have a URDF.
    q : (n, dof) or (dof,) array, or named columns [rad or m]
        Joint values that are right for the nominal arm.
    limit : float or (dof,) array, optional [rad or m]
        Largest change of a joint that is trusted; three times what this model usually
        corrects where not given, at least 0.01.  Rows beyond are marked in `exceeded`.
    view : {"auto", "base"}
        "base" says that the log was in the robot's root frame.
    cause : {"sensor", "joints"}
        A sensor that turned about the first joint and an offset of that joint look the same.
        "joints" says that the sensor stayed, so that the offset is compensated.

    Notes
    -----
    Places are compared in the sensor's frame.  That of a simulation is the root link's plane;
    where an adaptation found that it moved, the nominal place moves with it.  That of a log is
    fitted together with joint offsets and link placements, so that only what is the arm's own
    is compensated.
    """
    rows, single = number_rows(q, model.about.joint_names, "joint values")
    if not np.isfinite(rows).all():
        row = int(np.argmin(np.isfinite(rows).all(axis=1)))
        raise QueryError(f"joint values of row {row + 1} are not finite: {rows[row].tolist()}")
    about = model.about
    check_joint_values(
        rows, about.joint_names, about.lower, about.upper, about.revolute, error=QueryError
    )
    nominal = _nominal(model, view, cause)
    limits = (
        np.array(_usual(model, view, cause))
        if limit is None
        else _checked_limit(limit, rows.shape[1])
    )
    target, answer, found = _solved(model, nominal, rows)
    change = found - rows
    exceeded = answer.reachable & (np.abs(change) > limits).any(axis=1)
    notes = (FREE_FRAME,) if nominal.free else ()
    if len(model.axes) == 3:
        notes = (*notes, POSITIONS)
    if any(abs(frame.angle) > _TURNED for frame in frames(model, cause)):
        notes = (*notes, TURNED_FRAME)
    return Corrected(
        found,
        target,
        answer.distance,
        answer.expected_error,
        answer.reachable,
        change,
        limits,
        exceeded,
        notes,
        single,
    )


def correct_one(model: Model, q: ArrayLike) -> Array | None:
    """Corrected joints (dof,) for one command, as a controller asks; None where `correct` must.

    The answer is that of :func:`correct` with its own limit; NaN beyond it.
    """
    if model.single is None:
        return None
    nominal = _nominal(model, "auto", "sensor")
    if nominal.single is None:
        return None
    found = model.single.towards(q, nominal.single)
    if found is None:
        return None
    asked: list[float] = np.asarray(q, dtype=float).tolist()
    for new, old, limit in zip(found, asked, _usual(model), strict=True):
        if abs(new - old) > limit:
            return np.full(len(found), np.nan)
    return np.array(found)


_limits: WeakKeyDictionary[Model, dict[str, list[float]]] = WeakKeyDictionary()


def _usual(model: Model, view: str = "auto", cause: str = "sensor") -> list[float]:
    """`usual_limit` of a model, found once."""
    kept = _limits.setdefault(model, {})
    key = f"{view} {cause}"
    if key not in kept:
        kept[key] = usual_limit(model, view, cause).tolist()
    return kept[key]


def usual_limit(model: Model, view: str = "auto", cause: str = "sensor") -> Array:
    """Return the largest change of each joint that is trusted, (dof,) [rad or m].

    Three times the 95 % quantile of what correcting the motor map's own nodes changes; one
    limit for all joints that turn, another for those that slide.
    """
    nominal = _nominal(model, view, cause)
    nodes = np.flatnonzero(model.visited)
    if len(nodes) > _NODES:
        nodes = np.sort(np.random.default_rng(0).choice(nodes, _NODES, replace=False))
    q = np.clip(model.motor.weights[nodes], model.about.lower, model.about.upper)
    _, answer, found = _solved(model, nominal, q)
    change = np.abs(found - q)[answer.reachable]
    turns = np.array(model.about.revolute)
    limits = np.full(len(turns), _LEAST)
    for kind in (turns, ~turns):
        if kind.any() and len(change):
            usual = float(np.quantile(change[:, kind].max(axis=1), 0.95))
            limits[kind] = max(_LEAST, _USUAL * usual)
    return limits


@dataclass(frozen=True, eq=False)
class _Nominal:
    """The nominal arm and how its plane lies in the sensor's frame.

    Attributes
    ----------
    forward : callable
        Joint values (n, dof) to positions (n, m) of the nominal arm.
    frames : tuple of Alignment
        What moves these positions into the sensor's frame.
    free : bool
        Whether the sensor's frame was fitted.
    single : callable or None
        `forward` for one row in plain floats.
    """

    forward: Callable[[Array], Array]
    frames: tuple[Alignment, ...]
    free: bool
    single: Callable[[Sequence[float]], tuple[float, float]] | None = None

    def target(self, q: Array) -> Array:
        """Where the nominal arm would be, in the sensor's frame, (n, m)."""
        target = self.forward(q)
        for frame in self.frames:
            target = frame.apply(target)
        return target


_nominals: WeakKeyDictionary[Model, dict[str, _Nominal]] = WeakKeyDictionary()


def _nominal(model: Model, view: str, cause: str) -> _Nominal:
    """Return it, fitted once for a model: a controller corrects row by row."""
    kept = _nominals.setdefault(model, {})
    key = f"{view} {cause}"
    if key not in kept:
        kept[key] = _found(model, view, cause)
    return kept[key]


def _found(model: Model, view: str, cause: str) -> _Nominal:
    free = frame_is_free(model, view)
    planar = model.body is not None and isinstance(model.body.structure, PlanarStructure)
    if planar and free and cause == "sensor":
        # the body knows the sensor's frame, as it is after all adaptations
        return _of_body(model, nominal_in_view(model), (), free)
    if planar and not free:
        return _of_body(model, nominal_in_base(model), tuple(frames(model, cause)), free)
    moved = tuple(frames(model, cause))
    if len(model.axes) == 3:
        return _in_space(model, view, cause, free)
    geometry = fit_geometry(model, view=view, cause=cause) if free else None
    own = (geometry.frame,) if isinstance(geometry, Geometry) else ()
    return _Nominal(nominal_arm(model).forward, (*own, *moved), free)


def _in_space(model: Model, view: str, cause: str, free: bool) -> _Nominal:
    """The nominal arm of a model whose arm moves in space, with the sensed point at its tip."""
    body, moved = model.body, tuple(frames(model, cause))
    own = None if body is None else body.structure
    if is_simulated(model):
        return _Nominal(nominal_arm(model).forward, moved, free)
    if (
        body is not None
        and isinstance(own, SpatialStructure)
        and own.informed
        and (free or own.view == "base")
    ):
        structure, beta, moved = own, nominal_in_space(own, body.beta), ()
    else:
        geometry = fit_geometry(model, view=view, cause=cause)
        assert isinstance(geometry, SpatialGeometry)  # noqa: S101
        structure = geometry.structure
        beta = nominal_in_space(structure, geometry.beta)
    return _Nominal(lambda q: structure.predict(q, beta), moved, free)


def _of_body(model: Model, arm: NominalArm, moved: tuple[Alignment, ...], free: bool) -> _Nominal:
    assert model.body is not None  # noqa: S101
    single = arm.compiled(model.body) if not moved else None
    return _Nominal(arm.predict, moved, free, single)


def _solved(model: Model, nominal: _Nominal, q: Array) -> tuple[Array, Answer, Array]:
    """Return targets (n, 2), answers, and the joints (n, dof), on the turn that `q` is on."""
    about = model.about
    near = q.copy()
    for k, turns in enumerate(about.revolute):
        if turns:
            near[:, k] = wrap(q[:, k], float(about.lower[k]), float(about.upper[k]))
    target = nominal.target(near)
    answer = model.solve(target, np.clip(near, about.lower, about.upper))
    found = np.where(answer.reachable[:, None], answer.q, np.nan)
    turning = np.array(about.revolute)
    found[:, turning] += TURN * np.round((q - found)[:, turning] / TURN)
    return target, answer, found


def _checked_limit(limit: ArrayLike, dof: int) -> Array:
    limits = np.asarray(limit, dtype=float)
    if limits.shape not in ((), (dof,)) or not (limits > 0.0).all():
        raise OptionError(
            f"limit {limit!r}: expected a number above zero, or {dof} of them [rad or m]",
            parameter="limit",
            value=limit,
        )
    if math.isnan(float(limits.sum())):
        raise OptionError(f"limit {limit!r}: expected a number", parameter="limit", value=limit)
    return np.broadcast_to(limits, (dof,)).copy()
