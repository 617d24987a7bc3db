"""Correcting: joint values that bring the real arm to where the nominal one would be.

Use it on what a controller that trusts its URDF is about to command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.rotations import logarithm
from ..body.covariance import radius_95, spread_of
from ..body.planar import PlanarStructure
from ..body.settings import SHARED
from ..common.arrays import Array, frozen
from ..common.rows import checked_rows, each_joint
from ..common.scale import TURN
from ..errors import OptionError, QueryError
from ..model.answers import anchor, joints_and_reach
from ..model.model import Model
from ..model.nominal import (
    moves_in_space,
    nominal_arm,
    nominal_behind,
    nominal_in_plane,
    visited_joints,
)
from ..model.space import REACHED, Space
from ..samples.joint_values import check_joint_values, wrap
from .frames import frame_is_free, frame_notes, frames, is_simulated
from .geometry import fit_geometry

_USUAL = 3.0  # a correction this many times the 95 % quantile of the model's own is not trusted
_LEAST = 0.01  # [rad or m]; a limit below would refuse what is harmless
_NODES = 200
_POSED = 6  # joints from which on a tool's orientation can be kept
# rows by which the compiled kernel is compared, and how close [rad or m]
_TRIED = 5
_SAME = 1e-6
_FITTED = (
    "view.",
    "tool",
    "lens",
)  # parameters of the sensor and of what is put on the tip
_TURNED = 1e-4  # a turn of the frame that is worth a word [rad]

_MOVED = (
    "an adaptation found that the sensor's frame turned, which is not corrected; an offset of the "
    "first joint looks the same: if the sensor stayed, say so to the adaptation, `cause='joints'`"
)
_POSITIONS = (
    "positions alone are corrected; the tool's orientation follows from the smallest change of the "
    "joints"
)


@dataclass(frozen=True, eq=False)
class _Wanted:
    """Where the nominal arm would be, in the sensor's frame."""

    target: Callable[[Array], Array]  # of joint values (n, dof), positions (n, m)
    free: bool = False  # whether the sensor's frame was fitted
    keeps_turn: bool = True  # whether a tool's orientation is kept where the arm can
    drawn: Array | None = (
        None  # (d,), of a body in space its nominal arm's behind a fitted frame
    )
    # where more than what the sensor reads has to be met: the tool's pose, or before a camera,
    # whose pixel does not say how far away the tip is, its place
    space: Space | None = None

    @property
    def posed(self) -> bool:
        """Whether the tool's orientation is kept."""
        dof = 0 if self.space is None else len(self.space.model.about.lower)
        return self.keeps_turn and dof >= _POSED

    def pose(self, q: Array) -> tuple[Array, Array]:
        """Place (n, 3) and orientation (n, 3, 3) of the nominal tool in the base frame."""
        assert self.space is not None  # noqa: S101
        structure: Any = self.space.body.structure
        place, turn = structure.pose(q, nominal_behind(structure, self.space.body.beta))
        return place, turn


@dataclass(frozen=True, eq=False)
class Corrected:
    """Corrected joint values, one row each; what is not asked for is not found."""

    given: Array  # (n, dof) [rad or m], joint values that are right for the nominal arm
    # (n, dof) [rad or m], what to command; where the real arm cannot get there what comes nearest
    nearest: Array
    reachable: NDArray[np.bool_]  # (n,), whether the real arm gets there
    limit: Array  # (dof,) [rad or m], largest change of each joint that is trusted
    notes: tuple[str, ...]  # what was assumed
    _model: Model = field(repr=False)
    _wanted: _Wanted = field(repr=False)

    @cached_property
    def q(self) -> Array:
        """What to command (n, dof) [rad or m].

        NaN where the real arm cannot get there, or a joint would change by more than the limit.
        """
        answered = self.reachable & ~self.exceeded
        return np.where(answered[:, None], self.nearest, np.nan)

    @cached_property
    def change(self) -> Array:
        """Corrected minus given (n, dof) [rad or m], beyond the limit, too; NaN out of reach."""
        return np.where(self.reachable[:, None], self.nearest - self.given, np.nan)

    @cached_property
    def exceeded(self) -> NDArray[np.bool_]:
        """Rows (n,) that change by more than the limit."""
        return np.asarray(
            self.reachable & (np.abs(self.change) > self.limit).any(axis=1)
        )

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
        wanted = self._wanted
        if wanted.space is None or not wanted.posed:
            return None
        nominal = wanted.pose(self.given)[1]
        real = wanted.space.evaluate(self.nearest)[1]
        turned = logarithm(real @ np.swapaxes(nominal, 1, 2))
        return np.asarray(np.linalg.norm(turned, axis=1))

    @cached_property
    def placement_error(self) -> Array | None:
        """95 % bound on the distance of the corrected tip from where the nominal arm would be.

        (n,) [unit], with what is unsure of the sensor's frame and of the probe.  None where the
        frame is known.
        """
        body = self._model.body
        drawn = self._wanted.drawn
        if body is None or drawn is None:
            return None
        structure = body.structure
        part = slice(body.structure.blocks[0])
        still = [
            own
            for name, own in structure.groups.items()
            if not name.startswith(_FITTED)
        ]
        _, real = structure.linearise(self.nearest, body.beta)
        _, drawing = structure.linearise(self.given, drawn)
        drawing[:, :, np.concatenate(still)] = 0.0
        apart = (real - drawing)[:, part][:, :, body.active]
        spread = SHARED**2 * spread_of(apart, body.root)
        return np.asarray(
            body.kappa * radius_95(spread + np.diag(body.residual[part] ** 2))
        )

    @property
    def _unit(self) -> Array:
        return self._model.motor.scale.to_unit(self.nearest)


def correct(
    model: Model,
    q: ArrayLike,
    *,
    limit: ArrayLike | None = None,
    view: str = "auto",
    orientation: str = "keep",
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
    orientation : {"keep", "free"}
        "free" gives the position alone with six joints or more, too: near a singularity of the
        wrist the pose cannot be had.
    """
    if orientation not in ("keep", "free"):
        raise OptionError(f"orientation {orientation!r}: expected 'keep' or 'free'")
    usual = limit is None and view == "auto" and orientation == "keep"
    if model.kernel is not None and usual:
        quick = _quick(model, q)
        if quick is not None:
            return quick
    about = model.about
    rows, _ = checked_rows(q, about.joint_names, "joint values")
    check_joint_values(
        rows,
        about.joint_names,
        about.lower,
        about.upper,
        about.revolute,
        error=QueryError,
    )
    wanted = _wanted(model, view)
    if orientation == "free":
        wanted = replace(wanted, keeps_turn=False)
    nearest, reachable = _solved(model, wanted, rows)
    if limit is None:
        limits = usual_limit(model, view)
    else:
        limits = each_joint("limit", limit, about.joint_names, zero=False)
    return Corrected(
        rows, nearest, reachable, limits, _notes(model, wanted), model, wanted
    )


def _quick(model: Model, q: ArrayLike) -> Corrected | None:
    """The correction of one row by the compiled kernel; None where the batch has to answer."""
    kernel: Any = model.kernel
    kept = model.remembered.get("correcting")
    if kept is None:
        kept = {}
        if kernel.has(
            "correct"
        ):  # it may correct towards another place, such as after adaptations
            wanted = _wanted(model, "auto")
            tried = visited_joints(model, _TRIED)
            known = zip(tried, *_solved(model, wanted, tried), strict=True)
            answers = [
                (kernel.ask("correct", row), near) for row, near, ok in known if ok
            ]
            gaps = [
                np.abs(found[0] - near).max()
                for found, near in answers
                if found[1] == 1
            ]
            if gaps and max(gaps) < _SAME:
                limit = usual_limit(model)
                notes = _notes(model, wanted)
                kept = {
                    "reachable": np.ones(1, dtype=bool),
                    "limit": limit,
                    "notes": notes,
                }
                kept |= {"_model": model, "_wanted": wanted}
        model.remembered["correcting"] = kept
    found = kernel.ask("correct", q) if kept else None
    if found is None or (found[1] != 1 and not model.strict):
        return None
    nearest = found[0]
    if found[1] != 1:  # a strict model says no instead of a search
        settings = {name: value for name, value in kept.items() if name != "reachable"}
        given = np.array([q], dtype=float)
        return Corrected(
            given=given, nearest=nearest, reachable=np.zeros(1, bool), **settings
        )
    if not model.everywhere and not kernel.ask("forward", nearest[0])[1]:
        return None
    answer = Corrected.__new__(
        Corrected
    )  # whose own way of setting fields takes as long as C
    answer.__dict__.update(kept, given=np.array([q], dtype=float), nearest=nearest)
    return answer


def nominal_positions(model: Model, q: ArrayLike) -> Array:
    """Return where the drawing says that joints (n, dof) lead, (n, m) [unit].

    It is told in the sensor's frame.
    Raises OptionError or RobotError if the model knows no URDF.
    """
    rows, _ = checked_rows(q, model.about.joint_names, "joint values")
    return _wanted(model, "auto").target(_in_range(model, rows))


def _notes(model: Model, wanted: _Wanted) -> tuple[str, ...]:
    """Return what was assumed."""
    notes: list[str] = []
    if wanted.free:
        notes += frame_notes(model, "sensor")
    if moves_in_space(model) and not wanted.posed:
        notes.append(_POSITIONS)
    if any(abs(frame.angle) > _TURNED for frame in frames(model)):
        notes.append(_MOVED)
    return tuple(notes)


def usual_limit(model: Model, view: str = "auto") -> Array:
    """Return the largest change of each joint that is trusted, (dof,) [rad or m].

    Three times the 95 % quantile of what correcting the motor map's own nodes changes; one
    limit for all joints that turn, another for those that slide.  It is found once.
    """
    key = f"limit {view}"
    if key not in model.remembered:
        q = visited_joints(model, _NODES)
        turns = np.array(model.about.revolute)
        nearest, reachable = _solved(model, _wanted(model, view), q)
        change = np.abs(nearest - q)[reachable]
        limits = np.full(len(turns), _LEAST)
        for kind in (turns, ~turns):
            if kind.any() and len(change):
                usual = float(np.quantile(change[:, kind].max(axis=1), 0.95))
                limits[kind] = max(_LEAST, _USUAL * usual)
        model.remembered[key] = limits.tolist()
    return np.array(model.remembered[key])


def _in_range(model: Model, q: Array) -> Array:
    """Joint values (n, dof) with those that turn moved by whole turns into their range."""
    about = model.about
    near = q.copy()
    for k in np.flatnonzero(about.revolute):
        near[:, k] = wrap(q[:, k], float(about.lower[k]), float(about.upper[k]))
    return near


def _solved(model: Model, wanted: _Wanted, q: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Joints (n, dof), on the turn that `q` is on, and whether they reach, (n,).

    Of six joints or more a row is reached where its orientation is, too: beside a singularity the
    tool is not tilted without a word.
    """
    about = model.about
    near = _in_range(model, q)
    target = wanted.target(near)
    there = np.ones(len(near), dtype=bool)
    if wanted.space is not None:
        place, turn = wanted.pose(near)
        near, left = wanted.space.beside(place, turn if wanted.posed else None, near)
        there = left <= REACHED * wanted.space.length
    near = np.clip(near, about.lower, about.upper)
    if model.default_readout == "local":
        found, reachable = joints_and_reach(
            model, target, anchor(model, near, len(near))
        )
    else:
        answer = model.solve(target, near)
        found = answer.q
        reachable = answer.reachable
    turns = TURN * np.round((q - found) / TURN)
    return found + np.where(about.revolute, turns, 0.0), reachable & there


def _wanted(model: Model, view: str) -> _Wanted:
    """Where the nominal arm would be, fitted once for a model: a controller corrects row by row."""
    key = f"wanted {view}"
    if key in model.remembered:
        known: _Wanted = model.remembered[key]
        return known
    free = frame_is_free(model, view)
    moved = frames(model)
    body = model.body
    own: Any = None if body is None else body.structure
    in_space = moves_in_space(model)
    drawn: Array | None = None
    space: Space | None = None
    predict: Callable[[Array], Array]
    if isinstance(own, PlanarStructure):
        if free:  # the body knows the sensor's frame as it is after all adaptations
            moved = []
        structure, nominal = nominal_in_plane(model, based=not free)
        predict = partial(structure.predict, beta=frozen(nominal))
    elif not in_space or is_simulated(model):
        predict = nominal_arm(model).forward
        seen = fit_geometry(model, view=view).frame if free and not in_space else None
        if seen is not None:
            moved = [seen, *moved]
    elif body is not None and own.informed and (free or own.view == "base"):
        drawn = frozen(nominal_behind(own, body.beta))
        moved = []
        predict = partial(own.predict, beta=drawn)
        space = Space.of(model) if own.dof >= _POSED or own.camera else None
    else:
        fit = fit_geometry(model, view=view)
        beta = frozen(nominal_behind(fit.structure, fit.beta))
        predict = partial(fit.structure.predict, beta=beta)

    def target(q: Array) -> Array:
        return reduce(lambda x, frame: frame.apply(x), moved, predict(q))

    found = model.remembered[key] = _Wanted(target, free, drawn=drawn, space=space)
    return found
