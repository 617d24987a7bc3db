"""Start: camera and board in closed form (Shah 2013) from the board's poses in each picture.

Half turns of a chessboard that looks the same from both ends follow from the motions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import nearest_rotation
from ..common.arrays import Array, Index, Mask
from ..common.scale import METRES
from .rigid import inverse, rigid

MISSAID = 0.3
"""Log of a board's size over the stated one, that is none."""

ROUNDS = 4
"""Rounds in which pictures that contradict are weighed down."""

UNITS = ("m", "cm", "mm", "in")


@dataclass(frozen=True, eq=False)
class BoardPoses:
    """A board before a camera, by each picture alone."""

    poses: Array  # (n, 4, 4) [m]
    ends: Array  # (k, 3), corners of the board [m]
    # (4, 4) [m], of a board that looks the same from its ends
    half_turn: Array | None
    in_hand: bool  # whether the camera is in the hand

    def take(self, rows: Index) -> BoardPoses:
        """Some of the pictures."""
        return replace(self, poses=self.poses[rows])


@dataclass(frozen=True, eq=False)
class Start:
    """Camera and board where motions and boards are as they are read."""

    camera: Array  # (4, 4), X [m]
    board: Array  # (4, 4), Y [m]
    unit: str
    # log of the board's size over the stated one; minus infinity of one behind the camera
    size: float
    misfit: float  # of the median picture, as the camera sees it [rad]
    turned: Mask  # (n,), pictures numbered from the board's other end

    @property
    def rank(self) -> float:
        """The misfit, ten times where the board is of no size that may be meant."""
        return self.misfit if abs(self.size) < MISSAID else 10.0 * self.misfit


def find_start(
    flange: Array, boards: BoardPoses, unit: str | None = None
) -> Start:
    """Solve for camera and board; where the motions tell no lengths, with the board as stated.

    A flange that turns on the spot fits in any unit: then it is some 0.6 m from the base.

    flange : (n, 4, 4), in the base
    unit : of its lengths; by default the one in which the board is nearest to its stated size
    """
    start = _solved(flange, boards, unit)
    if abs(start.size) < MISSAID:
        return start
    distances = np.linalg.norm(flange[:, :3, 3], axis=1)
    distance = max(float(np.median(distances)), 1e-9)
    usual = sorted(
        UNITS, key=lambda name: abs(np.log(distance / METRES[name] / 0.6))
    )
    for name in [unit] if unit else usual:
        sized = _solved(flange, boards, name, METRES[name])
        if sized.misfit < max(1.3 * start.misfit, np.radians(0.2)):
            return sized
    return start


def _solved(
    flange: Array,
    boards: BoardPoses,
    unit: str | None,
    length: float | None = None,
) -> Start:
    """Camera and board; `length` is that of a metre in the flange's unit, where boards tell it."""
    motions = inverse(flange) if boards.in_hand else flange
    weights = np.ones(len(motions))
    turn = boards.half_turn
    turned = np.zeros(len(motions), bool)
    poses = boards.poses
    if turn is not None:
        turned = _half_turned(motions, poses, turn)
        poses = np.where(turned[:, None, None], poses @ turn, poses)
    for _ in range(ROUNDS):
        x, y, scale = _closed_form(motions, poses, weights, length)
        predicted = inverse(x) @ motions @ y
        predicted[:, :3, 3] /= scale if abs(scale) > 1e-12 else 1e-12
        misses = _gaps(predicted, poses, boards.ends)
        misfit = float(np.median(misses))
        weights = 1.0 / (1.0 + (misses / (3.0 * misfit + 1e-9)) ** 2) ** 2
    if turn is not None and turned[0]:
        # from which end is free: the first picture's
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
    size = float(np.log(lengths / METRES[unit])) if scale > 0.0 else -np.inf
    return Start(x, y, unit, size, misfit, turned)


def _closed_form(
    motions: Array, boards: Array, weights: Array, size: float | None
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
    root = np.sqrt(weights)[:, None]
    rows = np.concatenate([same, -turns, places[:, :, None]], axis=2)
    rows = (rows * root[:, None]).reshape(-1, 7)
    target = (motions[:, :3, 3] * root).ravel()
    if size is None:
        shift = np.linalg.lstsq(rows, target, rcond=1e-10)[0]
    else:
        target = target - size * rows[:, 6]
        shift = np.linalg.lstsq(rows[:, :6], target, rcond=1e-6)[0]
        shift = np.append(shift, size)
    return rigid(x, shift[:3]), rigid(y, shift[3:6]), float(shift[6])


def _half_turned(motions: Array, boards: Array, turn: Array) -> Mask:
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
    places = []
    for poses in (predicted, boards):
        turns = np.swapaxes(poses[:, :3, :3], 1, 2)
        places.append(ends @ turns + poses[:, None, :3, 3])
    away, there = places
    depth = np.maximum(away[:, :, 2:], 0.05 * there[:, :, 2:])
    gap = away[:, :, :2] / depth - there[:, :, :2] / there[:, :, 2:]
    rms = np.sqrt((gap**2).sum(axis=2).mean(axis=1))
    return np.asarray(np.minimum(rms, 3.0))
