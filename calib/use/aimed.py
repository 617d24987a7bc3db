"""Aimed poses: postures at one point, and poses that keep a board in a camera's picture.

Random postures are led to where they are aimed by damped Newton steps; those that arrive are what
a plan chooses from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rotations import exponential, logarithm
from ..body.belief import Body
from ..body.corners import Corners
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..common.rows import number_rows
from ..common.scale import Scale
from ..errors import OptionError
from ..inverse.newton import Newton
from ..model.model import Model
from ..recording.board import Board
from .pose_space import PoseSpace

Told = Callable[[Array], Array]
"""Directions (m, p, k) in which postures (m, dof) tell, in units of noise and of the prior."""

# postures that are led, and those of them to choose from
_DRAWN = 3000
_KEPT = 400
_NEAR = 1e-6  # [m] within which a posture is at its point
_PLAY = 1e-4  # [m] of a socket
_WIDE = 10.0  # [m or rad] of what is not known at all
# of a common camera [px]
_LENS = (900.0, 640.0, 360.0, 0.0)
_PICTURE = (1280.0, 720.0)
_PIXEL = 0.2  # [px] of a corner
# share of the picture that the board fills, and that stays free
_FILLED = 0.25
_EDGE = 0.05
# the camera's tilt and distance, of the first one
_TILTED = np.radians(45.0)
_NEARER = (0.7, 1.4)
# a camera that stands elsewhere and points elsewhere than said [m, rad], and the board's tilt; so
# many cameras, and the share of them that must see the board
_ASIDE = np.array([[0.04], [0.13], [0.1]])
_LIKELY = 32
_SURE = 0.95
_UPRIGHT = 0.5  # least cosine between the line of sight and the board's normal


@dataclass(frozen=True)
class _Aim:
    """What an arm's sensor reads, as a task for Newton's steps."""

    structure: SpatialStructure
    beta: Array
    scale: Scale

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Readings (n, m) and their derivatives by the unit coordinates (n, m, dof)."""
        seen, slope = self.structure.predict_and_slope(
            self.scale.from_unit(u), self.beta
        )
        return seen, slope * self.scale.span

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, m)."""
        return self.structure.residual(target, value)

    def spare(self, target: Array, dof: int) -> bool:
        """Whether there are more joints than numbers in a target."""
        return bool(dof > target.shape[1])


def _led(
    structure: SpatialStructure, beta: Array, q: Array, target: Array, space: PoseSpace
) -> tuple[Array, Array]:
    """Joints (n, dof) led to targets (n, m) within their limits, and how far they are off (n,)."""
    scale = Scale(
        space.lower, space.upper - space.lower, np.zeros(structure.dof, dtype=bool)
    )
    newton = Newton(_Aim(structure, beta, scale), scale, extent=1.0)
    u, off = newton.refine(scale.to_unit(q), target, 0.1 * _NEAR)
    return scale.from_unit(u), off


def at_point(
    source: Arm | Model,
    space: PoseSpace,
    point: Sequence[float],
    rng: np.random.Generator,
) -> tuple[Array, Told]:
    """Postures (m, dof) whose tip is at a point (3,) of the arm's base frame [m], as varied as can.

    Returns also what they tell; where the point is, is not known.
    Raises OptionError if none is found.
    """
    body = None if isinstance(source, Arm) else source.body
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "base")
        prior = structure.prior(("tool", "placement", "offset"))
        beta = structure.neutral()
        active = prior.active
        root = np.diag(np.minimum(prior.sd[prior.active], _WIDE))
    elif body is not None and isinstance(body.structure, SpatialStructure):
        structure = body.structure.with_view("base")
        beta = body.beta
        active = body.active
        root = body.root
    else:
        raise OptionError(
            "touch: expected a robot that moves in space, or a model of one"
        )
    target = number_rows(np.ravel(point), ("x", "y", "z"), "touch", OptionError)[0][0]
    start = rng.uniform(space.lower, space.upper, (_DRAWN, structure.dof))
    q, off = _led(structure, beta, start, np.tile(target, (_DRAWN, 1)), space)
    q = q[off < _NEAR][:_KEPT]
    if not len(q):
        raise OptionError(
            f"touch {', '.join(f'{value:g}' for value in target)}: no posture within the limits "
            "reaches this point of the base frame [m]; give another"
        )

    def told(q: Array) -> Array:
        tip = structure.linearise(q, beta, active)[1] @ root
        place = np.broadcast_to(_WIDE * np.eye(3), (len(q), 3, 3))
        return np.concatenate([tip, place], axis=2) / _PLAY

    return q, told


def in_sight(
    source: Arm | Model,
    space: PoseSpace,
    board: Board | str | bool,
    eye: str,
    start: Array | None,
    rng: np.random.Generator,
) -> tuple[Array, Told]:
    """Postures (m, dof) in which a camera sees all of a board, from many sides.

    Of a model of pictures of a board, camera and board are known.  Of an arm the camera in the hand
    looks along the tip's z axis, or the board's print faces along it, and at the posture `start`
    (dof,) it sees the board in the middle of its picture; all that more or less, see `_likely`.
    Returns also what they tell of what is in the hand.
    Raises OptionError if fewer than three are found.
    """
    made: Any = None if isinstance(source, Arm) else source.about.options.get("board")
    spec: Any = board
    lens = _LENS
    picture = np.array(_PICTURE)
    in_hand = eye == "hand"
    if made is not None and isinstance(source, Model) and source.body is not None:
        known: Any = source.body.structure
        spec = made["board"]
        picture = np.array(made["size"])
        in_hand = made["eye"] == "hand"
        structure = known.with_view("pose")
        likely = [_encoded(source.body, made)]
        lens = likely[0][structure.groups["lens"]]
    elif not isinstance(source, SpatialArm):
        raise OptionError(
            "handeye: expected a robot that moves in space, or a model that `calib handeye -o` made"
        )
    elif isinstance(board, bool) or start is None:
        raise OptionError(
            "handeye: expected the board and `start`, joint values at which the camera sees it "
            "in the middle of its picture"
        )
    size = np.array(Board.parse(spec).size)
    away = (
        lens[0] * size.max() / (_FILLED * picture[0])
    )  # so far the board fills its share
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "pose", lens=_LENS)
        likely = _likely(structure, np.array(start), in_hand, away, rng)
    beta = likely[0]
    groups = structure.groups
    # the camera about the board: tilted to any side, rolled, nearer and further, aimed beside it
    tilt = _TILTED * np.sqrt(rng.random(_DRAWN))
    side = rng.uniform(-np.pi, np.pi, _DRAWN)
    turn = exponential(
        np.stack([tilt * np.cos(side), tilt * np.sin(side), 0 * tilt], axis=1)
    )
    shift = -(away * rng.uniform(*_NEARER, _DRAWN))[:, None] * turn[:, :, 2]
    roll = np.column_stack(
        [rng.normal(0, 0.1, (_DRAWN, 2)), rng.uniform(-2, 2, _DRAWN)]
    )
    turn = turn @ exponential(roll)
    if not in_hand:  # the same seen from the camera
        turn = np.swapaxes(turn, 1, 2)
        shift = -np.einsum("nij,nj->ni", turn, shift)
    begin = rng.uniform(space.lower, space.upper, (_DRAWN, structure.dof))
    if start is not None:
        begin[: _DRAWN // 2] = start
    q, _ = _led(
        structure, beta, begin, np.concatenate([shift, logarithm(turn)], axis=1), space
    )
    seen = Corners(structure.viewpoint, in_hand)
    camera = structure.with_view("pose", unit="px").changed(others=(seen,), place=1)
    corners = np.column_stack(
        [0.5 * size * ((-1, -1), (-1, 1), (1, -1), (1, 1)), np.zeros(4)]
    )

    def rows(q: Array) -> Array:
        return np.column_stack([np.repeat(q, 4, axis=0), np.tile(corners, (len(q), 1))])

    shown = np.zeros(len(q))
    for each in likely:
        pixels = camera.predict(rows(q), each).reshape(-1, 4, 2)
        upright = exponential(structure.predict(q, each)[:, 3:])[:, 2, 2] > _UPRIGHT
        inside = (pixels > _EDGE * picture) & (pixels < (1 - _EDGE) * picture)
        shown += upright & inside.all(axis=(1, 2))
    q = np.unique(q[shown > _SURE * len(likely)].round(4), axis=0)
    q = q[rng.permutation(len(q))[:_KEPT]]
    if len(q) < 3:
        raise OptionError(
            f"handeye: the camera sees the board in {len(q)} of the postures about the start; "
            "give `start` where it does, further from the joints' limits"
        )
    free = (
        "view.rotation",
        "view.shift",
        "tool",
        "tool.rotation",
        "lens",
        "placement",
        "offset",
    )
    prior = camera.prior(free)
    # pixels of a lens have wide priors
    sd = np.minimum(
        prior.sd, np.where(np.isin(np.arange(len(beta)), groups["lens"]), np.inf, _WIDE)
    )

    def told(q: Array) -> Array:
        seen = camera.linearise(rows(q), beta, prior.active)[1].reshape(len(q), 8, -1)
        return np.asarray(seen * sd[prior.active] / _PIXEL)

    return q, told


def _likely(
    structure: SpatialStructure,
    start: Array,
    in_hand: bool,
    away: float,
    rng: np.random.Generator,
) -> list[Array]:
    """Parameters of cameras that may be meant, the one that is assumed first."""
    groups = structure.groups
    likely = list[Array]()
    # the frame of a board in the hand is the tip's, half a turn about its x axis on
    half_turn = exponential(np.array([[0.0 if in_hand else np.pi, 0.0, 0.0]]))[0]
    for k in range(_LIKELY):
        off = min(k, 1) * rng.standard_normal((3, 3)) * _ASIDE
        turn, tilt = exponential(off[1:])
        beta = structure.neutral()
        beta[groups["tool"]], beta[groups["tool.rotation"]] = (
            off[0],
            logarithm(turn @ half_turn),
        )
        (p,), (hand,) = structure.pose(start[None], beta)
        facing = hand @ tilt
        beta[groups["view.rotation"]] = logarithm(facing.T)
        beta[groups["view.shift"]] = -facing.T @ (
            p + away * (hand if in_hand else -facing)[:, 2]
        )
        likely.append(beta)
    return likely


def _encoded(body: Body, made: dict[str, Any]) -> Array:
    """Parameters of a body of pictures of a board, with its lens, seen by camera and board."""
    beta = body.beta.copy()
    groups = body.structure.groups
    glass = made["lens"]
    beta[groups["lens"]] = (
        np.mean(glass["focal"]),
        *glass["centre"],
        glass["distortion"][0],
    )
    if (
        made["eye"] == "hand"
    ):  # from the point ahead to the camera, from the corner to the middle
        beta[groups["tool"]] -= (
            exponential(beta[groups["tool.rotation"]]) @ made["point"]
        )
        beta[groups["view.shift"]] -= 0.5 * np.array(
            [*Board.parse(made["board"]).size, 0.0]
        )
    return beta
