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
from typing import Protocol

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


class Motions(Protocol):
    """Where the flange was, as poses or joints say."""

    @property
    def count(self) -> int:
        """Number n of motions."""

    @property
    def size(self) -> int:
        """Number k of the arm's own parameters."""

    def poses(self, arm: Array) -> Array:
        """The flange in the base (n, 4, 4) [m] at parameters (k,)."""

    def slopes(self, arm: Array) -> Array:
        """Turn in the flange's axes and shift in the base's, (n, 6, k), by the parameters."""

    def take(self, rows: Index) -> Motions:
        """Some of the motions."""


@dataclass(frozen=True, eq=False)
class FlangePoses:
    """Motions that a controller tells."""

    table: Array  # (n, 4, 4) [m]
    size: int = 0

    @property
    def count(self) -> int:
        """Number of motions."""
        return len(self.table)

    def poses(self, arm: Array) -> Array:  # noqa: ARG002
        """The flange in the base (n, 4, 4) [m]."""
        return self.table

    def slopes(self, arm: Array) -> Array:  # noqa: ARG002
        """No parameters."""
        return np.zeros((self.count, SCENE, 0))

    def take(self, rows: Index) -> FlangePoses:
        """Some of the poses."""
        return FlangePoses(self.table[rows])


@dataclass(frozen=True)
class Layout:
    """Where the unknowns stand: six numbers for each frame, lenses, boards, the arm."""

    cameras: int
    boards: tuple[
        bool, ...
    ]  # whether each board is that of the cameras in the hand
    arm: int  # number of the arm's own parameters

    @property
    def frames(self) -> int:
        """Number of frames: the cameras', then the boards'."""
        return self.cameras + len(self.boards)

    @property
    def size(self) -> int:
        """Number s of unknowns."""
        lenses = LENS * self.cameras
        return 6 * self.frames + lenses + SHAPE * len(self.boards) + self.arm

    @property
    def errors(self) -> int:
        """Number e of errors of each motion: turn, shift, the focal length of each camera."""
        return SCENE + self.cameras

    def board_of(self, in_hand: bool) -> int:
        """Number of the board that a camera sees."""
        return self.boards.index(in_hand)

    def frame(self, number: int) -> Index:
        """A frame's turn and shift."""
        return 6 * number + np.arange(6)

    def lens(self, camera: int) -> Index:
        """A camera's lens."""
        return 6 * self.frames + LENS * camera + np.arange(LENS)

    def shape(self, board: int) -> Index:
        """A board's shape; the last is the log of its size."""
        first = 6 * self.frames + LENS * self.cameras
        return first + SHAPE * board + np.arange(SHAPE)

    @property
    def arm_values(self) -> Index:
        """The arm's own parameters."""
        return np.arange(self.size - self.arm, self.size)


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
        number = np.searchsorted(motions, self.motion[rows])
        return Corners(
            self.points[rows],
            self.pixels[rows],
            number,
            self.in_hand,
            self.outline,
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
    slopes: Array  # (N, 2, SCENE + LENS + SHAPE), by scene, lens and board
    # (n, SCENE + LENS + SHAPE, s + e), how these follow the unknowns
    chain: Array


@dataclass(frozen=True, eq=False)
class Bundle:
    """Corners that cameras see at the motions of an arm."""

    cameras: tuple[Corners, ...]
    motions: Motions

    @cached_property
    def layout(self) -> Layout:
        """Where the unknowns stand."""
        boards = tuple(dict.fromkeys(camera.in_hand for camera in self.cameras))
        return Layout(len(self.cameras), boards, self.motions.size)

    def take(self, rows: Index) -> Bundle:
        """What was seen at some motions."""
        return Bundle(
            tuple(camera.take(rows) for camera in self.cameras),
            self.motions.take(rows),
        )

    def predict(self, unknowns: Unknowns) -> list[Array]:
        """Pixels (N, 2) of each camera's corners."""
        return [sight.pixels for sight in self.sights(unknowns)]

    def sights(self, unknowns: Unknowns) -> list[Sight]:
        """What each camera sees."""
        arm = unknowns.values[self.layout.arm_values]
        poses = self.motions.poses(arm)
        slopes = self.motions.slopes(arm)
        return [
            self._sight(number, unknowns, poses, slopes)
            for number in range(len(self.cameras))
        ]

    def _sight(
        self, number: int, unknowns: Unknowns, flange: Array, by_arm: Array
    ) -> Sight:
        corners = self.cameras[number]
        layout = self.layout
        board = layout.board_of(corners.in_hand)
        x = unknowns.frames[number]
        y = unknowns.frames[layout.cameras + board]
        shape = unknowns.values[layout.shape(board)]
        lens = unknowns.values[layout.lens(number)]
        errors = unknowns.errors
        motion = flange.copy()
        motion[:, :3, :3] = motion[:, :3, :3] @ exponential(errors[:, :3])
        motion[:, :3, 3] += errors[:, 3:6]
        if corners.in_hand:
            motion = inverse(motion)
        arm_side = (
            inverse(x) @ motion
        )  # what is beyond the motion, before the camera
        scene = arm_side @ y
        scale = np.exp(shape[-1])
        points = scale * (corners.points + corners.bending @ shape[:-1])
        turns = scene[corners.motion, :3, :3]
        places = np.einsum("nij,nj->ni", turns, points)
        places += scene[corners.motion, :3, 3]
        focus = np.exp(errors[corners.motion, SCENE + number])
        pixels, by_point, by_lens = project(lens, focus, places)
        inward = by_point @ turns
        slopes = np.concatenate(
            [
                np.cross(places[:, None], by_point),
                by_point,
                by_lens,
                scale * inward @ corners.bending,
                inward @ points[:, :, None],
            ],
            axis=2,
        )
        rigid = scene_slopes(x, arm_side, scene, corners.in_hand)
        chain = np.zeros(
            (len(flange), slopes.shape[2], layout.size + layout.errors)
        )
        own_lens = np.arange(SCENE, SCENE + LENS)
        chain[:, :SCENE, layout.frame(number)] = rigid[:, :, :6]
        chain[:, :SCENE, layout.frame(layout.cameras + board)] = rigid[
            :, :, 6:12
        ]
        chain[:, :SCENE, layout.arm_values] = rigid[:, :, 12:] @ by_arm
        chain[:, own_lens, layout.lens(number)] = 1.0
        chain[:, SCENE + LENS + np.arange(SHAPE), layout.shape(board)] = 1.0
        chain[:, :SCENE, layout.size : layout.size + 6] = rigid[:, :, 12:]
        chain[:, own_lens[:2], layout.size + SCENE + number] = lens[:2]
        return Sight(pixels, slopes, chain)


def scene_slopes(
    x: Array, arm_side: Array, scene: Array, in_hand: bool
) -> Array:
    """How a scene turns and shifts (n, 6, 18) by its camera, its board and the flange's errors.

    x : (4, 4), camera;  arm_side, scene : (n, 4, 4), before the camera, without and with the board
    """
    back = np.broadcast_to(x[:3, :3].T, (len(scene), 3, 3))
    onward = arm_side[:, :3, :3]
    turned = scene[:, :3, :3]
    by_camera = [
        _about(-np.eye(3) + 0.0 * back, 0.0 * scene[:, :3, 3]),
        _along(-back),
    ]
    by_board = [_about(turned, scene[:, :3, 3]), _along(onward)]
    if in_hand:
        flange = np.broadcast_to(-(back[0] @ x[:3, 3]), (len(scene), 3))
        by_errors = [_about(-back, flange), _along(-onward)]
    else:
        by_errors = [_about(onward, arm_side[:, :3, 3]), _along(back)]
    return np.concatenate([*by_camera, *by_board, *by_errors], axis=2)


def _about(axes: Array, centre: Array) -> Array:
    """Scene's motion (n, 6, 3) by a turn about axes (n, 3, 3) at a centre (n, 3)."""
    return np.concatenate([axes, cross_matrix(centre) @ axes], axis=1)


def _along(axes: Array) -> Array:
    """Scene's motion (n, 6, 3) by a shift along axes (n, 3, 3)."""
    return np.concatenate([np.zeros_like(axes), axes], axis=1)


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
    out[:, 0, -2] = half * flat[:, 0]
    out[:, 1, -2] = -half * flat[:, 1]
    out[:, 0, -1] = half * flat[:, 1]
    out[:, 1, -1] = half * flat[:, 0]
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
    motion = np.concatenate([camera.motion for camera in cameras])
    away = np.concatenate(
        [
            camera.pixels - seen
            for camera, seen in zip(cameras, pixels, strict=True)
        ]
    )
    counts = np.bincount(motion)
    squares = np.bincount(motion, (away**2).sum(axis=1))
    return np.asarray(np.sqrt(squares / np.maximum(counts, 1)))
