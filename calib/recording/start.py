"""Start: camera X and board Y in closed form (Shah 2013) from the board B in each picture.

X B = M Y, in the symbols of :mod:`.bundle`.

Half turns of a chessboard that looks the same from both ends follow from the motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arm.rigid import inverse, place_points, rigid, shift_of, turn_of
from ..arm.rotations import nearest_rotation
from ..common.arrays import Array, Mask
from ..common.rows import row_lengths
from ..common.scale import METRES
from .view import View

MISSAID = 0.3
"""Log of a board's size over the stated one, that is none."""

ROUNDS = 4
"""Rounds in which pictures that contradict are weighed down."""

UNITS = ("m", "cm", "mm", "in")

USUAL = 0.6
"""How far a flange is from its base, about [m]."""

NEAREST = 0.06
"""How far it is at least [m]; nearer, it is in another unit."""


@dataclass(frozen=True, eq=False)
class RigStart:
    """Camera and board where motions and boards are as they are read."""

    camera: Array  # (4, 4), X [m]
    board: Array  # (4, 4), Y [m]
    unit: str
    # log of the board's size over the stated one; minus infinity of one behind the camera
    size: float
    misfit: float  # of a usual picture, as the camera sees it [rad]
    turned: Mask  # (n,), pictures numbered from the board's other end

    @property
    def is_sized(self) -> bool:
        """Whether the board is of a size that may be meant."""
        return abs(self.size) < MISSAID

    @property
    def rank(self) -> float:
        """The misfit, ten times where the board is of no size that may be meant."""
        return self.misfit if self.is_sized else 10.0 * self.misfit


def find_start(flange: Array, view: View, unit: str | None = None) -> RigStart:
    """Solve for camera and board; where the motions tell no lengths, with the board as stated.

    A flange that turns on the spot fits in any unit: then it is as far from its base as usual.

    flange : (n, 4, 4), in the base
    unit : of the flange's lengths; by default, of those in which it is no nearer to its base than
        flanges are, the one in which the board is nearest to its stated size
    """
    # units in which the flange is far enough from its base
    distances = row_lengths(shift_of(flange))
    distance = float(np.median(distances))
    far = [name for name in UNITS if distance / METRES[name] > NEAREST]
    units = far or [*UNITS]
    if unit:
        units = [unit]

    # a metre as the motions tell it, or as the board's stated size does
    by_motions = _solve(flange, view, units, None)
    metre = max(distance, 1e-9) / USUAL
    usual_unit = _nearest(metre, units)
    by_board = _solve(flange, view, [usual_unit], METRES[usual_unit])
    limit = max(1.3 * by_motions.misfit, np.radians(0.2))
    if by_motions.is_sized:  # by chance, where a length of noise fits badly
        limit = 0.5 * by_motions.misfit
    return by_board if by_board.misfit < limit else by_motions


def _usual(misses: Array) -> float:
    """The miss of a usual picture: the median of those beyond the three that fit any reading."""
    beyond = min(3, len(misses) - 1)
    ascending = np.sort(misses)
    return float(np.median(ascending[beyond:]))


def _nearest(length: float, units: Sequence[str]) -> str:
    """The unit of which a metre is nearest to a length."""
    return min(units, key=lambda name: abs(np.log(length / METRES[name])))


def _solve(
    flange: Array, view: View, units: Sequence[str], metre: float | None
) -> RigStart:
    """Camera X and board Y of flange poses (n, 4, 4), in closed form.

    units : of which the flange's lengths may be
    metre : of the boards, in the flange's unit; None where the motions tell it
    """
    motions = inverse(flange) if view.in_hand else flange
    boards = view.boards
    half_turn = view.board.half_turn
    turned = np.zeros(len(motions), bool)
    if half_turn is not None:
        turned = _half_turned(motions, boards, half_turn)
        other_ends = boards @ half_turn
        boards = np.where(turned[:, None, None], other_ends, boards)
    points = view.board.points()
    every = max(len(points) // 8, 1)
    form = _robust_closed_form(motions, boards, points[::every], metre)
    board = form.board
    if half_turn is not None and turned[0]:
        # the first picture tells from which end boards are numbered
        board = board @ half_turn
        turned = ~turned

    # metres of the flange's unit, by which the board may be of another size than stated
    unit = _nearest(max(form.metre, 1e-9), units)
    factor = form.metre / METRES[unit]
    frames = np.stack([form.camera, board])
    frames[:, :3, 3] *= factor
    size = float(np.log(factor)) if factor > 0.0 else -np.inf
    return RigStart(frames[0], frames[1], unit, size, form.misfit, turned)


class ClosedForm(NamedTuple):
    """X and Y of X B = M Y."""

    camera: Array  # (4, 4), X [m of the boards]
    board: Array  # (4, 4), Y [m of the boards]
    metre: float  # of the boards, in the motions' unit
    misfit: float = np.inf  # of a usual picture [rad]


def _robust_closed_form(
    motions: Array, boards: Array, points: Array, metre: float | None
) -> ClosedForm:
    """X and Y, with pictures that contradict the others weighed down.

    motions M, boards B : (n, 4, 4);  points : (k, 3), of the board [m]
    """
    weights = np.ones(len(motions))
    for _ in range(ROUNDS):
        form = _closed_form(motions, boards, weights, metre)
        in_metres = rigid(turn_of(motions), shift_of(motions) / form.metre)
        predicted = inverse(form.camera) @ in_metres @ form.board
        misses = _gaps(predicted, boards, points)
        misfit = _usual(misses)
        far = misses / (3.0 * misfit + 1e-9)
        growth = 1.0 + far**2
        weights = 1.0 / growth**2
    return form._replace(misfit=misfit)


def _closed_form(
    motions: Array, boards: Array, weights: Array, metre: float | None
) -> ClosedForm:
    """X and Y with weights (n,) of the pictures.

    metre : of the boards in the motions' unit, where it is known
    """
    # turns: M' X B = Y, the pair of the largest singular value, which is 1 without noise
    turns = turn_of(motions)
    board_turns = turn_of(boards)
    pairs = np.einsum("i,iba,idc->acbd", weights, turns, board_turns)
    left, _, right = np.linalg.svd(pairs.reshape(9, 9))
    x_scaled = right[0].reshape(3, 3)
    y_scaled = left[:, 0].reshape(3, 3)
    sign = np.sign(np.linalg.det(x_scaled))
    x_turn = nearest_rotation(sign * x_scaled)
    y_turn = nearest_rotation(sign * y_scaled)

    # shifts of X and Y, and the length: linear least squares
    places = shift_of(boards) @ x_turn.T
    same = np.broadcast_to(np.eye(3), turns.shape)
    columns = [same, -turns, places[:, :, None]]
    root = np.sqrt(weights)[:, None]
    blocks = np.concatenate(columns, axis=2)
    blocks *= root[:, :, None]
    rows = blocks.reshape(-1, 7)
    weighed = shift_of(motions) * root
    target = weighed.ravel()
    if metre is None:
        shifts = np.linalg.lstsq(rows, target, rcond=1e-10)[0]
        metre = float(shifts[6])
        if abs(metre) < 1e-12:
            metre = 1e-12
    else:
        target -= metre * rows[:, 6]
        shifts = np.linalg.lstsq(rows[:, :6], target, rcond=1e-6)[0]
    x_shift, y_shift = shifts[:6].reshape(2, 3) / metre
    return ClosedForm(rigid(x_turn, x_shift), rigid(y_turn, y_shift), metre)


def _half_turned(motions: Array, boards: Array, half_turn: Array) -> Mask:
    """Which boards (n,) are numbered from their other end.

    A board turns between two pictures by as much as the flange, wherever camera and board are.
    The signs of the leading eigenvector of how much better pairs of pictures fit unturned.
    """
    flange_turns = _flat_turns(motions)
    plain = _flat_turns(boards)
    turned = _flat_turns(boards @ half_turn)
    # traces of the turns between each two pictures
    traces = flange_turns @ flange_turns.T
    miss_plain = np.abs(traces - plain @ plain.T)
    miss_turned = np.abs(traces - turned @ plain.T)
    _, vectors = np.linalg.eigh(miss_turned - miss_plain)
    leading = vectors[:, -1]
    largest = leading[np.abs(leading).argmax()]
    is_turned: Mask = leading * largest < 0
    return is_turned


def _flat_turns(poses: Array) -> Array:
    """Rotations of poses (n, 4, 4), each as nine numbers (n, 9)."""
    return turn_of(poses).reshape(-1, 9)


def _gaps(predicted: Array, boards: Array, points: Array) -> Array:
    """Rms angle (n,) [rad] between a board's points (k, 3) as predicted and as seen."""
    expected = place_points(predicted, points)
    places = place_points(boards, points)
    depth = places[:, :, 2:]
    # a board that is predicted behind the camera is far off, in no direction
    ahead = np.maximum(expected[:, :, 2:], 0.05 * depth)
    predicted_rays = expected[:, :, :2] / ahead
    rays = places[:, :, :2] / depth
    gaps = predicted_rays - rays
    squares = (gaps**2).sum(axis=2)
    rms = np.sqrt(squares.mean(axis=1))
    limited: Array = np.minimum(rms, 3.0)
    return limited
