"""Correcting: joint values that bring the real arm to where the nominal one would be.

Use it on what a controller that trusts its URDF is about to command.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..body.covariance import radius_95, spread_of
from ..body.settings import SHARED
from ..common.arrays import Array
from ..common.rows import checked_rows, each_joint
from ..common.scale import TURN
from ..errors import QueryError
from ..model.answers import Answer
from ..model.model import Model
from ..model.nominal import moves_in_space, visited_joints
from ..model.space import REACHED
from ..model.trust import ROUNDED
from ..samples.joint_values import check_joint_values
from ..samples.log_ranges import wrap
from .geometry import frames
from .wanted import Wanted, wanted

_USUAL = 3.0  # a correction this many times the 95 % quantile of the model's own is not trusted
_LEAST = 0.01  # [rad or m]; a limit below would refuse what is harmless
_NODES = 200
_TRIED, _SAME = 5, 1e-6  # rows by which the compiled kernel is compared, and how close [rad or m]
_FITTED = ("view.", "tool", "lens")  # parameters of the sensor and of what is put on the tip
_YES = np.ones(1, dtype=bool)
_TURNED = 1e-4  # a turn of the frame that is worth a word [rad]

_FREE_FRAME = (
    "the sensor's frame is fitted to the log, so the first joint's offset is taken as zero; if "
    "the log is in the robot's root frame, give `view='base'`"
)

_CAUSE_OF_NOTHING = (
    "`cause='joints'` applies to what an adaptation found; this frame was fitted to the model's "
    "own log, so the first joint's offset stays zero"
)

_FRAME_BEFORE = (
    "the sensor's frame is taken as it was before the adaptation, where the first joint's offset "
    "was taken as zero"
)

_FRAME_IN_SPACE = (
    "of an arm in space `cause='joints'` is said to the adaptation itself: adapt with it, then the "
    "first joint's offset is corrected without it"
)

_TURNED_FRAME = (
    "an adaptation found that the sensor's frame turned, which is not corrected; an offset of the "
    "first joint looks the same: if the sensor stayed, give `cause='joints'`"
)


_POSITIONS = (
    "positions alone are corrected; the tool's orientation follows from the smallest change of "
    "the joints"
)


@dataclass(frozen=True, eq=False)
class Corrected:
    """Corrected joint values, one row each.

    Attributes
    ----------
    q : (n, dof) array [rad or m]
        What to command; NaN where the real arm cannot get there.
    nearest : (n, dof) array [rad or m]
        The same, and where the real arm cannot get there the joints that come nearest.
    target : (n, 2) array [unit]
        Where the nominal arm would be, in the sensor's frame.
    distance : (n,) array [unit]
        From the target to where the corrected joints lead, by the learned map.
    expected_error : (n,) array [unit]
        95 % bound on the error of that map: of where the tip is in the sensor's frame.
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
    angle : (n,) array [rad] or None
        Between the tool's orientation, by the model's body, and that of the nominal arm; of a row
        that is not reached that of the nearest.  None where positions alone are corrected.
    placement_error : (n,) array [unit] or None
        95 % bound on the distance of the corrected tip from where the nominal arm would be, with
        what is unsure of the sensor's frame and of the probe.  None where the frame is known.
    """

    q: Array
    nearest: Array
    target: Array
    distance: Array
    expected_error: Array
    reachable: NDArray[np.bool_]
    change: Array
    limit: Array
    exceeded: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
    single: bool = False
    angle: Array | None = None
    _placed: Callable[[], Array] | None = field(default=None, repr=False)

    @cached_property
    def placement_error(self) -> Array | None:
        """See above; found when it is asked for."""
        return None if self._placed is None else self._placed()


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
    if limit is None and (view, cause) == ("auto", "sensor"):
        quick = _quick(model, q)
        if quick is not None:
            return quick
    rows, single = checked_rows(q, model.about.joint_names, "joint values")
    about = model.about
    check_joint_values(
        rows, about.joint_names, about.lower, about.upper, about.revolute, error=QueryError
    )
    nominal = wanted(model, view, cause)
    if limit is None:
        limits = usual_limit(model, view, cause)
    else:
        limits = each_joint("limit", limit, about.joint_names, zero=False)
    target, answer, nearest = _solved(model, nominal, rows)
    found = np.where(answer.reachable[:, None], nearest, np.nan)
    change = found - rows
    return Corrected(
        found,
        nearest,
        target,
        answer.distance,
        answer.expected_error,
        answer.reachable,
        change,
        limits,
        answer.reachable & (np.abs(change) > limits).any(axis=1),
        _notes(model, nominal, cause),
        single,
        None if nominal.pose is None else nominal.pose.angle(rows, nearest),
        _placement(model, nominal, rows, nearest),
    )


def _notes(model: Model, nominal: Wanted, cause: str) -> tuple[str, ...]:
    """What a correction assumes."""
    notes = free_frame(model, cause) if nominal.free else ()
    if (moves_in_space(model) or nominal.near is not None) and nominal.pose is None:
        notes = (*notes, _POSITIONS)
    if any(abs(frame.angle) > _TURNED for frame in frames(model, cause)):
        notes = (*notes, _TURNED_FRAME)
    return notes


def _placement(
    model: Model, nominal: Wanted, q: Array, nearest: Array
) -> Callable[[], Array] | None:
    """What tells the bound (n,) on the tip's distance from where the nominal arm would be."""
    body, drawn = model.body, nominal.drawn
    if body is None or drawn is None:
        return None

    def bound() -> Array:
        structure, part = body.structure, slice(body.structure.blocks[0])
        still = [own for name, own in structure.groups.items() if not name.startswith(_FITTED)]
        _, real = structure.linearise(nearest, body.beta)
        _, drawing = structure.linearise(q, drawn)
        drawing[:, :, np.concatenate(still)] = 0.0
        apart = (real - drawing)[:, part][:, :, body.active]
        spread = SHARED**2 * spread_of(apart, body.root)
        return np.asarray(body.kappa * radius_95(spread + np.diag(body.residual[part] ** 2)))

    return bound


def _quick(model: Model, q: ArrayLike) -> Corrected | None:
    """The correction of one row by the compiled kernel; None where the batch has to answer."""
    kernel = model.kernel
    if kernel is None or not kernel.has("correct"):
        return None
    nominal = wanted(model, "auto", "sensor")
    if nominal.agrees is None:
        nominal.agrees = _agrees(model, nominal)
    if not nominal.agrees or (found := kernel.correct(q)) is None:
        return None
    seen, aim, bound = kernel.forward(found), kernel.wanted(q), kernel.bound(found, "bound")
    if not (seen and aim and bound and seen[1] and bound[1]):
        return None
    asked = np.array(q, dtype=float)
    change, limits = found - asked, nominal.limits_array
    return Corrected(
        found[None],
        found[None],
        aim[0][None],
        np.array([math.dist(seen[0], aim[0])]),
        np.array([bound[0]]),
        _YES,
        change[None],
        limits,
        (np.abs(change) > limits).any(keepdims=True),
        nominal.said,
        True,
        None if nominal.pose is None else np.zeros(1),
        _placement(model, nominal, asked[None], found[None]),
    )


def _agrees(model: Model, nominal: Wanted) -> bool:
    """Whether the compiled kernel corrects towards the same place as this does."""
    kernel, q = model.kernel, visited_joints(model, _TRIED)
    assert kernel is not None  # noqa: S101
    usual_limit(model)
    nominal.said = _notes(model, nominal, "sensor")
    nominal.limits_array = np.array(nominal.limits)
    _, answer, nearest = _solved(model, nominal, q)
    found = [kernel.correct(row) for row in q]
    both = [k for k, row in enumerate(found) if row is not None and answer.reachable[k]]
    return bool(both) and all(float(np.abs(found[k] - nearest[k]).max()) < _SAME for k in both)


def free_frame(model: Model, cause: str) -> tuple[str, ...]:
    """Return what is assumed where the sensor's frame is fitted to the model's own log."""
    if cause == "sensor":
        return (_FREE_FRAME,)
    if not model.history:
        return (_FREE_FRAME, _CAUSE_OF_NOTHING)
    return (_FRAME_IN_SPACE,) if moves_in_space(model) else (_FRAME_BEFORE,)


def usual_limit(model: Model, view: str = "auto", cause: str = "sensor") -> Array:
    """Return the largest change of each joint that is trusted, (dof,) [rad or m].

    Three times the 95 % quantile of what correcting the motor map's own nodes changes; one
    limit for all joints that turn, another for those that slide.  It is found once.
    """
    nominal = wanted(model, view, cause)
    if nominal.limits:
        return np.array(nominal.limits)
    q = visited_joints(model, _NODES)
    _, answer, nearest = _solved(model, nominal, q)
    change = np.abs(nearest - q)[answer.reachable]
    turns = np.array(model.about.revolute)
    limits = np.full(len(turns), _LEAST)
    for kind in (turns, ~turns):
        if kind.any() and len(change):
            usual = float(np.quantile(change[:, kind].max(axis=1), 0.95))
            limits[kind] = max(_LEAST, _USUAL * usual)
    nominal.limits[:] = limits.tolist()
    return limits


def _solved(model: Model, nominal: Wanted, q: Array) -> tuple[Array, Answer, Array]:
    """Return targets (n, m), answers, and the joints (n, dof), on the turn that `q` is on.

    Of six joints or more a row is reached where its orientation is, too.
    """
    about = model.about
    near = q.copy()
    for k, turns in enumerate(about.revolute):
        if turns:
            near[:, k] = wrap(q[:, k], float(about.lower[k]), float(about.upper[k]))
    target = nominal.target(near)
    there = np.ones(len(near), dtype=bool)
    if nominal.pose is not None:
        # beside a singularity the tool is not tilted without a word: there is no answer
        near, left = nominal.pose.towards(near)
        slack = ROUNDED * (about.upper - about.lower)
        lower, upper = about.lower - slack, about.upper + slack
        there = (left <= REACHED) & ((near >= lower) & (near <= upper)).all(axis=1)
    elif nominal.near is not None:
        near, there = nominal.near(near)
    answer = model.solve(target, np.clip(near, about.lower, about.upper))
    answer.reachable[~there] = False
    found = answer.q.copy()
    turning = np.array(about.revolute)
    found[:, turning] += TURN * np.round((q - found)[:, turning] / TURN)
    return target, answer, found
