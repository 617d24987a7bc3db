"""Planning: safe poses to measure, well spread, in an order that moves the joints little."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.arm import Arm, SpatialArm
from ..body.most_telling import greedy, most_telling
from ..common.arrays import Array, Index
from ..common.checks import whole
from ..common.choices import EYES
from ..common.frozen import ReadOnly
from ..common.rows import thinned
from ..errors import OptionError
from ..samples.tables import write_table
from .aimed import Choose, at_point, in_sight
from .collisions import apart, in_picture
from .pose_space import PoseSpace, space_of
from .spread import candidate_poses, farthest, length, shortest_tour, tells

if TYPE_CHECKING:
    import os

    from ..model.model import Model
    from ..recording.board import Board
    from ..samples.samples import Samples

_MOST_POSES = 1000
"""More are babbled, not planned."""

_CHOICE, _CORNERS = 2500, 256  # poses that a posterior chooses from, the corners among them
_ORDERS = 100  # random ones, to compare with


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
    x : (n, 2) array [unit]
        Where the tip is expected, by the robot's description or by the model.
    expected_error : (n,) array [unit] or None
        The model's 95 % bound there; None without a model.
    start : (dof,) array [rad or m]
        Where the arm is expected to be before the first row.
    travel : (dof,) array [rad or m]
        Sum of each joint's moves, from the start on.
    length, random_length : float
        Sum over the moves of the largest share of its range by which a joint moves; for
        this order, and for the same poses in a random one.
    unit : str
        Unit of the positions.
    why : tuple of str
        How the poses were chosen and ordered, in words.
    notes : tuple of str
        What the user should be told.
    """

    joint_names: tuple[str, ...]
    q: Array
    x: Array
    expected_error: Array | None
    start: Array
    travel: Array
    length: float
    random_length: float
    unit: str
    why: tuple[str, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.q)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of the plan's table: the joints' names, then what is expected.

        The positions are called `expected_x`, `expected_y` and in space `expected_z`, so that
        a plan is not taken for a log by mistake.
        """
        axes = zip("xyz", self.x.T, strict=False)
        table: dict[str, NDArray[Any]] = {f"expected_{axis}": values for axis, values in axes}
        if self.expected_error is not None:
            table["expected_error"] = self.expected_error
        for name in self.joint_names:
            if name in table:
                raise OptionError(
                    f"a joint named {name!r} cannot be told from the plan's own column"
                )
        return {**dict(zip(self.joint_names, self.q.T, strict=True)), **table}

    def write(self, path: str | os.PathLike[str]) -> None:
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
    measured: Samples | None = None,
    touch: Sequence[float] | None = None,
    handeye: Board | str | bool | None = None,
    eye: str = "hand",
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
    measured : Samples, optional
        What was measured already: the new poses go where those are not.
    touch : (x, y, z), optional [m]
        A point in the base frame that the tip is to touch from all poses: those that tell most.
    handeye, eye : Board or str, {"hand", "base"}, optional
        A board that a camera is to see in all poses, from many sides, as `handeye` takes them.
        At `start` it is in the middle of the picture; the camera in the hand looks along the z
        axis of the tip's frame, or the print faces along it, to some 10 deg.  True for a model of
        pictures of a board, which knows both.

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
    >>> plan.q.shape, plan.length < 0.5 * plan.random_length
    ((30, 2), True)
    """
    n, seed = whole("n", n, 1, _MOST_POSES), whole("seed", seed, 0, 2**63 - 1)
    space = space_of(source, margin, ranges)
    rng = np.random.default_rng(seed)
    taken = _taken(space, measured)
    first = space.start(start)
    # not `to_unit`: the upper end of a whole turn is not its lower end to a cable
    begin = (first - space.scale.lower) / space.scale.span
    if touch is not None or handeye is not None:
        if measured is not None or (touch is not None and handeye is not None):
            raise OptionError("expected one of `touch`, `handeye` and `measured`")
        if touch is not None:
            at = ", ".join(f"{value:g}" for value in np.ravel(touch))
            how = f"the tip at ({at}) m in the base frame, chosen to tell most of the arm"
            q, tell = at_point(source, space, touch, rng)
        else:
            if eye not in EYES:
                raise OptionError(f"eye {eye!r}: expected one of {', '.join(EYES)}")
            how = "the board in the picture from many sides, chosen to tell most of the camera"
            where = None if start is None else first
            q, tell = in_sight(source, space, handeye or False, eye, where, rng)
        points = (q - space.scale.lower) / space.scale.span
        choose = partial(_most_telling, space, tell)
        points, safe = apart(source, space, points)
        notes, beside = [safe], ""
        if len(points) < n:
            raise OptionError(f"n {n}: {len(points)} poses were found, expected fewer to choose")
    else:
        choose, how, beside = _choice(source, space)
        points, safe = apart(source, space, candidate_poses(space, rng))
        points, outside = in_picture(source, space, points)
        notes = [safe, *outside]
        if measured is None and not isinstance(source, Arm) and choose.func is farthest:
            notes.append(
                "the model keeps no samples: give the log too, so that the new poses lie between "
                "the measured ones"
            )
    if measured is not None:
        how += f" {beside} the {len(measured)} measured ones"
    nodes = np.vstack([begin, points[choose(points, n, taken)]])
    away = np.abs(nodes[:, None] - nodes[None]).max(axis=-1)
    order = shortest_tour(away)
    u = nodes[order[1:]]
    # rounding must not lead beyond a limit
    q = np.clip(space.scale.from_unit(u), space.lower, space.upper)
    way = np.vstack([space.scale.from_unit(begin), q])
    rng = np.random.default_rng(0)
    others = [length(away, np.append(0, 1 + rng.permutation(n))) for _ in range(_ORDERS)]
    low, high = space.corners
    border = (np.isclose(u, low) | np.isclose(u, high)).any(axis=1)
    moves, ends = np.abs(np.diff(way, axis=0)), np.count_nonzero(border)
    return Plan(
        space.joint_names,
        q,
        source.forward(q),
        None if isinstance(source, Arm) else source.expected_error(q),
        start=way[0],
        travel=moves.sum(axis=0),
        length=float((moves / space.scale.span).max(axis=1).sum()),
        random_length=float(np.mean(others)),
        unit="m" if isinstance(source, Arm) else source.about.unit,
        why=(f"{n} poses, {how}; {ends} of them at an end of a joint's range",),
        notes=tuple(notes),
    )


def _choice(source: Arm | Model, space: PoseSpace) -> tuple[partial[Index], str, str]:
    """How poses are chosen, and what is said of it: by information where a belief is known."""
    if isinstance(source, SpatialArm):  # never measured: the prior says what is not known
        choose = partial(_most_telling, space, lambda q, n, t: greedy(tells(source, q, t), n))
        return choose, "chosen to determine the arm best", "beside"
    body = None if isinstance(source, Arm) else source.body
    if body is not None and not body.simulated:  # exact samples leave nothing to learn
        how = "chosen to reduce the model's uncertainty most"
        return partial(_most_telling, space, partial(most_telling, body)), how, "beside"
    return partial(farthest, space.scale), "as far from each other as possible", "and from"


def _most_telling(space: PoseSpace, tell: Choose, points: Array, n: int, taken: Array) -> Index:
    """Points (k, dof) in units of the joints' ranges that inform a belief most."""
    few = every = np.arange(len(points))
    if len(points) > _CHOICE:  # corners come first
        few = np.unique(np.append(every[:_CORNERS], thinned(len(points), _CHOICE)))
    few = few if len(few) >= n else every
    joints = space.scale.from_unit(points[few])
    return few[tell(joints, n, space.scale.from_unit(taken))]


def _taken(space: PoseSpace, measured: Samples | None) -> Array:
    """Joints (k, dof) of measured rows in units of the joints' ranges."""
    if measured is None:
        return np.zeros((0, len(space.joint_names)))
    if sorted(measured.joint_names) != sorted(space.joint_names):
        raise OptionError(
            f"the measured rows have the joints {', '.join(measured.joint_names)}, expected "
            f"{', '.join(space.joint_names)}"
        )
    columns = [measured.joint_names.index(name) for name in space.joint_names]
    return space.scale.to_unit(measured.q[:, columns])
