"""The model: two maps, their Hebbian links and local models, queried in both directions.

`ModelParts` has the fields, bounds and readouts; `Compilable` adds single queries by compiled C,
`Model` the public queries.  Functions that a model imports take its `ModelParts`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..common.choices import check_choice
from ..common.inputs import number_rows, query_rows
from ..errors import OptionError, QueryError
from ..kernel.compiled import Flag
from . import answers
from .answers import Answer
from .compilable import Compilable
from .compiled_queries import (
    FORWARD,
    INVERSE,
    JACOBIAN,
    POSE,
    POSES,
    POSITION_BOUND,
    READING_BOUND,
)
from .parts import MOST_SHARE, PREDICTOR, with_arm_of
from .prediction import Prediction

if TYPE_CHECKING:
    import os

    from .paths import Path

FUNCTIONS = (
    "adapt",
    "check",
    "correct",
    "evaluate",
    "figures",
    "follow",
    "monitor",
    "preview",
    "recognise",
    "report",
)
"""Functions of the package that take a model, for users who look for a method."""


@dataclass(frozen=True, eq=False, repr=False)
class Model(Compilable):
    """A calibrated arm: its :class:`calib.model.parts.ModelParts`, and what it answers.

    Queries take single vectors as well as batches, with one row each.
    """

    # the same arm as its further sensors see it, each with its own maps, local models and bounds
    others: tuple[Model, ...] = ()

    if not TYPE_CHECKING:  # which would take every attribute for one

        def __getattr__(self, name: str) -> NoReturn:
            """Name the package's function of that name in the error."""
            hint = ""
            if name in FUNCTIONS:
                hint = f": call `calib.{name}(model, ...)`"
            raise AttributeError(f"a model has no attribute {name!r}{hint}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file, whole or not at all."""
        from ..model_file.storage import save

        save(self, path)

    def by(self, sensor: str) -> Model:
        """Return the model as one of its sensors sees the arm, with that sensor's own bounds.

        The first sensor is the model itself; so is every one where there is one without a name.
        Raises OptionError if it is none of `sensors`.
        """
        if sensor in ("", self.about.sensor) or self.sensors == ("",):
            return self
        check_choice("sensor", sensor, self.sensors)
        return self.others[self.sensors.index(sensor) - 1]

    @property
    def notes(self) -> tuple[str, ...]:
        """What training assumed and found, of several sensors each after the name of its own."""
        if len(self.sensors) == 1:
            return self.about.notes
        notes = {name: self.by(name).about.notes for name in self.sensors}
        shared = [
            note
            for note in self.about.notes
            if all(note in of_sensor for of_sensor in notes.values())
        ]
        of_one = [
            f"{name}: {note}"
            for name, of_sensor in notes.items()
            for note in of_sensor
            if note not in shared
        ]
        return (*shared, *of_one)

    def with_sensor(self, adapted: Model) -> Model:
        """Return the model with one adapted sensor, whose arm all its sensors take over."""
        before = self.by(adapted.about.sensor)
        events = adapted.history[len(before.history) :]
        first, *others = (
            with_arm_of(model, adapted, events)
            for model in (self, *self.others)
        )
        return replace(first, others=tuple(others))

    def forward(
        self,
        q: ArrayLike,
        readout: str | None = None,
        *,
        approach: ArrayLike | None = None,
        sensor: str = "",
    ) -> Array:
        """Position (n, m) [unit] of the tip for joint values.

        NaN outside of the joints' range, where the bound on the position exceeds a tenth of the
        reach, and for joint values that are not finite.

        q : (n, dof) or (dof,) array [rad or m]
        readout : {"local", "body", "linear", "activity", "winner"}, the model's default if None
        approach : (n, dof) or (dof,), sign of the last motion of each joint, 0 where it is not
            known.  It counts where training found backlash (``model.approach``).
        sensor : one of :attr:`sensors`, whose readings are wanted; the first one by default
        Raises QueryError if the shape is wrong.

        Examples
        --------
        >>> import calib
        >>> arm = calib.load_arm("two_link")
        >>> model = calib.train(calib.babble(arm, 2000, seed=0), size=20)
        >>> model.forward([0.5, 1.0]).round(3)
        array([0.281, 0.393])
        """
        if sensor:
            if self.sensors == ("",):
                why = f"sensor {sensor!r}: expected none, the model has one sensor"
                raise OptionError(why, parameter="sensor")
            return self.by(sensor).forward(q, readout, approach=approach)
        if readout is None or self._resolve_readout(readout) == PREDICTOR:
            return self._at(FORWARD, q, approach)
        motion, single = answers.motion_of(self, q, approach)
        x = Prediction(self, motion).read(readout)
        return x[0] if single else x

    def inverse(
        self,
        x: ArrayLike,
        near: ArrayLike | None = None,
        readout: str | None = None,
        *,
        nearest: bool = False,
    ) -> Array:
        """Joint values (n, dof) [rad or m] that bring the tip to positions (n, m) [unit].

        x : (n, m) or (m,) array [unit]
        near : (n, dof) or (dof,) array [rad or m]; of several solutions the one closest to these
            joints answers, in units of the joints' ranges; their middle where not given
        readout : {"local", "body", "linear", "activity", "winner"}, the model's default if None
        nearest : whether the nearest reachable point answers a target out of reach instead of NaN
        """
        near_or_middle = near
        if near is None and self.strict and np.ndim(x) == 1:
            near_or_middle = self._middle
        if readout in (None, PREDICTOR) and near_or_middle is not None:
            unsure = [Flag.NONE]
            if nearest:
                unsure.append(Flag.UNREACHABLE)
            quick = self._single(INVERSE, near_or_middle, x, unsure=unsure)
            if quick is not None:
                return quick
        rows, single = query_rows(x, self.axes, "positions")
        if self._resolve_readout(readout) == PREDICTOR:
            q = answers.inverse(self, rows, near, nearest=nearest)
        else:
            answer = self.solve(rows, near, readout)
            there = answer.reachable[:, None] | nearest
            q = np.where(there, answer.q, np.nan)
        return q[0] if single else q

    @property
    def _middle(self) -> Array:
        """The middle of the joints' ranges, (dof,)."""
        return 0.5 * (self.about.lower + self.about.upper)

    def solve(
        self,
        x: ArrayLike,
        near: ArrayLike | None = None,
        readout: str | None = None,
    ) -> Answer:
        """Answer inverse queries in full; see :meth:`inverse` for the parameters."""
        rows, _ = query_rows(x, self.axes, "positions")
        return answers.solve(self, rows, near, self._resolve_readout(readout))

    def solve_all(self, x: ArrayLike) -> list[Answer]:
        """All branches of each target (n, m), the one closest to the middle of the ranges first.

        A target out of reach has one answer, the nearest attainable point.
        """
        rows, _ = query_rows(x, self.axes, "positions")
        return answers.solve_all(self, rows)

    def inverse_all(self, x: ArrayLike) -> list[Array]:
        """Joint values (k, dof) of every branch that reaches each target (n, m).

        The one closest to the middle of the joints' ranges comes first; a target out of reach has
        none.  Of a redundant arm each connected family of solutions has one.
        """
        rows, _ = query_rows(x, self.axes, "positions")
        return answers.inverse_all(self, rows)

    def expected_error(
        self, q: ArrayLike, *, approach: ArrayLike | None = None
    ) -> Array:
        """95 % bound on the error of :meth:`forward` at joint values (n, dof), (n,) [unit].

        It bounds the distance to the true position for a simulated arm and to what the
        sensor would read for a log (``about.bound_of``).  It holds for the default readout;
        another one is off by its distance from the default as well.  With `approach`, see
        :meth:`forward`, it is the smaller bound for a known direction.
        """
        return self._at(READING_BOUND, q, approach)

    def model_error(
        self, q: ArrayLike, *, approach: ArrayLike | None = None
    ) -> Array:
        """95 % bound on the true position in the sensor's frame at (n, dof), (n,) [unit].

        Without the noise of a single reading; the same as :meth:`expected_error` for a
        simulated arm.
        """
        return self._at(POSITION_BOUND, q, approach)

    def outside(self, q: ArrayLike, *, degrees: bool = False) -> str | None:
        """Why the joint values (dof,) are outside of what was learned, None if they are not.

        degrees : whether the words give angles in degrees
        """
        rows, _ = number_rows(q, self.about.joint_names, "joint values")
        if len(rows) != 1:
            raise QueryError(f"{len(rows)} rows of joints: expected one")
        if bool(self.covers(rows)[0]):
            return None
        return self.beyond_range(rows[0], degrees=degrees) or (
            "no row was measured near these joint values: the position may be off by more than "
            f"{MOST_SHARE:.0%} of the reach"
        )

    def path(
        self,
        x: ArrayLike,
        start: ArrayLike | None = None,
        step: float | None = None,
        *,
        frame: str = "sensor",
    ) -> Path:
        """Joint values along straight lines through waypoints, on one branch if there is one.

        x : (n, m) array [unit, m in the base frame], two waypoints or more
        start : (dof,) array [rad or m], joints that the path should start near; without it the
            branch that can follow the path furthest, of several the one that moves least
        step : float [as x], longest way of the tip between two rows, 1 % of the workspace's extent
            where not given; ``math.inf`` gives the waypoints alone
        frame : {"sensor", "base"}
        """
        from .paths import follow_path

        return follow_path(self, x, start, step, frame)

    def inverse_pose(
        self,
        position: ArrayLike,
        quaternion: ArrayLike | None = None,
        near: ArrayLike | None = None,
        *,
        frame: str = "sensor",
        free: str | None = None,
    ) -> Array:
        """Joint values (n, dof) for positions and orientations of an arm in space.

        NaN out of reach; :func:`calib.model.poses.solve_poses` returns reasons and all branches.

        position : (n, 3) or (3,) array [m, or the sensor's unit in its frame]
        quaternion : (n, 4) or (4,) array qx, qy, qz, qw; free where not given
        near : (n, dof) or (dof,) array [rad or m]; the nearest to these joints answers
        frame : {"sensor", "base"}
        free : {"x", "y", "z"}, an axis of the tip about which it may turn freely
        """
        from .poses import solve_poses

        if self.kernel is not None and np.ndim(position) == 1:
            quick = self._single_pose(position, quaternion, near, frame, free)
            if quick is not None:
                return quick
        answer = solve_poses(
            self,
            position,
            quaternion,
            near,
            frame=frame,
            free=free,
            bounded=False,
        )
        q = np.where(answer.reachable[:, None], answer.q, np.nan)
        return q[0] if np.ndim(position) == 1 else q

    def _single_pose(
        self,
        position: ArrayLike,
        quaternion: ArrayLike | None,
        near: ArrayLike | None,
        frame: str,
        free: str | None,
    ) -> Array | None:
        """What the compiled C answers to one pose; None where the batch has to."""
        from .poses import free_axis, pose_in_sensor, wrong_length

        if quaternion is None and not self.strict:
            return None
        if self.strict and quaternion is not None:
            complaint = wrong_length(quaternion)
            if complaint:
                return self._refusal(complaint)
        if frame == "base":
            position, quaternion = pose_in_sensor(self, position, quaternion)
        if near is None:
            near = self._middle
        if quaternion is None:
            return self._single(INVERSE, near, position)
        axis = free_axis(free)
        no_starts = (-1 if axis is None else axis, 0, 0)
        unsure = [Flag.NONE]
        if not self.strict:
            unsure += [Flag.UNSURE, Flag.UNREACHABLE]
        question = (near, position, quaternion, no_starts)
        return self._single(POSES, *question, unsure=unsure)

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivative (n, m, dof), (m, dof) of :meth:`forward` by the joint values [unit/rad].

        NaN where there is no position.
        """
        return self._at(JACOBIAN, q)

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (n, 3) and quaternion (n, 4) qx, qy, qz, qw of the tip in the sensor's frame.

        NaN where there is no position.  Raises QueryError if the model is of a planar arm, of
        pixels, or knows no arm in space.
        """
        numbers = self._at(POSE, q)
        return numbers[..., :-4], numbers[..., -4:]

    def servo(
        self,
        x_measured: ArrayLike,
        target: ArrayLike,
        q: ArrayLike,
        gain: float = 0.5,
    ) -> Array:
        """Joints (n, dof) a step closer to a target, from where the sensor sees the tip.

        A resolved-rate correction with the learned Jacobian: it closes the loop on the
        sensor, so that it converges even where the arm differs from the map.  The step stays
        within the joints' range and is at most a tenth of it long.

        x_measured, target : (n, m) or (m,) array [unit], where the tip is seen, where it should be
        q : (n, dof) or (dof,) array [rad or m], present joints; next time what this returns
        gain : share of the way that a step goes: smaller is calmer with a noisy sensor
        """
        return answers.servo_step(self, x_measured, target, q, gain)
