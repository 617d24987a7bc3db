"""Correcting: joint values that bring the real arm to where the nominal one would be.

Use it on what a controller that trusts its URDF is about to command.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import logarithm
from ..common.arrays import Array, Mask
from ..common.choices import check_choice
from ..common.inputs import joint_numbers, query_rows
from ..common.rows import row_lengths
from ..errors import QueryError, require
from ..model.model import Model
from ..model.nominal import visited_joints
from ..model.parts import remembered
from ..samples.joint_values import check_joint_values
from .nominal_target import NominalTarget
from .settings import CORRECTION

_REACHED = np.ones(1, bool)
_UNREACHED = np.zeros(1, bool)


@dataclass(eq=False)  # frozen fields would take as long to set as C to answer
class Corrected:
    """Corrected joint values, one row each."""

    given: Array  # (n, dof) [rad or m], joint values that are right for the nominal arm
    # (n, dof) [rad or m], what to command; where the real arm cannot get there what comes nearest
    nearest: Array
    reachable: Mask  # (n,), whether the real arm gets there
    # (dof,) [rad or m], largest change of each joint that is trusted
    limit: Array
    notes: tuple[str, ...]  # what was assumed
    _nominal: NominalTarget = field(repr=False)

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
        return np.where(
            self.reachable[:, None], self.nearest - self.given, np.nan
        )

    @cached_property
    def exceeded(self) -> Mask:
        """Rows (n,) that change by more than the limit."""
        return np.asarray((np.abs(self.change) > self.limit).any(axis=1))

    @cached_property
    def target(self) -> Array:
        """Where the nominal arm would be (n, m) [unit], in the sensor's frame."""
        return self._nominal.target(self.given)

    @cached_property
    def distance(self) -> Array:
        """From the target to where the corrected joints lead, by the learned map, (n,) [unit]."""
        model = self._nominal.model
        x = model.positions_at(self._unit, model.default_readout)
        return row_lengths(x - self.target)

    @cached_property
    def expected_error(self) -> Array:
        """95 % bound (n,) [unit] on the error of that map, see :meth:`calib.Model`."""
        return self._nominal.model.bound_at(self._unit)

    @cached_property
    def angle(self) -> Array | None:
        """Angle (n,) [rad] between the tool, by the model's body, and that of the nominal arm.

        Of a row that is not reached that of the nearest.  None where positions alone are corrected.
        """
        nominal = self._nominal
        if nominal.space is None or not nominal.keeps_pose:
            return None
        nominal_turn = nominal.pose(self.given)[1]
        real = nominal.space.evaluate(self.nearest)[1]
        rotvec = logarithm(real @ nominal_turn.mT)
        return row_lengths(rotvec)

    @property
    def _unit(self) -> Array:
        return self._nominal.model.motor.scale.to_unit(self.nearest)


def correct(
    model: Model,
    q: ArrayLike,
    *,
    limit: ArrayLike | None = None,
    orientation: str = "keep",
) -> Corrected:
    """Compensate for what the nominal kinematics do not know.

    A controller that trusts its URDF commands `q` to bring the tip to a place.  The real
    arm gets there with other joint values: those for which the learned map says that
    place, nearest to `q` and on the same turn.  Places are compared in the sensor's frame: that
    of a simulation is the root link's plane, and moves with what an adaptation found; that of a log
    is fitted together with joint offsets and link placements, so that only what is the arm's own
    is compensated.  The nominal arm in space carries the tool that the log shows: a tip that is
    further from the last joint than drawn is no error of the arm.

    Parameters
    ----------
    model : Model
        Learned of or adapted to the real arm; it must have a URDF.
    q : (n, dof) or (dof,) array, or named columns [rad or m]
        Joint values that are right for the nominal arm.
    limit : float or (dof,) array, optional [rad or m]
        Largest change of a joint that is trusted; three times what this model usually
        corrects where not given, at least 0.01.  Rows beyond are marked in `exceeded`.
    orientation : {"keep", "free"}
        "free" gives the position alone with six joints or more, too: near a singularity of the
        wrist no joint values reach the pose.
    """
    require("model", model, Model)
    check_choice("orientation", orientation, ("keep", "free"))
    usual = limit is None and orientation == "keep"
    if model.kernel is not None and usual:
        quick = _by_kernel(model, q)
        if quick is not None:
            return quick
    about = model.about
    rows, _ = query_rows(q, about.joint_names, "joint values")
    check_joint_values(
        rows,
        about.joint_names,
        about.lower,
        about.upper,
        about.revolute,
        error=QueryError,
    )
    nominal = NominalTarget.of(model)
    if orientation == "free":
        nominal = replace(nominal, keeps_orientation=False)
    nearest, reachable = nominal.solve(rows)
    if limit is None:
        limits = usual_limit(model)
    else:
        limits = joint_numbers("limit", limit, about.joint_names, zero=False)
    return Corrected(rows, nearest, reachable, limits, nominal.notes, nominal)


def usual_limit(model: Model) -> Array:
    """Return the largest change of each joint that is trusted, (dof,) [rad or m].

    Three times the 95 % quantile of what correcting the motor map's own nodes changes; one
    limit for all joints that turn, another for those that slide.  It is found once.
    """
    if "limit" not in model.cache:
        q = visited_joints(model, CORRECTION.nodes)
        revolute = np.array(model.about.revolute)
        nearest, reachable = NominalTarget.of(model).solve(q)
        change = np.abs(nearest - q)[reachable]
        limits = np.full(len(revolute), CORRECTION.least)
        for kind in (revolute, ~revolute):
            if kind.any() and len(change):
                usual = float(np.quantile(change[:, kind].max(axis=1), 0.95))
                limits[kind] = max(CORRECTION.least, CORRECTION.usual * usual)
        model.cache["limit"] = limits.tolist()
    return np.array(model.cache["limit"])


_Shared = tuple[Array, tuple[str, ...], NominalTarget]
"""What all corrections of a model share: the limit, the notes, where the nominal arm would be."""


def _agreement(model: Model) -> _Shared | None:
    """What all corrections share, None where the compiled kernel corrects to another place."""
    kernel = model.kernel
    if kernel is None or not kernel.has("correct"):
        return None
    nominal = NominalTarget.of(model)
    compared = visited_joints(model, CORRECTION.compared_rows)
    gaps = []
    solutions = zip(compared, *nominal.solve(compared), strict=True)
    for q, nearest, reachable in solutions:
        answer = kernel.ask("correct", q)
        if reachable and answer is not None and answer[1] == 1:
            gaps.append(np.abs(answer[0] - nearest).max())
    # it may do so after adaptations
    if not gaps or max(gaps) > CORRECTION.tolerance:
        return None
    return usual_limit(model), nominal.notes, nominal


def _by_kernel(model: Model, q: ArrayLike) -> Corrected | None:
    """The correction of one row by the compiled kernel; None where the batch has to answer."""
    shared = remembered(model, "correcting", lambda: _agreement(model))
    kernel = model.kernel
    if shared is None or kernel is None:
        return None
    answer = kernel.ask("correct", q)
    if answer is None:
        return None
    nearest, sure = answer
    if sure != 1 and not model.strict:
        return None
    if sure == 1 and not model.answers_whole_range:
        inside = kernel.ask("forward", nearest[0])
        if inside is None or not inside[1]:
            return None
    # a strict model refuses instead of searching
    reachable = _REACHED if sure == 1 else _UNREACHED
    given = np.array([q], float)
    return Corrected(given, nearest, reachable, *shared)
