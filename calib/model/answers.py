"""Answers: the joint values with which a model answers targets, and steps of a servo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Index, Mask
from ..common.inputs import number_rows, query_rows
from ..common.rows import row_lengths
from ..errors import QueryError
from ..inverse.link_starts import solver_by_links
from ..inverse.newton import limit_joints, limit_length
from ..inverse.settings import SOLVER
from ..inverse.solutions import slices
from ..kernel.compiled import Flag
from ..samples.motion import Motion
from .compiled_queries import INVERSE, INVERSE_ALL, kernel_for
from .parts import PREDICTOR, ModelParts
from .turns import nearest_turn, on_turn


@dataclass(frozen=True)
class AnswerSettings:
    """When a target counts as reached, and the sizes of steps."""

    # of the workspace's extent, that always counts as reached
    reached: float = 1e-9
    # extents of the workspace: targets that are further away are limited
    furthest: float = 1e6
    # damping of a step of a servo, as a share of the Jacobian's power
    calm: float = 1e-3
    longest: float = 0.1  # of the joints' range: no step of a servo is longer
    budgets: int = 50  # so many budgets of steps has a search of a batch
    # targets whose branches fit into the processor's cache
    chunk: int = 20_000


ANSWER = AnswerSettings()


class Answer(NamedTuple):
    """Inverse answers, one row each."""

    # (n, dof) [rad or m], joint values; out of reach those that come nearest
    q: Array
    # (n, m) [unit, m in the base frame], where they put the tip, in the frame of the question
    position: Array
    distance: Array  # (n,) [as positions], from the target to that position
    # (n,) [as positions], 95 % bounds on the distance from that position to what the sensor will
    # read (a log) or to the true one (a simulation), and to the true one in the sensor's frame; in
    # the base frame both to the true one there
    expected_error: Array
    model_error: Array
    # (n,), whether the distance is within the expected error and within 1 % of the extent; in space
    # whether position and orientation are met
    reachable: Mask
    target: Index  # (n,), which question each answer belongs to, ascending
    # of poses: (n, 4) qx, qy, qz, qw in the frame of the question, and (n,) [rad] from the
    # orientation wanted, 0 where none was
    quaternion: Array | None = None
    turned: Array | None = None

    def rows(self, index: slice) -> Answer:
        """Some of the answers."""
        columns = (None if part is None else part[index] for part in self)
        return Answer._make(columns)


def unit_joints(
    model: ModelParts, x: Array, near: Array, readouts: Sequence[str]
) -> dict[str, Array]:
    """Joints of the unit box (n, dof) that answer targets (n, m), by readout."""
    target = limited_targets(model, x)
    joints: dict[str, Array] = {}
    for readout in readouts:
        if readout in (PREDICTOR, model.default_readout):
            joints[readout] = model.solver.solve(target, near)[0]
        elif readout == "body":
            solver = solver_by_links(model.association, model.body_predictor)
            joints[readout] = solver.solve(target, near)[0]
    of_links = [readout for readout in readouts if readout not in joints]
    if of_links:
        v = model.sensory.scale.to_unit(target)
        linked = model.association.inverses(v, near)
        for readout in of_links:
            joints[readout] = model.solver.newton.clip(linked[readout])
    return joints


def inverse(
    model: ModelParts, x: Array, near: ArrayLike | None, *, nearest: bool
) -> Array:
    """Joints (n, dof) for targets (n, m); NaN out of reach, or those that come `nearest`."""
    near_u = near_in_box(model, near, len(x))
    near_q = near_on_turn(model, near_u, near)
    kernel = kernel_for(model, INVERSE, len(x))
    if kernel is None:
        return _inverse_by_numpy(model, x, near_u, near_q, nearest)
    more = np.full((len(x), 1), ANSWER.budgets - 1.0)
    q, flags = kernel.rows(INVERSE.name, near_q, x, more)
    lost = flags == Flag.NONE
    if nearest:
        lost |= flags == Flag.UNREACHABLE
    rows = np.flatnonzero(lost)
    if len(rows):
        question = x[rows], near_u[rows], near_q[rows]
        q[rows] = _inverse_by_numpy(model, *question, nearest)
    return q


def _inverse_by_numpy(
    model: ModelParts, x: Array, near_u: Array, near_q: Array, nearest: bool
) -> Array:
    """The joints (n, dof) of `inverse`, nearest to `near_u`, on the turns nearest to `near_q`."""
    joints, within = joints_and_reach(model, x, near_u, bounded=not nearest)
    joints[~within] = np.nan
    return on_turn(model, joints, near_q)


def solve(
    model: ModelParts,
    x: Array,
    near: ArrayLike | None,
    readout: str = PREDICTOR,
) -> Answer:
    """Joints nearest to `near` for targets (n, m) in full; out of reach those that come nearest."""
    if readout == PREDICTOR:
        q = inverse(model, x, near, nearest=True)
        u = model.motor.scale.to_unit(q)
        return describe_joints(model, u, x)._replace(q=q)
    near_u = near_in_box(model, near, len(x))
    u = unit_joints(model, x, near_u, (readout,))[readout]
    return describe_joints(model, u, x, readout=readout)


def solve_all(model: ModelParts, x: Array) -> list[Answer]:
    """All branches of each target (n, m) in full, the nearest to the ranges' middle first."""
    every = every_branch(model, x)
    return [every.rows(rows) for rows in slices(every.target, len(x))]


def every_branch(model: ModelParts, x: Array) -> Answer:
    """All branches of targets (n, m), one after another."""
    solutions = model.solver.solve_all(limited_targets(model, x))
    return describe_joints(model, solutions.u, x, solutions.target)


def inverse_all(model: ModelParts, x: Array) -> list[Array]:
    """Joints (k, dof) of every branch of targets (n, m), the nearest to the middle first."""
    kernel = None  # families of redundant joints are NumPy's
    if not model.solver.redundant:
        kernel = kernel_for(model, INVERSE_ALL, len(x))
    if kernel is None:
        return [answer.q[answer.reachable] for answer in solve_all(model, x)]
    branches: list[Array] = []
    for first in range(0, len(x), ANSWER.chunk):
        goals = x[first : first + ANSWER.chunk]
        table, count = kernel.rows(INVERSE_ALL.name, goals)
        q = table[np.arange(table.shape[1]) < count[:, None]]
        target = np.repeat(np.arange(len(goals)), count)
        branches += [q[rows] for rows in slices(target, len(goals))]
    return branches


def joints_and_reach(
    model: ModelParts, x: Array, near: Array, *, bounded: bool = True
) -> tuple[Array, Mask]:
    """Nearest joint values (n, dof), and whether they reach the target (n,) if `bounded`."""
    u, distance = model.solver.solve(limited_targets(model, x), near)
    within = np.ones(len(u), dtype=bool)
    far = (distance > ANSWER.reached * model.solver.extent).nonzero()[0]
    if len(far) and bounded:
        # only the expected error can still call these reachable
        reach = _within_reach(model, model.bound_at(u[far]))
        within[far] = distance[far] <= reach
    return model.motor.scale.from_unit(u), within


def limited_targets(model: ModelParts, x: Array) -> Array:
    """Targets (n, m), those further than a million extents moved nearer in the same direction.

    The squares of larger numbers overflow.
    """
    limit = ANSWER.furthest * model.solver.extent
    size = np.abs(x)
    if size.max(initial=0.0) <= limit:
        return x
    limit += ANSWER.furthest * float(np.abs(model.sensory.scale.lower).max())
    furthest = size.max(axis=1, keepdims=True)
    return np.asarray(x / np.maximum(furthest / limit, 1.0))


def describe_joints(
    model: ModelParts,
    u: Array,
    x: Array,
    target: Index | None = None,
    readout: str = PREDICTOR,
) -> Answer:
    """Describe joints `u` (k, dof) of the unit box that answer targets `x` (n, m).

    target : (k,), which of them each answers; their order by default
    """
    if target is None:
        target = np.arange(len(x))
    position = model.positions_at(u, readout)
    # the distance of a target at 1e308 may be infinite
    with np.errstate(over="ignore"):
        distance = row_lengths(position - x[target])
    # a forged model's numbers may overflow: joints that are no numbers are not within reach
    finite = np.nan_to_num(u, posinf=0.0, neginf=0.0)
    reading_bound = model.bound_at(finite)
    same = model.model_bounds is model.bounds
    position_bound = reading_bound
    if not same:
        position_bound = model.bound_at(finite, "model_bounds")
    within = distance <= _within_reach(model, reading_bound)
    q = model.motor.scale.from_unit(u)
    return Answer(
        q, position, distance, reading_bound, position_bound, within, target
    )


def _within_reach(model: ModelParts, bound: Array) -> Array:
    """Distance (n,) to a target at which it counts as reached [unit]."""
    extent = model.solver.extent
    least = ANSWER.reached * extent
    return np.clip(bound, least, SOLVER.sure * extent)


def rows_for(
    values: ArrayLike, names: Sequence[str], what: str, n: int
) -> Array:
    """Rows (n, d) to go with `n` others; one may serve all."""
    rows, _ = query_rows(values, names, what)
    if len(rows) == n:
        return rows
    if len(rows) != 1:
        raise QueryError(
            f"{what} has {len(rows)} rows for {n}: give one or {n}"
        )
    return np.broadcast_to(rows, (n, len(names)))


def near_in_box(model: ModelParts, near: ArrayLike | None, n: int) -> Array:
    """Joints of the unit box that answers should be close to, (n, dof).

    The middle of the ranges where `near` is not given; values beyond a limit are clipped.
    """
    names = model.about.joint_names
    scale = model.motor.scale
    if near is None:
        return np.full((n, len(names)), 0.5)
    rows = rows_for(near, names, "near", n)
    u = (rows - scale.lower) / scale.span
    # an encoder may read a hair beyond a limit; a whole range beyond are other units
    away = np.abs(u - 0.5)
    if scale.goes_round:
        away[:, scale.periodic] = 0.0
    if away.max(initial=0.0) > 1.5:
        row, k = np.argwhere(away > 1.5)[0]
        raise QueryError(
            f"near has {names[k]} = {rows[row, k]:.6g}: expected a value in its range "
            f"{model.about.lower[k]:.6g} to {model.about.upper[k]:.6g}"
        )
    inside = np.minimum(np.maximum(u, 0.0), 1.0)
    if not scale.goes_round:
        return inside
    return np.where(scale.periodic, scale.to_unit(rows), inside)


def near_on_turn(
    model: ModelParts, near_u: Array, near: ArrayLike | None
) -> Array:
    """Joints (n, dof) [rad or m] of :func:`near_in_box`, on the turns nearest to `near`."""
    q = model.motor.scale.from_unit(near_u)
    if near is None or not model.motor.scale.goes_round:
        return q
    rows = rows_for(near, model.about.joint_names, "near", len(near_u))
    return nearest_turn(model, q, rows)


def motion_of(
    model: ModelParts, q: ArrayLike, approach: ArrayLike | None
) -> tuple[Motion, bool]:
    """The motion of a query, and whether it is a single row."""
    names = model.about.joint_names
    rows, single = number_rows(q, names, "joint values")
    if approach is None:
        return Motion(rows), single
    side = np.sign(rows_for(approach, names, "approach", len(rows)))
    return Motion(rows, side=side), single


def servo_step(
    model: ModelParts,
    measured: ArrayLike,
    target: ArrayLike,
    q: ArrayLike,
    gain: float,
) -> Array:
    """One step towards the targets; see :meth:`calib.Model.servo`."""
    if not 0.0 < gain <= 1.0:
        raise QueryError(
            f"gain {gain!r}: expected a share of the way, above 0 and up to 1"
        )
    joints, single = query_rows(q, model.about.joint_names, "q")
    place = rows_for(measured, model.axes, "measured position", len(joints))
    wanted = rows_for(target, model.axes, "target", len(joints))
    scale = model.motor.scale
    newton = model.solver.newton
    iterate = newton.at(scale.to_unit(joints), wanted)
    residual = gain * (wanted - place)
    step = newton.move(
        iterate._replace(residual=residual), np.full(len(joints), ANSWER.calm)
    )
    step = limit_length(limit_joints(step, SOLVER.longest), ANSWER.longest)
    result = scale.from_unit(newton.clip(iterate.u + step))
    return result[0] if single else result
