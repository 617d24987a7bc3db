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

import numpy as np

from ..arm.rotations import cross_matrix
from ..common.arrays import Array, Index
from .pictures import opencv
from .rigid import inverse, shift_of, step_from, turn_of

LENS = 9
"""Numbers of a lens: focal lengths, centre, k1, k2, p1, p2, k3."""

BENDS = [(i, k - i) for k in (2, 3, 4) for i in range(k + 1)]
"""Powers of a board's x and y in the terms of its height."""

SHAPE = len(BENDS) + 3
"""Numbers of a board: heights, stretch and shear [half diagonals], log of its size as printed."""

POSE = 6
"""Numbers of a small motion: turn [rad] and shift [m]."""


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
        return np.zeros((len(self.rows), POSE, 0))

    def take(self, rows: Index) -> Motions:
        """Some of the motions."""
        return replace(self, rows=self.rows[rows])


class Layout:
    """Where the unknowns stand: frames, lenses, shapes of boards, the arm; then a motion's errors.

    frames : (cameras + boards, 6);  lenses : (cameras, 9);  shapes : (boards, SHAPE);  arm : (k,)
    size : number s of unknowns;  errors : number e of errors of each motion, its turn, its shift
        and the focal length of each camera
    """

    def __init__(self, cameras: int, boards: int, arm: int) -> None:
        self.size = 0
        self.errors = POSE + cameras
        self.frames = self._places(cameras + boards, POSE)
        self.lenses = self._places(cameras, LENS)
        self.shapes = self._places(boards, SHAPE)
        self.arm = self._places(1, arm)[0]

    def _places(self, count: int, width: int) -> Index:
        first = self.size
        self.size += count * width
        return np.arange(first, self.size).reshape(count, width)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is fitted."""

    frames: Array  # (f, 4, 4), of cameras, then of boards [m]
    values: Array  # (s,), those of the frames are not used
    # (n, e), turn [rad], shift [m] and log of focal lengths at each motion
    errors: Array

    def moved(self, step: Array, errors: Array) -> Unknowns:
        """The unknowns after a step (s,) and one of the errors (n, e)."""
        width = POSE * len(self.frames)
        steps = step[:width].reshape(-1, POSE)
        frames = step_from(self.frames, steps)
        return Unknowns(frames, self.values + step, self.errors + errors)

    def exact(self, count: int) -> Unknowns:
        """The unknowns with exact motions, so many."""
        return replace(self, errors=np.zeros((count, self.errors.shape[1])))


@dataclass(frozen=True, eq=False)
class Sight:
    """What cameras see of all corners, and how that follows the unknowns."""

    pixels: Array  # (N, 2)
    by_scene: Array  # (N, 2, 6), slopes by turn and shift of what is before the camera
    slopes: Array  # (N, 2, s + e), by the unknowns and the errors of the corner's motion


@dataclass(frozen=True, eq=False)
class Bundle:
    """Corners that cameras see at the motions of an arm, by camera and motion."""

    motions: Motions
    in_hand: Sequence[bool]  # (c,), which cameras are in the hand
    points: Array  # (N, 3), in the board's frame, as printed [m]
    bends: Array  # (N, 3, SHAPE - 1), how they follow the board's shape
    pixels: Array  # (N, 2)
    camera: Index  # (N,), that sees the corner
    motion: Index  # (N,), at which it is seen

    @cached_property
    def boards(self) -> list[int]:
        """The board that each camera sees: one is seen by cameras in the hand, one by others."""
        first = self.in_hand[0]
        return [int(in_hand != first) for in_hand in self.in_hand]

    @cached_property
    def layout(self) -> Layout:
        """Where the unknowns stand."""
        cameras = len(self.in_hand)
        return Layout(cameras, max(self.boards) + 1, self.motions.size)

    @cached_property
    def pictures(self) -> list[Index]:
        """The corners of each picture."""
        steps = np.diff(self.camera) + np.diff(self.motion)
        ends = np.flatnonzero(steps) + 1
        return np.split(np.arange(len(self.pixels)), ends)

    def take(self, motions: Index) -> Bundle:
        """What was seen at some motions, which are numbered anew."""
        rows = np.isin(self.motion, motions)
        return replace(
            self,
            motions=self.motions.take(motions),
            points=self.points[rows],
            bends=self.bends[rows],
            pixels=self.pixels[rows],
            camera=self.camera[rows],
            motion=np.searchsorted(motions, self.motion[rows]),
        )

    def misses(self, pixels: Array) -> Array:
        """Rms distance (n,) [px] of the corners at each motion from predicted pixels (N, 2)."""
        squares = ((self.pixels - pixels) ** 2).sum(axis=1)
        total = np.bincount(self.motion, squares)
        return np.asarray(np.sqrt(total / np.bincount(self.motion)))

    def look(self, unknowns: Unknowns) -> Sight:
        """What the cameras see."""
        arm = unknowns.values[self.layout.arm]
        poses = self.motions.poses(arm)
        flange = step_from(poses, unknowns.errors[:, :POSE])
        by_arm = self.motions.slopes(arm)
        cameras = range(len(self.in_hand))
        sights = [self._look(k, unknowns, flange, by_arm) for k in cameras]
        return Sight(*map(np.concatenate, zip(*sights, strict=True)))

    def _look(
        self, number: int, unknowns: Unknowns, flange: Array, by_arm: Array
    ) -> tuple[Array, Array, Array]:
        """Pixels, their slopes by the scene, and by the unknowns, of one camera."""
        layout = self.layout
        rows = self.camera == number
        motion = self.motion[rows]
        bends = self.bends[rows]
        in_hand = self.in_hand[number]
        board = self.boards[number]
        board_frame = board - max(self.boards) - 1
        x = unknowns.frames[number]
        y = unknowns.frames[board_frame]
        shape = unknowns.values[layout.shapes[board]]
        lens = unknowns.values[layout.lenses[number]]
        to_camera = inverse(x)
        moved = inverse(flange) if in_hand else flange
        # what is beyond the motion, before the camera
        arm_side = to_camera @ moved
        scenes = arm_side @ y
        scene = scenes[motion]
        turns = turn_of(scene)
        scale = np.exp(shape[-1])
        points = self.points[rows] + bends @ shape[:-1]
        points *= scale
        places = np.einsum("nij,nj->ni", turns, points)
        places += shift_of(scene)
        focal = POSE + number
        focus = np.exp(unknowns.errors[motion, focal])
        pixels, by_point, by_lens = project(lens, focus, places)
        by_turn = np.cross(places[:, None], by_point)
        by_scene = np.concatenate([by_turn, by_point], axis=2)
        by_place = by_point @ turns
        flange_slopes = follow(to_camera, flange, in_hand)
        camera_slopes = follow(np.eye(4), x, inverted=True)
        board_slopes = follow(arm_side, y)
        by_errors = by_scene @ flange_slopes[motion]
        width = layout.size + layout.errors
        slopes = np.zeros((len(points), 2, width))
        slopes[..., layout.frames[number]] = by_scene @ camera_slopes
        by_board = by_scene @ board_slopes[motion]
        slopes[..., layout.frames[board_frame]] = by_board
        slopes[..., layout.lenses[number]] = by_lens
        *bend_columns, size_column = layout.shapes[board]
        slopes[..., bend_columns] = scale * by_place @ bends
        by_size = by_place @ points[:, :, None]
        slopes[..., [size_column]] = by_size
        slopes[..., layout.arm] = by_errors @ by_arm[motion]
        # the errors stand behind the unknowns
        error_slopes = slopes[..., layout.size :]
        error_slopes[..., :POSE] = by_errors
        error_slopes[..., focal] = by_lens[..., :2] @ lens[:2]
        return pixels, by_scene, slopes


def follow(before: Array, frame: Array, inverted: bool = False) -> Array:
    """How a scene ``before @ frame @ ..`` turns and shifts (.., 6, 6) with a frame (.., 4, 4).

    The frame turns about its own axes and shifts along its parent's; where `inverted`, the scene
    is ``before @ inverse(frame) @ ..``.
    """
    through = before if inverted else before @ frame
    turn = turn_of(through)
    along = turn_of(before)
    if inverted:
        turn = -turn
        along = turn @ np.swapaxes(turn_of(frame), -1, -2)
    arms = cross_matrix(shift_of(through))
    shape = np.broadcast_shapes(turn.shape, along.shape)
    slopes = np.zeros((*shape[:-2], POSE, POSE))
    slopes[..., :3, :3] = turn
    slopes[..., 3:, :3] = arms @ turn
    slopes[..., 3:, 3:] = along
    return slopes


def bending(points: Array, outline: Array) -> Array:
    """How points (N, 3) of a board of points (k, 3) [m] follow heights, stretch and shear."""
    low = outline.min(axis=0)
    high = outline.max(axis=0)
    half = float(np.linalg.norm(high - low)) / 2
    middle = (low + high) / 2

    def terms(places: Array) -> tuple[Array, Array]:
        """A plane's terms (k, 3), x, y and 1, and those of heights."""
        flat = (places - middle) / half
        x, y, _ = flat.T
        flat[:, 2] = 1.0
        heights = [x**i * y**k for i, k in BENDS]
        return flat, np.column_stack(heights)

    # a plane is the board's place
    level = np.linalg.lstsq(*terms(outline), rcond=None)[0]
    plane, heights = terms(points)
    bent = heights - plane @ level
    x, y, _ = half * plane.T
    out = np.zeros((len(points), 3, SHAPE - 1))
    out[:, 2, :-2] = half * bent
    out[:, :2, -2] = np.column_stack([x, -y])
    out[:, :2, -1] = np.column_stack([y, x])
    return out


def project(
    lens: Array, focus: Array, points: Array
) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points (N, 3) [m] before a camera, their slopes by point and by lens.

    focus : (N,), factors of the focal lengths
    """
    origin = np.zeros(3)
    centre = lens[2:4]
    matrix = np.diag([*lens[:2], 1.0])
    matrix[:2, 2] = centre
    pixels, slopes = opencv().projectPoints(
        points[:, None], origin, origin, matrix, lens[4:]
    )
    factors = focus[:, None]
    pixels = pixels[:, 0] - centre
    slopes = slopes.reshape(len(points), 2, -1)
    slopes = slopes * factors[:, None]
    by_centre = slopes[..., 8:10]
    by_centre /= factors[:, None]
    pixels = centre + factors * pixels
    return pixels, slopes[..., 3:6], slopes[..., 6:15]
