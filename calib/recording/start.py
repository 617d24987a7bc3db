"""Start: camera and board in closed form (Shah 2013) from the board's poses in each picture.

Half turns of a chessboard that looks the same from both ends follow from the motions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.rotations import nearest_rotation
from ..common.arrays import Array, Index, Mask
from ..common.scale import METRES
from .rigid import inverse, rigid

MISSAID = 0.3
"""Log of a board's size over the stated one, that is none."""

UNITS = ("m", "cm", "mm", "in")


@dataclass(frozen=True, eq=False)
class BoardPoses:
    """A board before a camera, by each picture alone."""

    poses: Array  # (n, 4, 4) [m]
    ends: Array  # (k, 3), corners of the board [m]
    half_turn: (
        Array | None
    )  # (4, 4) [m], of a board that looks the same from its ends
    in_hand: bool  # whether the camera is in the hand

    def take(self, rows: Index) -> BoardPoses:
        """Some of the pictures."""
        return BoardPoses(
            self.poses[rows], self.ends, self.half_turn, self.in_hand
        )


@dataclass(frozen=True, eq=False)
class Start:
    """Camera and board where motions and boards are as they are read."""

    camera: Array  # (4, 4), X [m]
    board: Array  # (4, 4), Y [m]
    unit: str
    size: float  # log of the board's size over the stated one
    misfit: float  # of the median picture, as the camera sees it [rad]
    turned: Mask  # (n,), pictures numbered from the board's other end

    @property
    def rank(self) -> float:
        """The misfit, ten times where the board is of no size that may be meant."""
        return self.misfit if abs(self.size) < MISSAID else 10.0 * self.misfit


def find_start(
    flange: Array,
    boards: BoardPoses,
    rounds: int = 4,
    unit: str | None = None,
    *,
    sized: bool = False,
) -> Start:
    """Solve for camera and board; pictures that contradict are weighed down.

    flange : (n, 4, 4), in the base
    rounds : in which pictures are weighed
    unit : of its lengths; by default the one in which the board is nearest to its stated size
    sized : whether the board has its stated size in that unit
    """
    length = METRES[unit] if unit is not None and sized else None
    motions = inverse(flange) if boards.in_hand else flange
    weights = np.ones(len(motions))
    turn = boards.half_turn
    turned = np.zeros(len(motions), bool)
    poses = boards.poses
    if turn is not None:
        turned = half_turned(motions, poses, turn)
    for _ in range(rounds):
        if turn is not None:
            poses = np.where(
                turned[:, None, None], boards.poses @ turn, boards.poses
            )
        x, y, scale = closed_form(motions, poses, weights, length)
        predicted = inverse(x) @ motions @ y
        predicted[:, :3, 3] /= scale if abs(scale) > 1e-12 else 1e-12
        misses = _gaps(predicted, poses, boards.ends)
        if turn is not None:
            others = _gaps(predicted, poses @ turn, boards.ends)
            turned = turned ^ (others < 0.7 * misses)
            misses = np.minimum(misses, others)
        misfit = float(np.median(misses))
        weights = 1.0 / (1.0 + (misses / (3.0 * misfit + 1e-9)) ** 2) ** 2
    if (
        turn is not None and turned[0]
    ):  # from which end is free: the first picture's
        half = turn.copy()
        half[:3, 3] *= scale
        y = y @ half
        turned = ~turned
    lengths = max(scale, 1e-9)
    unit = unit or min(
        UNITS, key=lambda name: abs(np.log(lengths / METRES[name]))
    )
    x[:3, 3] /= METRES[unit]
    y[:3, 3] /= METRES[unit]
    size = float(np.log(lengths / METRES[unit]))
    if scale <= 0.0:  # a board behind the camera
        size = -np.inf
    return Start(x, y, unit, size, misfit, turned)


def find_sized_start(
    flange: Array, boards: BoardPoses, rounds: int = 4, unit: str | None = None
) -> Start:
    """Solve for camera and board; where the motions tell no lengths, with the board as stated.

    A flange that turns on the spot fits in any unit: then it is some 0.6 m from the base.
    """
    start = find_start(flange, boards, rounds, unit)
    if abs(start.size) < MISSAID:
        return start
    distance = max(
        float(np.median(np.linalg.norm(flange[:, :3, 3], axis=1))), 1e-9
    )
    usual = sorted(
        UNITS, key=lambda name: abs(np.log(distance / METRES[name] / 0.6))
    )
    for name in [unit] if unit else usual:
        sized = find_start(flange, boards, rounds, name, sized=True)
        if sized.misfit < max(1.3 * start.misfit, np.radians(0.2)):
            return sized
    return start


def closed_form(
    motions: Array, boards: Array, weights: Array, size: float | None = None
) -> tuple[Array, Array, float]:
    """X, Y (4, 4) and the motions' lengths in one of the boards', of X B = M Y.

    motions M, boards B : (n, 4, 4);  weights : (n,)
    size : the motions' lengths in one of the boards', where that is known
    """
    turns = motions[:, :3, :3]
    share = weights / weights.sum()
    pairs = np.einsum("i,iba,idc->acbd", share, turns, boards[:, :3, :3])
    # M' X B = Y: the pair of the largest singular value, which is 1 without noise
    left, _, right = np.linalg.svd(pairs.reshape(9, 9))
    sign = np.sign(np.linalg.det(right[0].reshape(3, 3)))
    x = nearest_rotation(sign * right[0].reshape(3, 3))
    y = nearest_rotation(sign * left[:, 0].reshape(3, 3))
    places = boards[:, :3, 3] @ x.T
    same = np.broadcast_to(np.eye(3), turns.shape)
    root = np.sqrt(weights)
    rows = np.concatenate([same, -turns, places[:, :, None]], axis=2)
    rows = (rows * root[:, None, None]).reshape(-1, 7)
    target = (motions[:, :3, 3] * root[:, None]).ravel()
    if size is None:
        shift = np.linalg.lstsq(rows, target, rcond=1e-10)[0]
    else:
        target = target - size * rows[:, 6]
        shift = np.append(
            np.linalg.lstsq(rows[:, :6], target, rcond=1e-6)[0], size
        )
    return rigid(x, shift[:3]), rigid(y, shift[3:6]), float(shift[6])


def half_turned(motions: Array, boards: Array, turn: Array) -> Mask:
    """Which boards (n,) are numbered from their other end.

    Turns between two pictures are as large as the flange's, wherever camera and board are: the
    leading eigenvector of how much better a pair fits turned.
    """
    flat = motions[:, :3, :3].reshape(-1, 9)
    plain = boards[:, :3, :3].reshape(-1, 9)
    other = (boards @ turn)[:, :3, :3].reshape(-1, 9)
    traces = flat @ flat.T
    alike = np.abs(traces - other @ plain.T) - np.abs(traces - plain @ plain.T)
    vector = np.linalg.eigh(alike)[1][:, -1]
    return np.asarray(vector * vector[np.abs(vector).argmax()] < 0)


def _gaps(predicted: Array, boards: Array, ends: Array) -> Array:
    """Angle [rad] between ends of a board as predicted and as they are, rms of each picture."""
    away = (
        ends @ np.swapaxes(predicted[:, :3, :3], 1, 2)
        + predicted[:, None, :3, 3]
    )
    there = ends @ np.swapaxes(boards[:, :3, :3], 1, 2) + boards[:, None, :3, 3]
    depth = np.maximum(away[:, :, 2:], 0.05 * there[:, :, 2:])
    gap = away[:, :, :2] / depth - there[:, :, :2] / there[:, :, 2:]
    return np.asarray(
        np.minimum(np.sqrt((gap**2).sum(axis=2).mean(axis=1)), 3.0)
    )
