"""Planning: safe and most informative poses, in an order that moves the joints little.

Where a belief of the body is known, each pose shrinks the posterior most (D-optimal, Fedorov 1972;
for robots Borm and Menq 1991). Else they are as far apart as can (Gonzalez 1985).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import Arm, SpatialArm
from ..body.information import greedy, most_telling
from ..body.spatial import structure_of
from ..common.arrays import Array, Index, ReadOnly
from ..common.atomic import FilePath
from ..common.choices import EYES, check_choice
from ..common.inputs import whole
from ..common.rows import row_lengths
from ..common.scale import Scale
from ..common.wording import by_name
from ..errors import OptionError, require
from ..model.model import Model
from ..samples.tables import write_table
from .board_postures import board_postures
from .pose_space import PoseSpace, space_of, usable_postures
from .settings import PLANNING
from .target_postures import Candidates, at_point, whitened_jacobian

if TYPE_CHECKING:
    from ..recording.board import Pattern


@dataclass(frozen=True, eq=False)
class Plan(ReadOnly):
    """Poses to measure, in their order.

    Attributes
    ----------
    joint_names : tuple of str
        Names of the columns of `q`, base to tip.
    q : (n, dof) array [rad or m]
        Joint values to go to, one row after the other. Straight moves in joint space from
        row to row stay within the joints' ranges: a box is convex.
    x : (n, m) array [unit]
        Where the tip is expected, by the robot's description or by the model.
    expected_error : (n,) array [unit] or None
        The model's 95 % bound there; None without a model.
    start : (dof,) array [rad or m]
        Where the arm is expected to be before the first row.
    travel : (dof,) array [rad or m]
        Sum of each joint's moves, from the start on.
    length : float
        Sum over the moves of the largest share of its range by which a joint moves.
    unit : str
        Unit of the positions.
    why : tuple of str
        How the poses were chosen, in words.
    notes : tuple of str
        Notes for the user.
    """

    joint_names: tuple[str, ...]
    q: Array
    x: Array
    expected_error: Array | None
    start: Array
    travel: Array
    length: float
    unit: str
    why: tuple[str, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        """Summarise how many poses there are, how they were chosen, and what to look out for."""
        head = f"Plan of {', '.join(self.joint_names)}"
        return "\n  ".join([head, *self.why, *self.notes])

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.q)

    def columns(self) -> dict[str, Array]:
        """Columns of the plan's table: the joints' names, then what is expected.

        The positions are called `expected_x`, `expected_y` and in space `expected_z`, so that
        a plan is not taken for a log by mistake.
        """
        table = by_name(self.joint_names, self.q.T)
        table |= {
            f"expected_{axis}": x
            for axis, x in zip("xyz", self.x.T, strict=False)
        }
        if self.expected_error is not None:
            table["expected_error"] = self.expected_error
        return table

    def write(self, path: FilePath) -> None:
        """Write the table as CSV, or Parquet by its name, whole or not at all."""
        write_table(path, self.columns())


def plan(
    source: Arm | Model,
    n: int = 60,
    *,
    seed: int = 0,
    margin: float | Sequence[float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    start: ArrayLike | None = None,
    touch: Sequence[float] | None = None,
    handeye: Pattern | str | bool | None = None,
    eye: str = "hand",
    above: float | None = None,
) -> Plan:
    """Plan poses to measure with a real arm.

    Parameters
    ----------
    source : Arm or Model
        An arm that is to be measured for the first time, or a model that is to be improved
        or checked.
    n : int
        How many poses.
    seed : int
        The same seed gives the same poses.
    margin : float or sequence of float, optional [rad or m]
        Distance from the joints' mechanical limits, for all or for each joint; see
        :func:`calib.use.pose_space.space_of` for the default.
    ranges : mapping of str to (lower, upper), optional [rad or m]
        Part of a joint's range to plan in.
    start : (dof,) array [rad or m], optional
        Where the arm is before the first pose: zero, clipped into the ranges, where not given.
    touch : (x, y, z), optional [m]
        A point in the base frame that the tip touches in all poses.
    handeye, eye : Pattern or str, {"hand", "base"}, optional
        A board that a camera is to see in all poses, from many sides, as `handeye` takes them.
        At `start` it is in the middle of the picture; the camera in the hand looks along the z
        axis of the tip's frame, or the print faces along it, to some 10 deg.  True for a model of
        pictures of a board, which knows both.
    above : float, optional [m]
        Height in the base frame that the tip and all joints stay above, such as a table's.

    Returns
    -------
    Plan

    Raises
    ------
    OptionError
        If an argument is outside of what is possible.

    Examples
    --------
    >>> import calib
    >>> plan = calib.plan(calib.load_arm("two_link"), 30)
    >>> plan.q.shape, plan.length < 0.25 * 30
    ((30, 2), True)
    """
    n = whole("n", n, 1, PLANNING.most)
    rng = np.random.default_rng(whole("seed", seed, 0, 2**63 - 1))
    if not isinstance(source, Arm):
        require("source", source, Model)
    check_choice("eye", eye, EYES)
    if above is not None and not np.isfinite(above):
        raise OptionError(f"above {above!r}: expected a height [m]")
    if touch is not None and handeye is not None:
        raise OptionError("expected one of `touch` and `handeye`")
    space = space_of(source, margin, ranges)
    begin = space.start(start)

    # postures that serve the purpose, without those that cannot be measured
    if touch is not None:
        candidates = at_point(source, space, touch, rng)
    elif handeye is not None:
        posture = None if start is None else begin
        candidates = board_postures(source, space, handeye, eye, posture, rng)
    else:
        candidates = all_over(source, space, rng)
    usable, notes = usable_postures(source, candidates.q, above)
    q = candidates.q[usable]
    if len(q) < n:
        allowed = f"{n} poses: {len(q)} are within the limits"
        if above is not None:
            allowed += f" and above {above:g} m"
        raise OptionError(f"{allowed}; ask for fewer, or allow more")

    # the most informative ones, on a short way
    chosen = q[candidates.most_informative(q, n)]
    postures = np.vstack([begin, chosen])
    # by the span alone: the upper end of a whole turn is not its lower end to a cable
    shares = np.abs(postures[:, None] - postures[None]) / space.scale.span
    route = postures[shortest_tour(shares.max(axis=-1))]
    why = f"{n} poses, {candidates.why}"
    return _plan_of_route(source, space, route, why, notes)


def _plan_of_route(
    source: Arm | Model,
    space: PoseSpace,
    route: Array,
    why: str,
    notes: Sequence[str],
) -> Plan:
    """The plan of postures (n + 1, dof), the start first, with what is expected at them."""
    q = route[1:]
    moves = np.abs(np.diff(route, axis=0))
    shares = moves / space.scale.span
    expected_error = None
    unit = "m"
    if not isinstance(source, Arm):
        expected_error = source.expected_error(q)
        unit = source.about.unit
    return Plan(
        space.joint_names,
        q,
        source.forward(q),
        expected_error,
        start=route[0],
        travel=moves.sum(axis=0),
        length=float(shares.max(axis=1).sum()),
        unit=unit,
        why=(why,),
        notes=tuple(notes),
    )


def all_over(
    source: Arm | Model, space: PoseSpace, rng: np.random.Generator
) -> Candidates:
    """Postures all over the ranges, of which the most informative are chosen."""
    q = space.candidates(rng)
    if isinstance(source, SpatialArm):
        # never measured: the prior alone counts
        structure = structure_of(source, "rigid")
        frame = ("view.rotation", "view.shift", "tool")
        groups = (*frame, "placement", "offset", "elastic", "curve")
        beta = structure.neutral()

        def most_informative(q: Array, count: int) -> Index:
            """The postures (count,) of some (n, dof) that are most informative about the arm."""
            by_pose = whitened_jacobian(
                structure, beta, q, groups, PLANNING.noise
            )
            return greedy(by_pose, count)

        return Candidates(
            q, most_informative, "chosen to determine the arm best"
        )
    body = None if isinstance(source, Arm) else source.body
    if body is None or body.simulated:  # exact samples leave nothing to learn
        apart = partial(farthest, space.scale)
        return Candidates(q, apart, "as far from each other as possible")
    telling = partial(most_telling, body)
    return Candidates(
        q, telling, "chosen to reduce the model's uncertainty most"
    )


def farthest(scale: Scale, q: Array, n: int) -> Index:
    """Choose poses one by one, each as far as possible from all that were chosen before.

    q : (m, dof), what to choose from
    Returns (n,), rows of `q`, in the order of choice, from the first row on.
    """
    u = scale.to_unit(q)
    distances = np.full(len(q), np.inf)
    chosen = np.empty(n, np.intp)
    for k in range(n):
        row = int(distances.argmax())
        chosen[k] = row
        distances = np.minimum(
            distances, row_lengths(scale.difference(u, u[row]))
        )
        distances[row] = -1.0  # where points repeat, none is chosen twice
    return chosen


def shortest_tour(distances: Array) -> Index:
    """Order points so that the way from the first one through all others is short.

    Nearest neighbours first, then 2-opt (Croes 1958: a stretch is turned round) until it gains
    nothing. The way does not return to its start.

    distances : (n, n), symmetric; the way starts at row 0
    Returns (n,), a permutation that begins with 0.
    """
    n = len(distances)
    order = np.zeros(n, np.intp)
    waiting = np.arange(n) > 0
    for k in range(1, n):
        order[k] = np.where(waiting, distances[order[k - 1]], np.inf).argmin()
        waiting[order[k]] = False
    gained = True
    while gained:
        gained = False
        for i in range(1, n - 1):
            before = order[i - 1]
            first = order[i]
            ends = order[i + 1 :]
            # of the ways before-first .. end-next and before-end .. first-next
            gain = distances[before, first] - distances[before, ends]
            gain[:-1] += (
                distances[ends[:-1], ends[1:]] - distances[first, ends[1:]]
            )
            j = int(gain.argmax())
            if gain[j] > 1e-12:
                order[i : i + j + 2] = order[i : i + j + 2][::-1]
                gained = True
    return order
