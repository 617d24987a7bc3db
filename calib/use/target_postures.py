"""Target postures: damped Newton steps bring random postures to a point, or to poses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..body.information import greedy
from ..body.sensor_pose import without_sensor
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array, Index
from ..common.inputs import number_rows
from ..common.scale import Scale
from ..errors import OptionError
from ..inverse.newton import Newton
from ..model.model import Model
from .pose_space import PoseSpace
from .settings import AIMING, PLANNING


@dataclass(frozen=True)
class Candidates:
    """Postures to choose from."""

    q: Array  # (m, dof) [rad or m]
    # rows (count,) of the most informative ones of postures (k, dof)
    most_informative: Callable[[Array, int], Index]
    why: str  # how they are chosen, for people


@dataclass(frozen=True)
class _Aim:
    """What an arm's sensor reads, as a task for Newton's steps."""

    structure: SpatialStructure
    beta: Array  # (d,)
    scale: Scale  # the joints' unit box
    count: int  # of outputs
    size: float = 1.0  # of the workspace, in which a miss is measured

    def residual(self, u: Array, target: Array) -> tuple[Array, Array]:
        """Residuals (n, m) and their derivatives by the unit coordinates (n, m, dof)."""
        q = self.scale.from_unit(u)
        value, slope = self.structure.predict_and_slope(q, self.beta)
        return self.structure.residual(target, value), slope * self.scale.span


def joints_towards(
    structure: SpatialStructure,
    beta: Array,
    q: Array,
    target: Array,
    space: PoseSpace,
) -> tuple[Array, Array]:
    """Joints (n, dof) within their limits near targets (n, m), and their distance (n,)."""
    turning = np.zeros(structure.dof, bool)
    scale = Scale(space.lower, space.upper - space.lower, turning)
    newton = Newton(_Aim(structure, beta, scale, target.shape[1]), scale)
    iterate = newton.refine(scale.to_unit(q), target, 0.1 * AIMING.near)
    return scale.from_unit(iterate.u), iterate.distance


def at_point(
    source: Arm | Model,
    space: PoseSpace,
    point: Sequence[float],
    rng: np.random.Generator,
) -> Candidates:
    """Postures whose tip is at a point (3,) of the arm's base frame [m].

    Where the point is, is not known.  Raises OptionError if none is found.
    """
    structure, beta = chain_in_base(source)
    axes = ("x", "y", "z")
    rows, _ = number_rows(np.ravel(point), axes, "touch", OptionError)
    target = rows[0]
    start = rng.uniform(space.lower, space.upper, (AIMING.draws, structure.dof))
    targets = np.tile(target, (AIMING.draws, 1))
    q, distance = joints_towards(structure, beta, start, targets, space)
    q = q[distance < AIMING.near][: AIMING.most]
    at = ", ".join(f"{value:g}" for value in target)
    if not len(q):
        raise OptionError(
            f"touch {at}: no posture within the limits "
            "reaches this point of the base frame [m]; give another"
        )
    body = None if isinstance(source, Arm) else source.body

    def most_informative(q: Array, count: int) -> Index:
        """The postures (count,) of some (n, dof) that are most informative about the arm."""
        if body is None:
            groups = ("tool", "placement", "offset")
            tip = whitened_jacobian(structure, beta, q, groups, AIMING.play)
        else:
            slope = structure.linearise(q, beta, body.active)[1]
            tip = slope @ body.root / AIMING.play
        # of the point's own coordinates
        place = PLANNING.widest / AIMING.play * np.eye(3)
        places = np.broadcast_to(place, (len(q), 3, 3))
        return greedy(np.concatenate([tip, places], axis=2), count)

    why = (
        f"the tip at ({at}) m in the base frame, chosen to tell most of the arm"
    )
    return Candidates(q, most_informative, why)


def chain_in_base(source: Arm | Model) -> tuple[SpatialStructure, Array]:
    """The chain in space of an arm or a model's body in the base frame, and its parameters (d,).

    Raises OptionError if there is none.
    """
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "base")
        return structure, structure.neutral()
    body = None if isinstance(source, Arm) else source.body
    if body is None or not isinstance(body.structure, SpatialStructure):
        raise OptionError(
            "expected a robot that moves in space, or a model of one"
        )
    return without_sensor(body.structure, body.beta)


def whitened_jacobian(
    structure: SpatialStructure,
    beta: Array,
    q: Array,
    groups: Sequence[str],
    noise: float,
) -> Array:
    """Return the derivative (n, m, k) of readings by k parameters, both divided by their sd.

    q : (n, dof), joint values [rad or m]
    groups : of the parameters; their sd is that of the prior, where a plan does not limit it
    noise : sd of a reading [unit]
    """
    prior = structure.prior(groups)
    sd = np.minimum(prior.sd, PLANNING.widest)
    slope = structure.linearise(q, beta, prior.active)[1]
    return slope * sd[prior.active] / noise
