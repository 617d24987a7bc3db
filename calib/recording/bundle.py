"""Bundle: pixels of boards' corners at the motions of an arm, and their derivatives.

A point p of a board appears at ``lens(X^-1 M Y p)``, and the board before the camera is the scene
B = X^-1 M Y.  A camera in the hand has M = (G E)^-1, X the camera in the flange and Y the board in
the base; a camera at rest has M = G E, X the camera in the base and Y the board in the
flange.  G is the flange in the base, E its error at that motion; besides, each camera's focal
length may have an error at each motion (autofocus).  Steps of X, Y and G are along their own axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.rigid import adjoint, inverse, shift_of, step_from, turn_of
from ..common.arrays import Array, Index
from ..common.rows import group_means, row_lengths
from ..samples.lens import Lens
from ..samples.motion import RowArrays
from .pictures import opencv

LENS_SIZE = 9
"""Parameters of a lens: focal lengths, centre, k1, k2, p1, p2, k3."""

BENDS = [(i, k - i) for k in (2, 3, 4) for i in range(k + 1)]
"""Powers of a board's x and y in the terms of its height."""

SHAPE_SIZE = len(BENDS) + 3
"""Parameters of a board: heights, stretch and shear [half diagonals], log of its printed size."""

BY_POINT = slice(3, 6)
BY_LENS = slice(6, 15)
CENTRE = slice(8, 10)
"""Columns of OpenCV's slopes of pixels."""

POSE_SIZE = 6
"""Parameters of a small motion: turn [rad] and shift [m]."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Poses of the flange as a controller reports them; those by joints: :mod:`.joint_motions`."""

    values: Array  # (n, 4, 4), the flange in the base [m]; of joints (n, dof)

    @property
    def count(self) -> int:
        """Number n of motions."""
        return len(self.values)

    @property
    def size(self) -> int:
        """Number k of the arm's own parameters."""
        return 0

    def poses(self, arm: Array) -> Array:  # noqa: ARG002
        """The flange in the base (n, 4, 4) [m] at parameters (k,)."""
        return self.values

    def slopes(self, arm: Array) -> Array:  # noqa: ARG002
        """Steps of the flange, (n, 6, k), by the parameters."""
        return np.zeros((self.count, POSE_SIZE, 0))

    def take(self, rows: Index) -> Motions:
        """Some of the motions."""
        return replace(self, values=self.values[rows])


class CornerLayout:
    """Indices of the unknowns: frames, lenses, shapes of boards, the arm; then a motion's errors.

    frames : (cameras + boards, 6);  lenses : (cameras, 9)
    shapes : (boards, SHAPE_SIZE);  arm : (k,)
    size : number s of unknowns;  errors : number e of errors of each motion, its turn, its shift
        and the focal length of each camera
    """

    def __init__(self, cameras: int, boards: int, arm: int) -> None:
        self.size = 0
        self.errors = POSE_SIZE + cameras
        self.frames = self._indices(cameras + boards, POSE_SIZE)
        self.lenses = self._indices(cameras, LENS_SIZE)
        self.shapes = self._indices(boards, SHAPE_SIZE)
        self.arm = self._indices(1, arm)[0]

    def _indices(self, count: int, width: int) -> Index:
        first = self.size
        self.size += count * width
        return np.arange(first, self.size).reshape(count, width)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Values of all that is fitted."""

    frames: Array  # (f, 4, 4), of cameras, then of boards [m]
    values: Array  # (s,), those of the frames are not used
    # (n, e), turn [rad], shift [m] and log of focal lengths at each motion
    errors: Array

    def retract(self, step: Array, errors: Array) -> Unknowns:
        """The unknowns after a step (s,), and one of the errors (n, e)."""
        steps = step[: POSE_SIZE * len(self.frames)].reshape(-1, POSE_SIZE)
        frames = step_from(self.frames, steps)
        return Unknowns(frames, self.values + step, self.errors + errors)

    def with_zero_errors(self, count: int) -> Unknowns:
        """The unknowns at a number of motions without errors."""
        return replace(self, errors=np.zeros((count, self.errors.shape[1])))


@dataclass(frozen=True, eq=False)
class PredictedCorners:
    """Pixels of all corners, and their derivatives."""

    pixels: Array  # (N, 2)
    # (N, 2, s + e), by the unknowns and by the errors of the corner's motion
    slopes: Array


@dataclass(frozen=True, eq=False)
class Bundle(RowArrays):
    """Corners that cameras see at the motions of an arm, by camera and motion."""

    motions: Motions
    in_hand: Sequence[bool]  # (c,), which cameras are in the hand
    points: Array  # (N, 3), in the board's frame, as printed [m]
    # (N, 3, SHAPE_SIZE - 1), derivatives of the points by the board's shape
    bends: Array
    pixels: Array  # (N, 2)
    camera: Index  # (N,), that sees the corner
    motion: Index  # (N,), at which it is seen

    @cached_property
    def boards(self) -> list[int]:
        """Number of the board that each camera sees: those in the hand see one, others another."""
        first = self.in_hand[0]
        return [int(in_hand != first) for in_hand in self.in_hand]

    @cached_property
    def layout(self) -> CornerLayout:
        """Indices of the unknowns."""
        cameras = len(self.in_hand)
        return CornerLayout(cameras, max(self.boards) + 1, self.motions.size)

    @cached_property
    def pictures(self) -> list[Index]:
        """The corners of each picture."""
        steps = np.diff(self.camera) + np.diff(self.motion)
        ends = np.flatnonzero(steps) + 1
        return np.split(np.arange(len(self.pixels)), ends)

    def frame_numbers(self, camera: int) -> tuple[int, int]:
        """Numbers of the frames of a camera and of the board that it sees."""
        return camera, len(self.in_hand) + self.boards[camera]

    def at_motions(self, motions: Index) -> Bundle:
        """The corners at some motions (k,), which are numbered from 0."""
        corners = self.take(np.isin(self.motion, motions))
        return replace(
            corners,
            motions=self.motions.take(motions),
            motion=np.searchsorted(motions, corners.motion),
        )

    def misses(self, pixels: Array) -> Array:
        """Rms distance (n,) [px] of the corners at each motion from predicted pixels (N, 2)."""
        squares = ((self.pixels - pixels) ** 2).sum(axis=1)
        return np.sqrt(group_means(self.motion, squares))

    def usual_misses(self, pixels: Array) -> Array:
        """Median distance (n,) [px] of the corners at each motion: one outlier hardly moves it."""
        from scipy.ndimage import median

        distances = row_lengths(self.pixels - pixels)
        numbers = np.arange(self.motions.count)
        return np.array(median(distances, self.motion, numbers))

    def predict(self, unknowns: Unknowns) -> PredictedCorners:
        """Pixels of all corners and their slopes at some values of the unknowns."""
        arm = unknowns.values[self.layout.arm]
        poses = self.motions.poses(arm)
        flange = step_from(poses, unknowns.errors[:, :POSE_SIZE])
        by_arm = self.motions.slopes(arm)
        cameras = range(len(self.in_hand))
        by_camera = [
            self._predict_camera(k, unknowns, flange, by_arm) for k in cameras
        ]
        return PredictedCorners(
            *map(np.concatenate, zip(*by_camera, strict=True))
        )

    def _predict_camera(
        self, camera: int, unknowns: Unknowns, flange: Array, by_arm: Array
    ) -> tuple[Array, Array]:
        """Pixels (m, 2) of one camera's corners, and their slopes (m, 2, s + e).

        flange : (n, 4, 4) [m], at each motion;  by_arm : (n, 6, k), its slopes by the arm
        """
        layout = self.layout
        camera_frame, board_frame = self.frame_numbers(camera)
        *bend_columns, size_column = layout.shapes[self.boards[camera]]
        focus_column = layout.size + POSE_SIZE + camera
        corners = self.camera == camera
        motion = self.motion[corners]
        bends = self.bends[corners]
        lens = unknowns.values[layout.lenses[camera]]

        # corners in the board's frame, as it is bent and sized
        size = np.exp(unknowns.values[size_column])
        bent = self.points[corners] + bends @ unknowns.values[bend_columns]
        points = size * bent

        # the board before the camera, and its steps by those of X, Y and G E
        to_camera = inverse(unknowns.frames[camera_frame])
        if self.in_hand[camera]:
            before_board = to_camera @ inverse(flange)
            flange_steps = -adjoint(np.broadcast_to(to_camera, flange.shape))
        else:
            before_board = to_camera @ flange
            flange_steps = adjoint(before_board)
        scenes = before_board @ unknowns.frames[board_frame]
        board_steps = adjoint(scenes)
        turns = turn_of(scenes)[motion]
        places = np.einsum("nij,nj->ni", turns, points)
        places += shift_of(scenes)[motion]

        # in the picture, and slopes by the scene and by the flange
        focus = np.exp(unknowns.errors[motion, POSE_SIZE + camera])
        pixels, by_place, by_lens = project(lens, focus, places)
        by_turn = np.cross(places[:, None], by_place)
        by_scene = np.concatenate([by_turn, by_place], axis=2)
        by_point = by_place @ turns
        by_flange = by_scene @ flange_steps[motion]

        # columns of the unknowns, then of the motion's errors
        slopes = np.zeros((len(points), 2, layout.size + layout.errors))
        slopes[..., layout.frames[camera_frame]] = -by_scene
        slopes[..., layout.frames[board_frame]] = by_scene @ board_steps[motion]
        slopes[..., layout.lenses[camera]] = by_lens
        slopes[..., bend_columns] = size * by_point @ bends
        slopes[..., [size_column]] = by_point @ points[:, :, None]
        slopes[..., layout.arm] = by_flange @ by_arm[motion]
        slopes[..., layout.size : layout.size + POSE_SIZE] = by_flange
        slopes[..., focus_column] = by_lens[..., :2] @ lens[:2]
        return pixels, slopes


def shape_slopes(points: Array) -> Array:
    """Slopes (N, 3, SHAPE_SIZE - 1) of a board's points (N, 3) [m]: heights, stretch and shear."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    half = float(np.linalg.norm(high - low)) / 2
    plane = (points - (low + high) / 2) / half
    x, y, _ = plane.T
    heights = np.column_stack([x**i * y**k for i, k in BENDS])
    # over the plane that fits them, which the board's frame follows
    plane[:, 2] = 1.0
    level = np.linalg.lstsq(plane, heights, rcond=None)[0]
    slopes = np.zeros((len(points), 3, SHAPE_SIZE - 1))
    slopes[:, 2, :-2] = half * (heights - plane @ level)
    slopes[:, :2, -2] = half * np.column_stack([x, -y])
    slopes[:, :2, -1] = half * np.column_stack([y, x])
    return slopes


def project(
    lens: Array, focus: Array, points: Array
) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points (N, 3) [m] before a camera, and their slopes by point and by lens.

    lens : (9,);  focus : (N,), factors of the focal lengths;  slopes : (N, 2, 3) and (N, 2, 9)
    """
    origin = np.zeros(3)
    camera = Lens.of((0, 0), lens)
    centre = camera.centre
    pixels, slopes = opencv().projectPoints(
        points[:, None], origin, origin, camera.matrix, camera.distortion
    )
    factors = focus[:, None]
    pixels = centre + factors * (pixels[:, 0] - centre)

    # a factor of the focal lengths moves no centre
    slopes = slopes.reshape(len(points), 2, -1) * factors[:, None]
    slopes[..., CENTRE] /= factors[:, None]
    return pixels, slopes[..., BY_POINT], slopes[..., BY_LENS]
