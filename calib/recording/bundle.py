"""Bundle: what cameras see of boards at the motions of an arm, and how that follows the unknowns.

A point p of a board appears at ``lens(X^-1 M Y p)``.  A camera in the hand has M = (G E)^-1, X the
camera in the flange and Y the board in the base; a camera that stands still has M = G E, X the
camera in the base and Y the board in the flange.  G is the flange in the base, E its error at that
motion; besides, each camera's focal length may have an error at each motion (autofocus).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..arm.rotations import cross_matrix, exponential
from ..common.arrays import Array, Index
from .pictures import opencv
from .rigid import inverse

LENS = 9
"""Numbers of a lens: focal lengths, centre, k1, k2, p1, p2, k3."""

BENDS = [(i, k - i) for k in (2, 3, 4) for i in range(k + 1)]
"""Powers of a board's x and y in the terms of its height."""

SHAPE = len(BENDS) + 3
"""Numbers of a board: heights, stretch and shear [half diagonals], log of its size as printed."""

SCENE = 6
"""Numbers of a scene's motion before a camera: turn [rad] and shift [m]."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Where the flange was, as a controller says; of joints see :mod:`.joint_motions`."""

    rows: Array  # (n, 4, 4), the flange in the base [m]

    @property
    def size(self) -> int:
        """Number k of the arm's own parameters."""
        return 0

    def poses(self, arm: Array) -> Array:  # noqa: ARG002
        """The flange in the base (n, 4, 4) [m] at parameters (k,)."""
        return self.rows

    def slopes(self, arm: Array) -> Array:  # noqa: ARG002
        """Turn in the flange's axes and shift in the base's, (n, 6, k), by the parameters."""
        return np.zeros((len(self.rows), SCENE, 0))

    def take(self, rows: Index) -> Motions:
        """Some of the motions."""
        return replace(self, rows=self.rows[rows])


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the unknowns stand: frames, lenses, boards' shapes, the arm."""

    boards: tuple[bool, ...]  # whether it is that of the cameras in the hand
    frames: Index  # (f, 6), turn and shift of the cameras, then of the boards
    lenses: Index  # (c, LENS)
    shapes: Index  # (b, SHAPE), the last is the log of a board's size
    arm: Index  # (k,), the arm's own parameters

    @staticmethod
    def of(in_hand: Sequence[bool], arm: int) -> Layout:
        """The layout of cameras, in the hand or not, and so many parameters of the arm."""
        boards = tuple(dict.fromkeys(in_hand))
        cameras = len(in_hand)
        counts = [
            6 * (cameras + len(boards)),
            LENS * cameras,
            SHAPE * len(boards),
            arm,
        ]
        parts = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        return Layout(
            boards,
            frames=parts[0].reshape(-1, 6),
            lenses=parts[1].reshape(-1, LENS),
            shapes=parts[2].reshape(-1, SHAPE),
            arm=parts[3],
        )

    @property
    def size(self) -> int:
        """Number s of unknowns."""
        arrays = (self.frames, self.lenses, self.shapes, self.arm)
        return sum(array.size for array in arrays)

    @property
    def errors(self) -> int:
        """Number e of errors of each motion: turn, shift, the focal length of each camera."""
        return SCENE + len(self.lenses)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is fitted."""

    frames: Array  # (f, 4, 4) [m]
    values: Array  # (s,), those of the frames are not used
    # (n, e), turn [rad], shift [m] and log of focal lengths at each motion
    errors: Array

    def moved(self, step: Array, errors: Array) -> Unknowns:
        """The unknowns after a step (s,) and one of the errors (n, e)."""
        turns = step[: 6 * len(self.frames)].reshape(-1, 6)
        frames = self.frames.copy()
        frames[:, :3, :3] = frames[:, :3, :3] @ exponential(turns[:, :3])
        frames[:, :3, 3] += turns[:, 3:]
        return Unknowns(frames, self.values + step, self.errors + errors)

    def without_errors(self, count: int) -> Unknowns:
        """The unknowns with exact motions, so many."""
        return replace(self, errors=np.zeros((count, self.errors.shape[1])))


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners that one camera sees, in the order of the motions."""

    points: Array  # (N, 3), in the board's frame, as printed [m]
    pixels: Array  # (N, 2)
    motion: Index  # (N,), the motion of each
    in_hand: bool  # whether the camera is in the hand
    outline: Array  # (k, 3), all points of the board [m]

    def take(self, motions: Index) -> Corners:
        """The corners at some motions, which are numbered anew."""
        rows = np.isin(self.motion, motions)
        return replace(
            self,
            points=self.points[rows],
            pixels=self.pixels[rows],
            motion=np.searchsorted(motions, self.motion[rows]),
        )

    @cached_property
    def bending(self) -> Array:
        """How the points follow the board's shape (N, 3, SHAPE - 1)."""
        return bending(self.points, self.outline)

    def parts(self, count: int) -> list[slice]:
        """The corners of each of `count` motions."""
        ends = np.searchsorted(self.motion, np.arange(count + 1))
        return [slice(*pair) for pair in pairwise(ends)]


@dataclass(frozen=True, eq=False)
class Sight:
    """What a camera sees at all motions, and how that follows the unknowns."""

    pixels: Array  # (N, 2)
    by_scene: Array  # (N, 2, SCENE), slopes by turn and shift of what is before the camera
    slopes: Array  # (N, 2, s + e), by the unknowns and the errors of the corner's motion


@dataclass(frozen=True, eq=False)
class Bundle:
    """Corners that cameras see at the motions of an arm."""

    cameras: tuple[Corners, ...]
    motions: Motions

    @cached_property
    def layout(self) -> Layout:
        """Where the unknowns stand."""
        in_hand = [camera.in_hand for camera in self.cameras]
        return Layout.of(in_hand, self.motions.size)

    def take(self, rows: Index) -> Bundle:
        """What was seen at some motions."""
        cameras = tuple(camera.take(rows) for camera in self.cameras)
        return Bundle(cameras, self.motions.take(rows))

    def sights(self, unknowns: Unknowns) -> list[Sight]:
        """What each camera sees."""
        arm = unknowns.values[self.layout.arm]
        errors = unknowns.errors
        flange = self.motions.poses(arm).copy()
        flange[:, :3, :3] = flange[:, :3, :3] @ exponential(errors[:, :3])
        flange[:, :3, 3] += errors[:, 3:6]
        slopes = self.motions.slopes(arm)
        numbers = range(len(self.cameras))
        return [self._sight(k, unknowns, flange, slopes) for k in numbers]

    def _sight(
        self, number: int, unknowns: Unknowns, flange: Array, by_arm: Array
    ) -> Sight:
        corners = self.cameras[number]
        layout = self.layout
        board = layout.boards.index(corners.in_hand)
        board_frame = len(self.cameras) + board
        x = unknowns.frames[number]
        y = unknowns.frames[board_frame]
        shape = unknowns.values[layout.shapes[board]]
        lens = unknowns.values[layout.lenses[number]]
        motion = inverse(flange) if corners.in_hand else flange
        # what is beyond the motion, before the camera
        arm_side = inverse(x) @ motion
        scene = (arm_side @ y)[corners.motion]
        scale = np.exp(shape[-1])
        points = scale * (corners.points + corners.bending @ shape[:-1])
        turns = scene[:, :3, :3]
        places = np.einsum("nij,nj->ni", turns, points) + scene[:, :3, 3]
        focus = np.exp(unknowns.errors[corners.motion, SCENE + number])
        pixels, by_point, by_lens = project(lens, focus, places)
        by_turn = np.cross(places[:, None], by_point)
        by_scene = np.concatenate([by_turn, by_point], axis=2)
        inward = by_point @ turns
        by_camera = follow(np.eye(4), x, inverted=True)
        by_board = follow(arm_side, y)[corners.motion]
        by_flange = follow(inverse(x), flange, corners.in_hand)[corners.motion]
        by_errors = by_scene @ by_flange
        slopes = np.zeros((len(points), 2, layout.size + layout.errors))
        slopes[:, :, layout.frames[number]] = by_scene @ by_camera
        slopes[:, :, layout.frames[board_frame]] = by_scene @ by_board
        slopes[:, :, layout.lenses[number]] = by_lens
        slopes[:, :, layout.shapes[board, :-1]] = (
            scale * inward @ corners.bending
        )
        slopes[:, :, layout.shapes[board, -1:]] = inward @ points[:, :, None]
        slopes[:, :, layout.arm] = by_errors @ by_arm[corners.motion]
        slopes[:, :, layout.size : layout.size + SCENE] = by_errors
        slopes[:, :, layout.size + SCENE + number] = (
            by_lens[:, :, :2] @ lens[:2]
        )
        return Sight(pixels, by_scene, slopes)


def follow(before: Array, frame: Array, inverted: bool = False) -> Array:
    """How a scene ``before @ frame @ ..`` turns and shifts (.., 6, 6) with a frame (.., 4, 4).

    The frame turns about its own axes and shifts along its parent's; where `inverted`, the scene
    is ``before @ inverse(frame) @ ..``.
    """
    axes = before[..., :3, :3]
    if inverted:
        through = before
        turn = -axes
        along = turn @ np.swapaxes(frame[..., :3, :3], -1, -2)
    else:
        through = before @ frame
        turn = through[..., :3, :3]
        along = axes
    slopes = np.zeros(
        (*np.broadcast_shapes(turn.shape, along.shape)[:-2], 6, 6)
    )
    slopes[..., :3, :3] = turn
    slopes[..., 3:, :3] = cross_matrix(through[..., :3, 3]) @ turn
    slopes[..., 3:, 3:] = along
    return slopes


def bending(points: Array, outline: Array) -> Array:
    """How points (N, 3) of a board of points (k, 3) [m] follow heights, stretch and shear."""
    low = outline.min(axis=0)
    high = outline.max(axis=0)
    half = float(np.linalg.norm(high - low)) / 2

    def plane(places: Array) -> Array:
        flat: Array = (places - (low + high) / 2) / half
        flat[:, 2] = 1.0
        return flat

    def heights(flat: Array) -> Array:
        u, v, _ = flat.T
        return np.column_stack([u**i * v**k for i, k in BENDS])

    whole = plane(outline)
    # a plane is the board's place
    level = np.linalg.lstsq(whole, heights(whole), rcond=None)[0]
    flat = plane(points)
    out = np.zeros((len(points), 3, SHAPE - 1))
    out[:, 2, :-2] = half * (heights(flat) - flat @ level)
    out[:, :2, -2] = half * flat[:, :2] * (1.0, -1.0)
    out[:, :2, -1] = half * flat[:, 1::-1]
    return out


def project(
    lens: Array, focus: Array, points: Array
) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points (N, 3) [m] before a camera, their slopes by point and by lens.

    focus : (N,), factors of the focal lengths
    """
    origin = np.zeros(3)
    matrix = np.diag([lens[0], lens[1], 1.0])
    matrix[:2, 2] = lens[2:4]
    pixels, slopes = opencv().projectPoints(
        points.reshape(-1, 1, 3), origin, origin, matrix, lens[4:]
    )
    slopes = slopes.reshape(len(points), 2, -1) * focus[:, None, None]
    slopes[:, :, 8:10] /= focus[:, None, None]  # by the centre
    pixels = lens[2:4] + focus[:, None] * (pixels.reshape(-1, 2) - lens[2:4])
    return pixels, slopes[:, :, 3:6], slopes[:, :, 6:15]


def rms_by_motion(cameras: Sequence[Corners], pixels: Sequence[Array]) -> Array:
    """Rms distance (n,) [px] of the corners at each motion from predicted pixels."""
    pairs = zip(cameras, pixels, strict=True)
    away = np.concatenate([camera.pixels - seen for camera, seen in pairs])
    motion = np.concatenate([camera.motion for camera in cameras])
    squares = np.bincount(motion, (away**2).sum(axis=1))
    return np.asarray(np.sqrt(squares / np.maximum(np.bincount(motion), 1)))
