"""Aimed poses: postures at one point, and poses that keep a board in a camera's picture.

Random postures are led to where they are aimed by damped Newton steps; those that arrive are what
a plan chooses from.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..common.inputs import number_rows
from ..common.scale import Scale
from ..errors import OptionError
from ..inverse.newton import Newton
from ..model.model import Model
from ..recording.board import Pattern, parse_board
from .board_view import BoardView, view_of_arm, view_of_body
from .pose_space import PoseSpace
from .settings import AIMING, PLANNING
from .whitened import whitened_jacobian

Aimed = tuple[Array, Array]
"""Postures (m, dof) [rad or m] to choose from, and directions (m, p, k) in which each tells.

Directions are in units of the noise and of the prior.
"""


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


def _joints_towards(
    structure: SpatialStructure,
    beta: Array,
    q: Array,
    target: Array,
    space: PoseSpace,
) -> tuple[Array, Array]:
    """Joints (n, dof) within their limits near targets (n, m), and their distance (n,)."""
    turning = np.zeros(structure.dof, dtype=bool)
    scale = Scale(space.lower, space.upper - space.lower, turning)
    newton = Newton(_Aim(structure, beta, scale, target.shape[1]), scale)
    stand = newton.refine(scale.to_unit(q), target, 0.1 * AIMING.near)
    return scale.from_unit(stand.u), stand.miss


def at_point(
    source: Arm | Model,
    space: PoseSpace,
    point: Sequence[float],
    rng: np.random.Generator,
) -> Aimed:
    """Return postures whose tip is at a point (3,) of the arm's base frame [m].

    Where the point is, is not known.  Raises OptionError if none is found.
    """
    structure, beta = _chain_in_base(source)
    target = number_rows(
        np.ravel(point), ("x", "y", "z"), "touch", OptionError
    )[0][0]
    start = rng.uniform(space.lower, space.upper, (AIMING.drawn, structure.dof))
    targets = np.tile(target, (AIMING.drawn, 1))
    q, distance = _joints_towards(structure, beta, start, targets, space)
    q = q[distance < AIMING.near][: AIMING.most]
    if not len(q):
        raise OptionError(
            f"touch {', '.join(f'{value:g}' for value in target)}: no posture within the limits "
            "reaches this point of the base frame [m]; give another"
        )
    body = None if isinstance(source, Arm) else source.body
    if body is None:
        groups = ("tool", "placement", "offset")
        tip = whitened_jacobian(structure, beta, q, groups, AIMING.play)
    else:
        slope = structure.linearise(q, beta, body.active)[1]
        tip = slope @ body.root / AIMING.play
    # of the point's own coordinates
    place = PLANNING.widest / AIMING.play * np.eye(3)
    places = np.broadcast_to(place, (len(q), 3, 3))
    return q, np.concatenate([tip, places], axis=2)


def _chain_in_base(source: Arm | Model) -> tuple[SpatialStructure, Array]:
    """The chain in space of an arm, or of a model's body, in the base frame; its parameters (d,).

    Raises OptionError if there is none.
    """
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "base")
        return structure, structure.neutral()
    body = None if isinstance(source, Arm) else source.body
    if body is None or not isinstance(body.structure, SpatialStructure):
        raise OptionError(
            "`touch`: expected a robot that moves in space, or a model of one"
        )
    return body.structure.with_sensor(view="base"), body.beta


def in_sight(
    source: Arm | Model,
    space: PoseSpace,
    board: Pattern | str | bool,
    eye: str,
    start: Array | None,
    rng: np.random.Generator,
) -> Aimed:
    """Return postures in which a camera sees all of a board, from many sides.

    Of a model of pictures of a board, camera and board are known.  Of an arm the camera in the hand
    looks along the tip's z axis, or the board's print faces along it, and at the posture `start`
    (dof,) it sees the board in the middle of its picture; all that more or less.
    Raises OptionError if fewer than three are found.
    """
    view = _board_view(source, board, eye, start)
    readings = view.readings(rng)
    shape = (AIMING.drawn, view.structure.dof)
    begin = rng.uniform(space.lower, space.upper, shape)
    if start is not None:
        begin[: AIMING.drawn // 2] = start
    q, _ = _joints_towards(view.structure, view.beta, begin, readings, space)
    q = np.unique(q[view.sees(q)].round(4), axis=0)
    q = q[rng.permutation(len(q))[: AIMING.most]]
    if len(q) < 3:
        raise OptionError(
            f"handeye: the camera sees the board in {len(q)} of the postures about the start; "
            "give `start` where it does, further from the joints' limits"
        )
    return q, view.directions(q)


def _board_view(
    source: Arm | Model,
    board: Pattern | str | bool,
    eye: str,
    start: Array | None,
) -> BoardView:
    """The camera and the board that `in_sight` describes."""
    if isinstance(source, SpatialArm):
        if isinstance(board, bool) or start is None:
            raise OptionError(
                "handeye: expected the board and `start`, joint values at which the camera sees it "
                "in the middle of its picture"
            )
        size = np.array(parse_board(board).size)
        return view_of_arm(source, size, eye == "hand", start)
    if isinstance(source, Model) and source.body is not None:
        described = source.about.options.get("board")
        if described is not None:
            return view_of_body(source.body, described)
    raise OptionError(
        "handeye: expected a robot that moves in space, or a model that `calib handeye -o` made"
    )
