"""Start: camera X and board Y in closed form (Shah 2013) from the board B in each picture.

X B = M Y, in the symbols of :mod:`.bundle`.

Half turns of a chessboard that looks the same from both ends follow from the motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.rigid import inverse, place_points, rigid, shift_of, turn_of
from ..arm.rotations import nearest_rotation
from ..common.arrays import Array, Mask
from ..common.scale import METRES
from .board_pictures import View

LARGEST_SIZE_ERROR = 0.3
"""|log(true / stated size)| of a board beyond which the motions do not explain the pictures."""

ROUNDS = 4
"""Rounds in which pictures that contradict the others lose weight."""


@dataclass(frozen=True)
class Trials:
    """Closed forms of few random pictures, the best of which shows the pictures that agree."""

    count: int = 100  # where a third of the pictures is wrong, one in five trials has none
    pictures: int = 4  # of each trial
    agree: float = (
        3.0  # factor on the median misfit, below which a picture agrees
    )


TRIALS = Trials()

UNITS = ("m", "cm", "mm", "in")

USUAL = 0.6
"""Typical distance of a flange from its base [m]."""

NEAREST = 0.06
"""Least distance of a flange from its base [m]; a smaller number is in another unit."""


@dataclass(frozen=True, eq=False)
class RigStart:
    """A closed form of camera and board."""

    camera: Array  # (4, 4), X [m]
    board: Array  # (4, 4), Y [m]
    unit: str
    # log of the board's size over the stated one; minus infinity of one behind the camera
    size: float
    misfit: float  # of a typical picture, as the camera sees it [rad]
    turned: Mask  # (n,), pictures numbered from the board's other end

    @property
    def is_sized(self) -> bool:
        """Whether the board's size may be the stated one."""
        return abs(self.size) < LARGEST_SIZE_ERROR

    @property
    def rank(self) -> float:
        """The misfit, ten times as large where the board's size cannot be the stated one."""
        return self.misfit if self.is_sized else 10.0 * self.misfit


def find_start(flange: Array, view: View) -> RigStart:
    """Camera and board of flanges (n, 4, 4) [m] in the base, see :func:`find_starts`."""
    return find_starts(flange[None], view, "m")[0]


def find_starts(flanges: Array, view: View, unit: str | None) -> list[RigStart]:
    """Solve for camera and board; where the motions have no lengths, with the board as stated.

    A flange that turns on the spot fits in any unit: the one in which it is as far from its base as
    usual is taken.

    flanges : (m, n, 4, 4), in the base, by each of m readings
    unit : of the flange's lengths; by default, of those in which it is no nearer to its base than
        flanges are, the one in which the board is nearest to its stated size
    """
    # units in which the flange is far enough from its base
    distances = np.linalg.norm(shift_of(flanges), axis=2)
    units = []
    usual_units = []
    for distance in np.median(distances, axis=1).tolist():
        far = [name for name in UNITS if distance / METRES[name] > NEAREST]
        possible = far or [*UNITS]
        if unit:
            possible = [unit]
        units.append(possible)
        usual_units.append([_nearest(max(distance, 1e-9) / USUAL, possible)])

    # a metre by the motions, or by the board's stated size
    metres = np.array([METRES[name] for (name,) in usual_units])
    by_motions = _solve(flanges, view, units, None)
    by_board = _solve(flanges, view, usual_units, metres)
    return [_better(*pair) for pair in zip(by_motions, by_board, strict=True)]


def _better(by_motions: RigStart, by_board: RigStart) -> RigStart:
    """The start whose metre is that of the board's stated size, where it fits as well."""
    limit = max(1.3 * by_motions.misfit, np.radians(0.2))
    if by_motions.is_sized:  # by chance, where a length of noise fits badly
        limit = 0.5 * by_motions.misfit
    return by_board if by_board.misfit < limit else by_motions


def _nearest(length: float, units: Sequence[str]) -> str:
    """The unit of which a metre is nearest to a length."""
    return min(units, key=lambda name: abs(np.log(length / METRES[name])))


def _solve(
    flanges: Array,
    view: View,
    units: Sequence[Sequence[str]],
    metres: Array | None,
) -> list[RigStart]:
    """Camera X and board Y of flange poses (m, n, 4, 4), in closed form.

    units : of which each reading's lengths may be
    metres : (m,), of the boards, in the flange's unit; None where the motions determine it
    """
    motions = inverse(flanges) if view.in_hand else flanges
    boards = np.broadcast_to(view.boards, motions.shape)
    half_turn = view.board.half_turn
    turned = np.zeros(motions.shape[:2], bool)
    if half_turn is not None:
        turned = _half_turned(motions, view.boards, half_turn)
        is_turned = turned[:, :, None, None]
        boards = np.where(is_turned, boards @ half_turn, boards)
    points = view.board.points()
    every = max(len(points) // 8, 1)
    weights = np.ones(motions.shape[:2])
    cameras, placed, lengths, misses = _robust_closed_form(
        motions, boards, points[::every], weights, metres
    )
    misfits = _usual(misses)
    if half_turn is not None:
        # the first picture sets the end from which boards are numbered
        first = turned[:, :1]
        placed = np.where(first[:, :, None], placed @ half_turn, placed)
        turned = turned ^ first

    starts = []
    for k, metre in enumerate(lengths.tolist()):
        # metres of the flange's unit, by which the board may be of another size than stated
        unit = _nearest(max(metre, 1e-9), units[k])
        factor = metre / METRES[unit]
        frames = np.stack([cameras[k], placed[k]])
        frames[:, :3, 3] *= factor
        size = float(np.log(factor)) if factor > 0.0 else -np.inf
        misfit = float(misfits[k])
        start = RigStart(frames[0], frames[1], unit, size, misfit, turned[k])
        starts.append(start)
    return starts


def agreeing_pictures(flange: Array, view: View) -> Mask:
    """The pictures (n,) that agree with a closed form of few of them.

    Of many closed forms the one with the least median misfit is taken (Rousseeuw 1984).

    flange : (n, 4, 4), in the base, at each picture [m]
    """
    rng = np.random.default_rng(0)
    weights = np.zeros((TRIALS.count, len(flange)))
    for chosen in weights:
        chosen[rng.choice(len(flange), TRIALS.pictures, replace=False)] = 1.0
    motions = inverse(flange) if view.in_hand else flange
    shape = (TRIALS.count, *motions.shape)
    misses = _robust_closed_form(
        np.broadcast_to(motions, shape),
        np.broadcast_to(view.boards, shape),
        view.board.points(),
        weights,
        None,
    )[3]
    medians = np.median(misses, axis=1)
    best = int(medians.argmin())
    return np.asarray(misses[best] < TRIALS.agree * medians[best])


def _usual(misses: Array) -> Array:
    """The misfit (m,) of a typical picture: the median without the least three, which always fit.

    misses : (m, n)
    """
    beyond = min(3, misses.shape[1] - 1)
    return np.median(np.sort(misses, axis=1)[:, beyond:], axis=1)


def _robust_closed_form(
    motions: Array,
    boards: Array,
    points: Array,
    weights: Array,
    metres: Array | None,
) -> tuple[Array, Array, Array, Array]:
    """X and Y of X B = M Y, where pictures that contradict the others lose weight.

    motions M, boards B : (m, n, 4, 4);  points : (k, 3), of the board [m]
    weights : (m, n), initial ones of the pictures
    metres : (m,), see `_closed_form`
    Returns X and Y (m, 4, 4) [m of the boards], that metre (m,) in the motions' unit, and the
    misfit (m, n) of each picture [rad].
    """
    for _ in range(ROUNDS):
        cameras, placed, lengths = _closed_form(
            motions, boards, weights, metres
        )
        shifts = shift_of(motions) / lengths[:, None, None]
        in_metres = rigid(turn_of(motions), shifts)
        predicted = inverse(cameras)[:, None] @ in_metres @ placed[:, None]
        misses = board_misfits(predicted, boards, points)
        far = misses / (3.0 * _usual(misses)[:, None] + 1e-9)
        weights = 1.0 / (1.0 + far**2) ** 2
    return cameras, placed, lengths, misses


def _closed_form(
    motions: Array, boards: Array, weights: Array, metres: Array | None
) -> tuple[Array, Array, Array]:
    """X, Y and metres with weights (m, n) of the pictures.

    metres : (m,), of the boards in the motions' unit, where they are known
    """
    # turns: M' X B = Y, the pair of the largest singular value, which is 1 without noise
    turns = turn_of(motions)
    weighed_boards = weights[:, :, None, None] * turn_of(boards)
    pairs = np.einsum("miba,midc->macbd", turns, weighed_boards)
    left, _, right = np.linalg.svd(pairs.reshape(-1, 9, 9))
    x_scaled = right[:, 0].reshape(-1, 3, 3)
    y_scaled = left[:, :, 0].reshape(-1, 3, 3)
    sign = np.sign(np.linalg.det(x_scaled))[:, None, None]
    x_turns = nearest_rotation(sign * x_scaled)
    y_turns = nearest_rotation(sign * y_scaled)

    # shifts of X and Y, and the length: linear least squares
    places = shift_of(boards) @ x_turns.mT
    same = np.broadcast_to(np.eye(3), turns.shape)
    columns = [same, -turns, places[..., None]]
    root = np.sqrt(weights)[:, :, None]
    blocks = np.concatenate(columns, axis=3) * root[..., None]
    rows = blocks.reshape(len(motions), -1, 7)
    targets = (shift_of(motions) * root).reshape(len(motions), -1)
    if metres is None:
        shifts = _least_squares(rows, targets, 1e-10)
        metres = shifts[:, 6]
        metres = np.where(np.abs(metres) < 1e-12, 1e-12, metres)
    else:
        targets -= metres[:, None] * rows[:, :, 6]
        shifts = _least_squares(rows[:, :, :6], targets, 1e-6)
    shifts = shifts[:, :6] / metres[:, None]
    cameras = rigid(x_turns, shifts[:, :3])
    return cameras, rigid(y_turns, shifts[:, 3:]), metres


def _least_squares(rows: Array, targets: Array, least: float) -> Array:
    """The shortest solutions (m, k) of rows (m, r, k) and targets (m, r).

    least : share of the largest singular value, below which others count as zero
    """
    inverses = np.linalg.pinv(rows, least)
    return (inverses @ targets[..., None])[..., 0]


def _half_turned(motions: Array, boards: Array, half_turn: Array) -> Mask:
    """Which boards are numbered from their other end, (m, n).

    motions : (m, n, 4, 4);  boards : (n, 4, 4)

    A board turns between two pictures by as much as the flange, wherever camera and board are.
    The answer is the signs of the leading eigenvector of a matrix: by how much each pair of
    pictures fits better unturned.
    """
    flange_turns = _flat_turns(motions)
    plain = _flat_turns(boards)
    turned = _flat_turns(boards @ half_turn)
    # traces of the turns between each two pictures
    traces = flange_turns @ flange_turns.mT
    miss_plain = np.abs(traces - plain @ plain.T)
    miss_turned = np.abs(traces - turned @ plain.T)
    leading = np.linalg.eigh(miss_turned - miss_plain)[1][:, :, -1]
    index = np.abs(leading).argmax(axis=1)
    largest = np.take_along_axis(leading, index[:, None], axis=1)
    return np.asarray(leading * largest < 0)


def _flat_turns(poses: Array) -> Array:
    """Rotations of poses (..., 4, 4), each as nine numbers (..., 9)."""
    return turn_of(poses).reshape(*poses.shape[:-2], 9)


def board_misfits(predicted: Array, boards: Array, points: Array) -> Array:
    """Rms angle (m, n) [rad] between a board's points (k, 3) as predicted and as seen."""
    expected = place_points(predicted, points)
    places = place_points(boards, points)
    depth = places[..., 2:]
    # a board that is predicted behind the camera is far off, in no direction
    ahead = np.maximum(expected[..., 2:], 0.05 * depth)
    gaps = expected[..., :2] / ahead - places[..., :2] / depth
    rms = np.sqrt((gaps**2).sum(axis=-1).mean(axis=-1))
    return np.asarray(np.minimum(rms, 3.0))
