"""Correcting: joint values that bring the real arm to where the nominal one would be.

Use it on what a controller that trusts its URDF is about to command.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..body.covariance import radius_95, spread_of
from ..body.settings import SHARED
from ..common.arrays import Array
from ..common.rows import checked_rows, each_joint
from ..common.scale import TURN
from ..errors import QueryError
from ..kernel.compiled import Compiled
from ..model.answers import anchor, joints_and_reach
from ..model.model import Model
from ..model.nominal import moves_in_space, visited_joints
from ..samples.joint_values import check_joint_values
from ..samples.log_ranges import wrap
from .geometry import frames
from .wanted import Wanted, wanted

_USUAL = 3.0  # a correction this many times the 95 % quantile of the model's own is not trusted
_LEAST = 0.01  # [rad or m]; a limit below would refuse what is harmless
_NODES = 200
_TRIED, _SAME = 5, 1e-6  # rows by which the compiled kernel is compared, and how close [rad or m]
_FITTED = ("view.", "tool", "lens")  # parameters of the sensor and of what is put on the tip
_TURNED = 1e-4  # a turn of the frame that is worth a word [rad]

_FREE = "the sensor's frame is fitted to the log, so the first joint's offset is taken as zero; if "
_NOTES = {
    "free": _FREE + "the log is in the robot's root frame, give `view='base'`",
    "nothing moved": (
        "`cause='joints'` applies to what an adaptation found; this frame was fitted to the "
        "model's own log, so the first joint's offset stays zero"
    ),
    "before": (
        "the sensor's frame is taken as it was before the adaptation, where the first joint's "
        "offset was taken as zero"
    ),
    "in space": (
        "of an arm in space `cause='joints'` is said to the adaptation itself: adapt with it, then "
        "the first joint's offset is corrected without it"
    ),
    "turned": (
        "an adaptation found that the sensor's frame turned, which is not corrected; an offset of "
        "the first joint looks the same: if the sensor stayed, give `cause='joints'`"
    ),
    "positions": (
        "positions alone are corrected; the tool's orientation follows from the smallest change of "
        "the joints"
    ),
}


@dataclass(frozen=True, eq=False)
class Corrected:
    """Corrected joint values, one row each; what is not asked for is not found."""

    given: Array  # (n, dof) [rad or m], joint values that are right for the nominal arm
    # (n, dof) [rad or m], what to command; where the real arm cannot get there what comes nearest
    nearest: Array
    reachable: NDArray[np.bool_]  # (n,), whether the real arm gets there
    limit: Array  # (dof,) [rad or m], largest change of each joint that is trusted
    notes: tuple[str, ...]  # what was assumed
    single: bool  # whether one vector was given rather than rows
    _model: Model = field(repr=False)
    _wanted: Wanted = field(repr=False)

    @cached_property
    def q(self) -> Array:
        """What to command (n, dof) [rad or m]; NaN where the real arm cannot get there."""
        return np.where(self.reachable[:, None], self.nearest, np.nan)

    @cached_property
    def change(self) -> Array:
        """Corrected minus given (n, dof) [rad or m]; NaN where there is no answer."""
        return self.q - self.given

    @cached_property
    def exceeded(self) -> NDArray[np.bool_]:
        """Rows (n,) that change by more than the limit."""
        return np.asarray(self.reachable & (np.abs(self.change) > self.limit).any(axis=1))

    @cached_property
    def target(self) -> Array:
        """Where the nominal arm would be (n, m) [unit], in the sensor's frame."""
        return self._wanted.target(_in_range(self._model, self.given))

    @cached_property
    def distance(self) -> Array:
        """From the target to where the corrected joints lead, by the learned map, (n,) [unit]."""
        seen = self._model.predicted(self._unit, self._model.default_readout)
        return np.asarray(np.linalg.norm(seen - self.target, axis=1))

    @cached_property
    def expected_error(self) -> Array:
        """95 % bound (n,) [unit] on the error of that map, see :meth:`calib.Model`."""
        return self._model.bound_at(self._unit)

    @cached_property
    def angle(self) -> Array | None:
        """Angle (n,) [rad] between the tool, by the model's body, and that of the nominal arm.

        Of a row that is not reached that of the nearest.  None where positions alone are corrected.
        """
        return self._wanted.angle(self.given, self.nearest)

    @cached_property
    def placement_error(self) -> Array | None:
        """95 % bound on the distance of the corrected tip from where the nominal arm would be.

        (n,) [unit], with what is unsure of the sensor's frame and of the probe.  None where the
        frame is known.
        """
        body, drawn = self._model.body, self._wanted.drawn
        if body is None or drawn is None:
            return None
        structure, part = body.structure, slice(body.structure.blocks[0])
        still = [own for name, own in structure.groups.items() if not name.startswith(_FITTED)]
        _, real = structure.linearise(self.nearest, body.beta)
        _, drawing = structure.linearise(self.given, drawn)
        drawing[:, :, np.concatenate(still)] = 0.0
        apart = (real - drawing)[:, part][:, :, body.active]
        spread = SHARED**2 * spread_of(apart, body.root)
        return np.asarray(body.kappa * radius_95(spread + np.diag(body.residual[part] ** 2)))

    @property
    def _unit(self) -> Array:
        return self._model.motor.scale.to_unit(self.nearest)


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
    place, nearest to `q` and on the same turn.  Places are compared in the sensor's frame: that
    of a simulation is the root link's plane, and moves with what an adaptation found; that of a log
    is fitted together with joint offsets and link placements, so that only what is the arm's own
    is compensated.

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
    """
    if model.kernel is not None and limit is None and view == "auto" and cause == "sensor":
        quick = _quick(model, model.kernel, q)
        if quick is not None:
            return quick
    about = model.about
    rows, single = checked_rows(q, about.joint_names, "joint values")
    check_joint_values(
        rows, about.joint_names, about.lower, about.upper, about.revolute, error=QueryError
    )
    nominal = wanted(model, view, cause)
    if limit is None:
        limits = usual_limit(model, view, cause)
    else:
        limits = each_joint("limit", limit, about.joint_names, zero=False)
    nearest, reachable = _solved(model, nominal, rows)
    notes = _notes(model, nominal, cause)
    return Corrected(rows, nearest, reachable, limits, notes, single, model, nominal)


def _notes(model: Model, nominal: Wanted, cause: str) -> tuple[str, ...]:
    notes = free_frame(model, cause) if nominal.free else ()
    positions = moves_in_space(model) and not nominal.posed
    turned = any(abs(frame.angle) > _TURNED for frame in frames(model, cause))
    told = {"positions": positions, "turned": turned}
    return (*notes, *(_NOTES[name] for name, there in told.items() if there))


def _quick(model: Model, kernel: Compiled, q: ArrayLike) -> Corrected | None:
    """The correction of one row by the compiled kernel; None where the batch has to answer."""
    kept = model.remembered.get("correcting")
    if kept is None:
        kept = model.remembered["correcting"] = _same_for_all(model, kernel)
    found = kernel.ask("correct", q) if kept else None
    if found is None or found[1] != 1:
        return None
    nearest = found[0]
    if not model.trust.everywhere and not kernel.ask("forward", nearest[0])[1]:  # type: ignore[index]
        return None
    answer = Corrected.__new__(Corrected)  # whose own way of setting fields takes as long as C
    answer.__dict__.update(kept, given=np.array([q], dtype=float), nearest=nearest)
    return answer


def _same_for_all(model: Model, kernel: Compiled) -> dict[str, Any]:
    """What is the same of all corrections; nothing if the kernel corrects towards other places."""
    if not kernel.has("correct"):
        return {}
    nominal, q = wanted(model, "auto", "sensor"), visited_joints(model, _TRIED)
    nearest, reachable = _solved(model, nominal, q)
    found = [kernel.ask("correct", row) or (nearest, 0) for row in q]
    both = [k for k, (_, said) in enumerate(found) if said == 1 and reachable[k]]
    if not both or max(np.abs(found[k][0][0] - nearest[k]).max() for k in both) >= _SAME:
        return {}
    return {
        "reachable": np.ones(1, dtype=bool),
        "limit": usual_limit(model),
        "notes": _notes(model, nominal, "sensor"),
        "single": True,
        "_model": model,
        "_wanted": nominal,
    }


def free_frame(model: Model, cause: str) -> tuple[str, ...]:
    """Return what is assumed where the sensor's frame is fitted to the model's own log."""
    if cause == "sensor" or not model.history:
        return (_NOTES["free"], *([_NOTES["nothing moved"]] if cause != "sensor" else []))
    return (_NOTES["in space" if moves_in_space(model) else "before"],)


def usual_limit(model: Model, view: str = "auto", cause: str = "sensor") -> Array:
    """Return the largest change of each joint that is trusted, (dof,) [rad or m].

    Three times the 95 % quantile of what correcting the motor map's own nodes changes; one
    limit for all joints that turn, another for those that slide.  It is found once.
    """
    nominal = wanted(model, view, cause)
    if nominal.limits:
        return np.array(nominal.limits)
    q = visited_joints(model, _NODES)
    nearest, reachable = _solved(model, nominal, q)
    change = np.abs(nearest - q)[reachable]
    turns = np.array(model.about.revolute)
    limits = np.full(len(turns), _LEAST)
    for kind in (turns, ~turns):
        if kind.any() and len(change):
            usual = float(np.quantile(change[:, kind].max(axis=1), 0.95))
            limits[kind] = max(_LEAST, _USUAL * usual)
    nominal.limits[:] = limits.tolist()
    return limits


def _in_range(model: Model, q: Array) -> Array:
    """Joint values (n, dof) with those that turn moved by whole turns into their range."""
    about, near = model.about, q.copy()
    for k in np.flatnonzero(about.revolute):
        near[:, k] = wrap(q[:, k], float(about.lower[k]), float(about.upper[k]))
    return near


def _solved(model: Model, nominal: Wanted, q: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Joints (n, dof), on the turn that `q` is on, and whether they reach, (n,).

    Of six joints or more a row is reached where its orientation is, too: beside a singularity the
    tool is not tilted without a word.
    """
    about, near = model.about, _in_range(model, q)
    target, there = nominal.target(near), np.ones(len(near), dtype=bool)
    if nominal.space is not None:
        near, there = nominal.near(near)
    near = np.clip(near, about.lower, about.upper)
    if model.default_readout == "local":
        found, reachable = joints_and_reach(model, target, anchor(model, near, len(near)))
    else:
        answer = model.solve(target, near)
        found, reachable = answer.q, answer.reachable
    turns = TURN * np.round((q - found) / TURN)
    return found + np.where(about.revolute, turns, 0.0), reachable & there
