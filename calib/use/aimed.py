"""Aimed poses: postures at one point, and poses that keep a board in a camera's picture.

Random postures are led towards where they are aimed by damped Newton steps; of those that arrive
the plan takes the most telling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rotations import exponential, logarithm
from ..body.corners import Corners
from ..body.most_telling import greedy
from ..body.spatial import SpatialStructure, structure_of
from ..body.spatial_view import InSpace
from ..common.arrays import Array, Index, Mask
from ..common.rows import number_rows
from ..errors import OptionError
from ..model.model import Model
from ..recording.board import Board
from .pose_space import PoseSpace

Choose = Callable[[Array, int, Array], Index]
"""Chooses n of some postures (m, dof), beside those that are taken (k, dof)."""

_DRAWN, _KEPT = 3000, 400  # postures that are led, and those of them to choose from
_STEPS = 60  # of the joints towards where they are aimed
_NEAR = 1e-6  # [m] within which a posture is at its point
_PLAY = 1e-4  # [m] of a socket
_WIDE = 10.0  # [m or rad] of what is not known at all
_LENS, _PICTURE = (900.0, 640.0, 360.0, 0.0), (1280.0, 720.0)  # of a common camera [px]
_PIXEL = 0.2  # [px] of a corner
_FILLED, _EDGE = 0.25, 0.03  # share of the picture that the board fills, and that stays free
_TILTED, _NEARER = np.radians(45.0), (0.7, 1.4)  # the camera's tilt and distance, of the first one
# a camera that stands elsewhere and points elsewhere than said [m, rad], the board's tilt and
# distance; so many cameras, and the share of them that must see the board
_ASIDE, _LIKELY, _SURE = np.array([[0.04], [0.13], [0.1], [0.2]]), 32, 0.95
_EXCHANGES = 2  # of each chosen pose for a better one
_UPRIGHT = 0.5  # least cosine between the line of sight and the board's normal


def at_point(
    source: Arm | Model, space: PoseSpace, point: Sequence[float], rng: np.random.Generator
) -> tuple[Array, Choose]:
    """Postures (m, dof) whose tip is at a point (3,) of the arm's base frame [m], as varied as can.

    Returns also how to choose those that tell most; where the point is, is not known.
    Raises OptionError if none is found.
    """
    structure, beta, active, root = _belief(source)
    target = number_rows(np.ravel(point), ("x", "y", "z"), "touch", OptionError)[0][0]
    start = rng.uniform(space.lower, space.upper, (_DRAWN, structure.dof))
    q, off = _led(structure, beta, start, np.tile(target, (_DRAWN, 1)), space)
    q = q[off < _NEAR][:_KEPT]
    if not len(q):
        raise OptionError(
            f"touch {', '.join(f'{value:g}' for value in target)}: no posture within the limits "
            "reaches this point of the base frame [m]; give another"
        )

    def choose(q: Array, n: int, taken: Array) -> Index:  # noqa: ARG001
        told = structure.linearise(q, beta, active)[1] @ root
        place = np.broadcast_to(_WIDE * np.eye(3), (len(q), 3, 3))
        return greedy(np.concatenate([told, place], axis=2) / _PLAY, n)

    return q, choose


def in_sight(
    source: Arm | Model, space: PoseSpace, board: Board | str | bool, eye: str,
    start: Array | None, rng: np.random.Generator,
) -> tuple[Array, Choose]:  # fmt: skip
    """Postures (m, dof) in which a camera sees all of a board, from many sides.

    Of a model of pictures of a board, camera and board are known.  Of an arm the camera in the hand
    looks along the tip's z axis, or the board's print faces along it, and at the posture `start`
    (dof,) it sees the board in the middle of its picture; all that more or less, see `_likely`.
    Returns also how to choose those that tell most of what is in the hand.
    Raises OptionError if fewer than three are found.
    """
    if isinstance(source, SpatialArm):
        if isinstance(board, bool) or start is None:
            raise OptionError(
                "handeye: expected the board and `start`, joint values at which the camera sees it "
                "in the middle of its picture"
            )
        size, picture, in_hand = np.array(Board.of(board).size), np.array(_PICTURE), eye == "hand"
        structure = structure_of(source, "pose", lens=_LENS)
        away = _LENS[0] * size.max() / (_FILLED * picture[0])
        likely = _likely(structure, start, in_hand, away, rng)
    else:
        structure, beta, made = _known(source)
        size, picture = np.array(Board.of(made["board"]).size), np.array(made["size"], float)
        in_hand, likely = made["eye"] == "hand", [beta]
        away = beta[structure.groups["lens"][0]] * size.max() / (_FILLED * picture[0])
    corners = 0.5 * size * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    corners = np.column_stack([corners, np.zeros(4)])
    beta = likely[0]
    # the camera about the board: tilted to any side, rolled, nearer and further, aimed beside it
    tilt, side = _TILTED * np.sqrt(rng.random(_DRAWN)), rng.uniform(-np.pi, np.pi, _DRAWN)
    turn = exponential(np.stack([tilt * np.cos(side), tilt * np.sin(side), 0 * tilt], axis=1))
    shift = -(away * rng.uniform(*_NEARER, _DRAWN))[:, None] * turn[:, :, 2]
    roll = np.column_stack([rng.normal(0, 0.1, (_DRAWN, 2)), rng.uniform(-2, 2, _DRAWN)])
    turn = turn @ exponential(roll)
    if not in_hand:  # the same seen from the camera
        turn = np.swapaxes(turn, 1, 2)
        shift = -np.einsum("nij,nj->ni", turn, shift)
    begin = rng.uniform(space.lower, space.upper, (_DRAWN, structure.dof))
    if start is not None:
        begin[: _DRAWN // 2] = start
    target = np.concatenate([shift, logarithm(turn)], axis=1)
    q, _ = _led(structure, beta, begin, target, space)
    pose = structure.measurement
    assert isinstance(pose, InSpace)  # noqa: S101 - a view of poses
    reading = Corners(pose, in_hand, beta)
    camera = structure.with_view("board", unit="px", reading=reading)

    def rows(q: Array) -> Array:
        return np.column_stack([np.repeat(q, 4, axis=0), np.tile(corners, (len(q), 1))])

    def seen(q: Array, each: Array) -> Mask:
        pixels = camera.predict(rows(q), each).reshape(-1, 4, 2)
        upright = exponential(structure.predict(q, each)[:, 3:])[:, 2, 2] > _UPRIGHT
        inside = (pixels > _EDGE * picture) & (pixels < (1 - _EDGE) * picture)
        return np.asarray(upright & inside.all(axis=(1, 2)))

    shown = np.mean([seen(q, each) for each in likely], axis=0)
    q = np.unique(q[shown > _SURE].round(4), axis=0)
    q = q[rng.permutation(len(q))[:_KEPT]]
    if len(q) < 3:
        raise OptionError(
            f"handeye: the camera sees the board in {len(q)} of the postures about the start; "
            "give `start` where it does, further from the joints' limits"
        )
    free = ("view.rotation", "view.shift", "tool", "tool.rotation", "lens", "placement", "offset")
    prior = camera.prior(free)
    active = prior.active
    sd = np.minimum(prior.sd[active], _WIDE)
    lens = np.isin(active, camera.groups["lens"])
    sd[lens] = prior.sd[active[lens]]
    # a turn of what is in the hand weighs as it shows at the board
    tool, turn_of_tool = (np.isin(active, camera.groups[g]) for g in ("tool", "tool.rotation"))
    weight = tool + away * turn_of_tool

    def choose(q: Array, n: int, taken: Array) -> Index:  # noqa: ARG001
        told = camera.linearise(rows(q), beta, active)[1].reshape(len(q), 8, -1)
        return _surest(told * sd / _PIXEL, weight * sd, n)

    return q, choose


def _likely(
    structure: SpatialStructure, start: Array, in_hand: bool, away: float, rng: np.random.Generator
) -> list[Array]:
    """Parameters of cameras that may be meant, the one that is assumed first."""
    groups, likely = structure.groups, list[Array]()
    for k in range(_LIKELY):
        off = 0.0 if k == 0 else rng.standard_normal((4, 3)) * _ASIDE
        shift, turn, tilt, further = np.broadcast_to(off, (4, 3))
        beta = structure.neutral()
        # the frame of a board in the hand is the tip's, half a turn about its x axis on
        half_turn = exponential(np.array([[0.0 if in_hand else np.pi, 0.0, 0.0]]))[0]
        beta[groups["tool"]] = shift
        beta[groups["tool.rotation"]] = logarithm(exponential(turn[None]) @ half_turn)[0]
        (p,), (hand,) = structure.pose(start[None], beta)
        facing = hand @ exponential(tilt[None])[0]
        ahead = away * np.exp(further[0]) * (hand if in_hand else -facing)[:, 2]
        beta[groups["view.rotation"]] = logarithm(facing.T[None])[0]
        beta[groups["view.shift"]] = -facing.T @ (p + ahead)
        likely.append(beta)
    return likely


def _surest(told: Array, weight: Array, n: int) -> Index:
    """Choose rows one by one, each of which leaves least variance of some parameters; then mend.

    told : (m, p, k), directions in units of noise and of the prior
    weight : (k,), what a prior sd of each parameter counts (A-optimal design, Fedorov 1972)
    """
    known, chosen = np.eye(told.shape[2]), np.full(n, -1)
    for k in np.tile(np.arange(n), 1 + _EXCHANGES):
        if chosen[k] >= 0:  # each is exchanged for the best beside the others
            known -= told[chosen[k]].T @ told[chosen[k]]
            chosen[k] = -1
        less = told @ np.linalg.inv(known)
        spread = np.eye(told.shape[1]) + less @ np.swapaxes(told, 1, 2)
        gain = ((less * weight) * (np.linalg.solve(spread, less) * weight)).sum(axis=(1, 2))
        gain[chosen[chosen >= 0]] = -1.0
        chosen[k] = best = int(gain.argmax())
        known += told[best].T @ told[best]
    return chosen


def _known(source: Arm | Model) -> tuple[SpatialStructure, Array, dict[str, Any]]:
    """The arm of a model of pictures of a board: structure, parameters, and how it was seen."""
    body = None if isinstance(source, Arm) else source.body
    seen: Any = None if isinstance(source, Arm) else source.about.options.get("board")
    if body is None or seen is None or not isinstance(body.structure, SpatialStructure):
        raise OptionError(
            "handeye: expected a robot that moves in space, or a model that `calib handeye -o` made"
        )
    structure, beta = body.structure.with_view("pose"), body.beta.copy()
    glass, groups = seen["lens"], structure.groups
    beta[groups["lens"]] = (np.mean(glass["focal"]), *glass["centre"], glass["distortion"][0])
    if seen["eye"] == "hand":  # from the point ahead to the camera, from the corner to the middle
        turn = exponential(beta[groups["tool.rotation"]][None])[0]
        beta[groups["tool"]] -= turn @ seen["point"]
        beta[groups["view.shift"]] -= 0.5 * np.array([*Board.parse(seen["board"]).size, 0.0])
    return structure, beta, seen


def _belief(source: Arm | Model) -> tuple[SpatialStructure, Array, Index, Array]:
    """An arm seen in its base frame: structure, parameters, the free ones, and a root of theirs."""
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "base")
        prior = structure.prior(("tool", "placement", "offset"))
        root = np.asarray(np.diag(np.minimum(prior.sd[prior.active], _WIDE)))
        return structure, structure.neutral(), prior.active, root
    body = None if isinstance(source, Arm) else source.body
    if body is None or not isinstance(body.structure, SpatialStructure):
        raise OptionError("touch: expected a robot that moves in space, or a model of one")
    return body.structure.with_view("base"), body.beta, body.active, body.root


def _led(
    structure: SpatialStructure, beta: Array, q: Array, target: Array, space: PoseSpace
) -> tuple[Array, Array]:
    """Joints (n, dof) led to targets (n, m) within their limits, and how far they are off (n,)."""
    q, damping = np.clip(q, space.lower, space.upper), np.full(len(q), 1e-3)
    seen, slope = structure.predict_and_slope(q, beta)
    left = structure.residual(target, seen)
    for _ in range(_STEPS):
        back = np.swapaxes(slope, 1, 2)
        lean = slope @ back + damping[:, None, None] * np.eye(left.shape[1])
        step = (back @ np.linalg.solve(lean, left[..., None]))[..., 0]
        trial = np.clip(q + np.clip(step, -0.3, 0.3), space.lower, space.upper)
        seen, new_slope = structure.predict_and_slope(trial, beta)
        now = structure.residual(target, seen)
        better = np.linalg.norm(now, axis=1) < np.linalg.norm(left, axis=1)
        q, left = np.where(better[:, None], trial, q), np.where(better[:, None], now, left)
        slope = np.where(better[:, None, None], new_slope, slope)
        damping = np.where(better, damping / 4, np.minimum(10 * damping, 1e3)).clip(1e-9)
    return q, np.linalg.norm(left, axis=1)
