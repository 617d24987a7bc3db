"""Correcting: joint values that bring the real arm to where the nominal one would be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..change.alignment import Alignment
from ..errors import OptionError, QueryError

if TYPE_CHECKING:
    from ..arm.planar_arm import PlanarArm
    from ..model.model import Model

Array = NDArray[np.float64]


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
    """

    q: Array
    target: Array
    distance: Array
    expected_error: Array
    reachable: NDArray[np.bool_]


def correct(model: Model, q: ArrayLike) -> Corrected:
    """Compensate for what the nominal kinematics do not know.

    A controller that trusts its URDF commands `q` to bring the tip to a place.  The real
    arm gets there with other joint values: those for which the learned map says that
    place, nearest to `q`.

    Parameters
    ----------
    model : Model
        Learned of or adapted to the real arm; it must bear a URDF.
    q : (n, dof) or (dof,) array [rad or m]
        Joint values that are right for the nominal arm.

    Notes
    -----
    Places are compared in the sensor's frame.  Where an adaptation found that the sensor's
    own frame differs from the URDF's plane (and that this explains most of the change) the
    nominal place is moved into it first; otherwise the two are taken to be the same.
    """
    arm = nominal_arm(model)
    rows = np.atleast_2d(np.asarray(q, dtype=float))
    if rows.shape[1] != arm.dof:
        raise QueryError(
            f"joint values of shape {np.shape(q)}: expected ({arm.dof},) or (n, {arm.dof}), one "
            f"column each for {', '.join(arm.joint_names)}"
        )
    target = arm.forward(rows)
    for frame in frames(model):
        target = frame.apply(target)
    near = np.clip(rows, model.about.lower, model.about.upper)
    answer = model.solve(target, near)
    return Corrected(
        np.where(answer.reachable[:, None], answer.q, np.nan),
        target,
        answer.distance,
        answer.expected_error,
        answer.reachable,
    )


def nominal_arm(model: Model) -> PlanarArm:
    """The arm as its URDF describes it."""
    from ..arm.loading import arm_from_urdf

    about = model.about
    if not about.urdf:
        raise OptionError(
            "the model bears no URDF, so there is no nominal arm to correct: train it with "
            "a robot, or with a robot and a log"
        )
    return arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked)


def frames(model: Model) -> list[Alignment]:
    """How the sensor's frame moved, adaptation after adaptation."""
    return [Alignment.from_json(e["frame"]) for e in model.history if e.get("frame") is not None]
