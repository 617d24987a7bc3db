"""What a table of flange poses means: unit, angles, order and direction, by how well each fits.

Each reading is solved in closed form (Shah 2013) against the board's poses that the pictures show;
half turns of a chessboard that looks the same from both ends follow from the motions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from ..arm.rotations import matrix_of, nearest_rotation
from ..common.arrays import Array, Index, Mask
from ..common.choices import ROTATIONS
from ..common.scale import METRES
from ..errors import OptionError
from .bundle import inverse, poses_of

ORDERS = (
    "xyz",
    "ZYX",
    "XYZ",
    "zyx",
    "xzy",
    "XZY",
    "yxz",
    "YXZ",
    "yzx",
    "YZX",
    "zxy",
    "ZXY",
)
"""Orders of three angles about fixed (small) or moving axes."""

REPEATED_ORDERS = ("ZYZ", "zyz", "ZXZ", "zxz")

NAMES = {"xyz": "rpy", "ZYX": "kuka"}
"""Orders that have names of their own: fixed x, y, z of ROS and Fanuc; KUKA's A, B, C."""

MAKERS = {
    "rpy": "fixed axes x, y, z: ROS, Fanuc, Yaskawa",
    "kuka": "moving axes z, y, x: KUKA's A, B, C",
    "ZYZ": "moving axes z, y, z: Kawasaki, Doosan",
    "XYZ": "moving axes x, y, z: Staubli, Mecademic",
    "vector": "rotation vector: Universal Robots",
    "xyzw": "quaternion x, y, z, w",
    "wxyz": "quaternion w, x, y, z: ABB",
    "matrix": "matrix by rows",
    "transposed": "matrix by columns",
}

TIED = 1.3
"""Readings with less than this times the least misfit are not told apart."""

_UNITS = ("m", "cm", "mm", "in")
_MISSAID = (
    0.3  # log of the squares' size over the said one, beyond which a reading is doubted
)
_DOUBT = 10.0  # times the misfit that such a reading counts
_WEIGHED = 4  # rounds in which pictures that contradict are weighed down
_NEAR_BEST = 3.0  # times the least misfit of one round, that the other rounds are worth


class Convention(TypedDict):
    """What a table of poses means, as JSON tells it."""

    unit: str
    angles: str
    rotation: str
    inverse: bool  # whether rows are the base in the flange
    ratio: float  # how much worse the next reading fits


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read a table of poses."""

    rotation: str  # a key of MAKERS, or an order of axes
    angles: str  # "rad" or "deg"; "" where there are no angles
    inverse: bool  # whether rows are the base in the flange
    flange: Array  # (n, 4, 4), the flange in the base [table's lengths]
    said: bool = False  # whether the columns' names speak for it

    @property
    def words(self) -> str:
        """The reading for people."""
        kind = MAKERS.get(self.rotation, f"axes {self.rotation}")
        unit = f" in {self.angles}" if self.angles else ""
        return f"{kind}{unit}, {'base in flange' if self.inverse else 'flange in base'}"


@dataclass(frozen=True, eq=False)
class Start:
    """A closed form: camera and board where a reading is true."""

    camera: Array  # (4, 4), X [m]
    board: Array  # (4, 4), Y [m]
    unit: str
    size: float  # log of the board's size over the said one
    misfit: float  # of the median picture, seen from the camera [rad]
    by_picture: Array  # (n,) [rad]
    turned: Mask  # (n,), pictures numbered from the board's other end

    @property
    def rank(self) -> float:
        """The misfit, larger where the board is of no size that was said."""
        return self.misfit if abs(self.size) < _MISSAID else _DOUBT * self.misfit


@dataclass(frozen=True, eq=False)
class Seen:
    """A board before a camera, by each picture alone."""

    boards: Array  # (n, 4, 4) [m]
    ends: Array  # (k, 3), corners of the board [m]
    half_turn: (
        Array | None
    )  # (4, 4), of a board that looks the same from its other end [m]
    in_hand: bool  # whether the camera is in the hand

    def take(self, rows: Index) -> Seen:
        """Some of the pictures."""
        return Seen(self.boards[rows], self.ends, self.half_turn, self.in_hand)


def readings(table: Array, named: str = "") -> list[Reading]:
    """All ways to read x, y, z and 3, 4 or 9 numbers of a turn (n, 3 + k); the usual first.

    named : the rotation that the columns' names say
    """
    from scipy.spatial.transform import Rotation

    numbers = table[:, 3:]
    turns: list[tuple[str, str, Array]] = []
    if numbers.shape[1] == 9:
        matrices = numbers.reshape(-1, 3, 3)
        turns.append(("matrix", "", matrices))
        turns.append(("transposed", "", np.swapaxes(matrices, 1, 2)))
    elif numbers.shape[1] == 4:
        turns.append(("xyzw", "", matrix_of(numbers)))
        turns.append(("wxyz", "", matrix_of(np.roll(numbers, -1, axis=1))))
    else:
        for unit, degrees in (("rad", False), ("deg", True)):
            vectors = Rotation.from_rotvec(numbers, degrees=degrees)
            turns.append(("vector", unit, vectors.as_matrix()))
            for order in (*ORDERS, *REPEATED_ORDERS):
                angles = Rotation.from_euler(order, numbers, degrees=degrees)
                turns.append((NAMES.get(order, order), unit, angles.as_matrix()))
    turns.sort(key=lambda turn: turn[0] != named)
    found = []
    for inverted in (False, True):
        for rotation, unit, matrices in turns:
            poses = poses_of(matrices, table[:, :3])
            flange = inverse(poses) if inverted else poses
            found.append(Reading(rotation, unit, inverted, flange, rotation == named))
    return found


def closed_form(
    motions: Array, boards: Array, weights: Array, sized: float | None = None
) -> tuple[Array, Array, float]:
    """X, Y (4, 4) [motions' lengths] and the motions' lengths in one of the boards', of X B = M Y.

    motions M, boards B : (n, 4, 4);  weights : (n,)
    sized : the motions' lengths in one of the boards', where that is known
    """
    turns = motions[:, :3, :3]
    share = weights / weights.sum()
    both = np.einsum("i,iba,idc->acbd", share, turns, boards[:, :3, :3]).reshape(9, 9)
    # M' X B = Y: the pair of the largest singular value, which is 1 without noise
    left, _, right = np.linalg.svd(both)
    sign = np.sign(np.linalg.det(right[0].reshape(3, 3)))
    x = np.eye(4)
    y = np.eye(4)
    x[:3, :3] = nearest_rotation(sign * right[0].reshape(3, 3))
    y[:3, :3] = nearest_rotation(sign * left[:, 0].reshape(3, 3))
    places = boards[:, :3, 3] @ x[:3, :3].T
    same = np.tile(np.eye(3), (len(turns), 1, 1))
    root = np.sqrt(weights)
    rows = (
        np.concatenate([same, -turns, places[:, :, None]], axis=2) * root[:, None, None]
    )
    wanted = (motions[:, :3, 3] * root[:, None]).ravel()
    flat = rows.reshape(-1, 7)
    if sized is None:
        shift = np.linalg.lstsq(flat, wanted, rcond=1e-10)[0]
    else:
        shift = np.linalg.lstsq(flat[:, :6], wanted - sized * flat[:, 6], rcond=1e-6)[0]
        shift = np.append(shift, sized)
    x[:3, 3] = shift[:3]
    y[:3, 3] = shift[3:6]
    return x, y, float(shift[6])


def solve(
    flange: Array,
    seen: Seen,
    rounds: int = _WEIGHED,
    unit: str | None = None,
    *,
    sized: bool = False,
) -> Start:
    """Closed form of a reading; pictures that contradict are weighed down.

    flange : (n, 4, 4), in the base
    unit : of its lengths; by default the one in which the board is most nearly as large as said
    sized : whether the board is as large as said, in that unit
    """
    length = METRES[unit] if unit is not None and sized else None
    motions = inverse(flange) if seen.in_hand else flange
    weights = np.ones(len(motions))
    turned = np.zeros(len(motions), bool)
    turn = seen.half_turn
    if turn is not None:
        turned = _half_turned(motions, seen.boards, turn)
    for _ in range(rounds):
        boards = seen.boards
        if turn is not None:
            boards = np.where(turned[:, None, None], boards @ turn, boards)
        x, y, scale = closed_form(motions, boards, weights, length)
        misses = _misses(x, y, scale, motions, boards, seen.ends)
        if turn is not None:
            others = _misses(x, y, scale, motions, boards @ turn, seen.ends)
            turned = turned ^ (others < 0.7 * misses)
            misses = np.minimum(misses, others)
        misfit = float(np.median(misses))
        weights = 1.0 / (1.0 + (misses / (3.0 * misfit + 1e-9)) ** 2) ** 2
    if turn is not None and turned[0]:  # from which end is free: the first picture's
        half = turn.copy()
        half[:3, 3] *= scale
        y = y @ half
        turned = ~turned
    lengths = max(scale, 1e-9)
    unit = unit or min(_UNITS, key=lambda name: abs(np.log(lengths / METRES[name])))
    camera = x.copy()
    board = y.copy()
    camera[:3, 3] /= METRES[unit]
    board[:3, 3] /= METRES[unit]
    size = float(np.log(lengths / METRES[unit]))
    if scale <= 0.0:  # a board behind the camera
        size = -np.inf
    return Start(camera, board, unit, size, misfit, misses, turned)


def _half_turned(motions: Array, boards: Array, turn: Array) -> Mask:
    """Which boards (n,) are numbered from their other end.

    Turns between two pictures are as large as the flange's, wherever camera and board are: the
    leading eigenvector of how much better a pair fits turned.
    """
    flat = motions[:, :3, :3].reshape(-1, 9)
    plain = boards[:, :3, :3].reshape(-1, 9)
    other = (boards @ turn)[:, :3, :3].reshape(-1, 9)
    wanted = flat @ flat.T
    alike = np.abs(wanted - other @ plain.T) - np.abs(wanted - plain @ plain.T)
    vector = np.linalg.eigh(alike)[1][:, -1]
    return np.asarray(vector * vector[np.abs(vector).argmax()] < 0)


def _misses(
    x: Array, y: Array, scale: float, motions: Array, boards: Array, ends: Array
) -> Array:
    """Distance [rad] between the board's ends as seen and as predicted, rms of each picture."""
    predicted = inverse(x) @ motions @ y
    size = scale if abs(scale) > 1e-12 else 1e-12
    away = (
        ends @ np.swapaxes(predicted[:, :3, :3], 1, 2)
        + predicted[:, None, :3, 3] / size
    )
    there = ends @ np.swapaxes(boards[:, :3, :3], 1, 2) + boards[:, None, :3, 3]
    depth = np.maximum(away[:, :, 2:], 0.05 * there[:, :, 2:])
    gap = away[:, :, :2] / depth - there[:, :, :2] / there[:, :, 2:]
    return np.asarray(np.minimum(np.sqrt((gap**2).sum(axis=2).mean(axis=1)), 3.0))


def choose(
    every: Iterable[Reading],
    seen: Seen,
    unit: str | None = None,
    rotation: str | None = None,
    degrees: bool | None = None,
) -> tuple[Reading, Start, Convention, list[str]]:
    """The reading that fits best, its closed form, what is told, and readings that fit as well.

    unit, rotation, degrees : what is said of the table; by default all are tried
    Raises OptionError where no reading is left.
    """
    angles = None if degrees is None else ("deg" if degrees else "rad")
    some = [
        reading
        for reading in every
        if rotation in (None, reading.rotation)
        and angles in (None, reading.angles or angles)
    ]
    if not some:
        raise OptionError(
            f"rotation {rotation!r} is none of the poses: expected one of {', '.join(ROTATIONS)} "
            "that has as many numbers"
        )
    starts = [solve(reading.flange, seen, 1, unit) for reading in some]
    least = min(start.misfit for start in starts)
    for k, reading in enumerate(some):
        if starts[k].misfit < _NEAR_BEST * least:
            starts[k] = solve(reading.flange, seen, unit=unit)
    order = sorted(range(len(some)), key=lambda k: starts[k].rank)
    best = order[0]
    tied = [k for k in order if starts[k].rank < TIED * starts[best].rank]
    best = next((k for k in tied if some[k].said and not some[k].inverse), best)
    floor = max(starts[best].rank, 1e-12)
    others = [k for k in order if k != best]
    ratio = min((starts[k].rank / floor for k in others), default=np.inf)
    reading = some[best]
    convention = Convention(
        unit=starts[best].unit,
        angles=reading.angles,
        rotation=reading.rotation,
        inverse=reading.inverse,
        ratio=float(ratio),
    )
    return reading, starts[best], convention, [some[k].words for k in tied if k != best]
