"""Pictures of a board that an arm took, or held: corners, poses, and the log that they make."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import cross_matrix, exponential, logarithm, quaternion_of
from ..common.arrays import Array, Index, Mask
from ..common.wording import listed
from ..errors import LogError, OptionError
from ..samples.recorded import Recorded
from .board import LEAST_CORNERS, Board, BoardFinder
from .joint_table import JointTable, match_rows, read_joints
from .lens import Lens, calibrate_lens
from .lerobot import is_dataset, read_dataset
from .pictures import Picture, list_pictures, read_series
from .reference import Pose, find_pose

LEAST = 6
"""Pictures of the board that tell where it is."""

_LOOKED = 4  # pictures in which another board, or a mirrored one, is looked for
_AHEAD = 2.0  # diagonals of the board; a picture tells where the camera looks ten times better than
# where it is: of 24 rendered pictures .2 mm instead of .5, of which tilt and place are one

Source = str | os.PathLike[str] | Sequence[Picture]
"""A folder or pattern of pictures, a LeRobotDataset, or grey pictures (height, width)."""


@dataclass(frozen=True, eq=False)
class BoardPictures:
    """Corners that pictures show, and the joints at which they were taken."""

    board: Board
    joint_names: tuple[str, ...]
    names: tuple[str, ...]  # of the pictures
    q: Array  # (p, dof) [rad or m]
    corners: tuple[Mapping[int, Array], ...]  # place (2,) [px] by number
    size: tuple[int, int]  # width and height [px]
    count: int  # pictures, with those that do not show the board
    notes: tuple[str, ...]
    episodes: Index | None = None  # (p,), the series that each is of

    def _poses(self, lens: Lens) -> tuple[Array, list[Pose]]:
        """Corners (n, 3) of all pictures in OpenCV's frame of the board [m], and its poses."""
        world = np.asarray(self.board.opencv().getChessboardCorners(), float)
        each = [(world[list(c)], np.array([*c.values()])) for c in self.corners]
        return np.concatenate([points for points, _ in each]), [find_pose(lens, *c) for c in each]

    def seen(self, lens: Lens, in_hand: bool) -> BoardViews:
        """Where the board is in each picture, seen through a lens."""
        corners, poses = self._poses(lens)
        places = np.concatenate([np.array([*found.values()]) for found in self.corners])
        views = BoardViews(
            self.names,
            self.q,
            np.array([np.concatenate([p.shift, logarithm(p.rotation)]) for p in poses]),
            np.repeat(np.arange(len(poses)), [len(found) for found in self.corners]),
            corners,
            float(lens.focal.mean()) * lens.undistort(places) + lens.centre,
            False,
        )
        return views.other_way() if in_hand else views

    def lens(self, known: Lens | None) -> tuple[Lens, tuple[str, ...]]:
        """The camera's lens, calibrated by the same pictures where it is not known; and doubts."""
        if known is not None:
            return known, ()
        return calibrate_lens(self.corners, self.board, self.size)

    def log(self, lens: Lens, in_hand: bool) -> Recorded:
        """The pictures as a log of poses of what is in the hand, in the frame of the other.

        The point that it tells is ahead of the camera, or in the middle of the board.
        """
        poses, (width, height) = self._poses(lens)[1], self.board.size
        turns, shift = np.array([p.rotation for p in poses]), np.array([p.shift for p in poses])
        if in_hand:
            at, sign = np.array([0.0, 0.0, _AHEAD * float(np.hypot(width, height))]), -1.0
            back, arm = np.swapaxes(turns, 1, 2), at - shift
            turns, x = back, np.einsum("pij,pj->pi", back, arm)
        else:
            at, sign = np.array([width / 2, height / 2, 0.0]), 1.0
            back, arm = np.eye(3), turns @ at
            x = arm + shift
        # a small turn and a shift of the board, in the camera's axes, move and turn what is told
        change = np.zeros((len(x), 6, 6))
        change[:, :3, :3], change[:, :3, 3:] = -sign * back @ cross_matrix(arm), sign * back
        change[:, 3:, :3] = sign * back
        covariance = change @ np.array([p.covariance[:6, :6] for p in poses])
        covariance = covariance @ np.swapaxes(change, 1, 2)
        source = {
            "source": "board", "eye": "hand" if in_hand else "base", "board": self.board.text,
            "point": at.tolist(), "size": list(self.size), "lens": lens.to_json(),
        }  # fmt: skip
        return Recorded(
            self.joint_names, self.q, x, source=source,
            noise=float(np.sqrt(np.einsum("njj->n", covariance[:, :3, :3]).mean() / 3)),
            quaternion=quaternion_of(turns), covariance=covariance, pictures=self.names,
            notes=self.notes,
            episodes=None if self.episodes is None else self.episodes.astype(float),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class BoardViews:
    """What is in the hand seen from what stands still, and the corners that tell it."""

    names: tuple[str, ...]  # of the pictures
    q: Array  # (p, dof) [rad or m]
    poses: Array  # (p, 6), shift [m] and rotation vector
    rows: Index  # (n,), the picture of each corner
    corners: Array  # (n, 3), in the board's frame [m]
    pixels: Array  # (n, 2), where a lens without distortion shows them
    in_hand: bool  # whether the camera is

    @property
    def each(self) -> Array:
        """Joints and corner (n, dof + 3) of each pixel, as the fit takes them."""
        return np.column_stack([self.q[self.rows], self.corners])

    def other_way(self) -> BoardViews:
        """The same with camera and board exchanged."""
        back = np.swapaxes(exponential(self.poses[:, 3:]), 1, 2)
        shift = -np.einsum("pij,pj->pi", back, self.poses[:, :3])
        poses = np.concatenate([shift, -self.poses[:, 3:]], axis=1)
        return replace(self, poses=poses, in_hand=not self.in_hand)

    def take(self, kept: Mask) -> BoardViews:
        """The pictures of a mask (p,)."""
        own = kept[self.rows]
        return replace(
            self,
            names=tuple(name for name, stays in zip(self.names, kept, strict=True) if stays),
            q=self.q[kept], poses=self.poses[kept],
            rows=(np.cumsum(kept) - 1)[self.rows[own]],
            corners=self.corners[own], pixels=self.pixels[own],
        )  # fmt: skip


def find_board(
    pictures: Source,
    joints: str | os.PathLike[str] | JointTable | None,
    board: Board | str,
    names: Sequence[str] | None = None,
    *,
    camera: str | None = None,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> BoardPictures:
    """Find a board in pictures.

    joints : a table or its file, one row for each picture; a dataset brings them
    names, degrees, prismatic : see `read_joints`
    camera : of a dataset with several
    Raises LogError if too few pictures show the board; what they show instead is told.
    """
    notes, damaged = list[str](), list[str]()
    board = Board.of(board)
    if is_dataset(pictures):
        joints, pictures, notes = read_dataset(str(pictures), names, camera)
    elif joints is None:
        raise OptionError("pictures need the joints beside them: expected `joints`")
    if not isinstance(joints, JointTable):
        joints = read_joints(joints, names, degrees=degrees, prismatic=prismatic)
    if isinstance(pictures, (str, os.PathLike)):
        pairs, notes = match_rows(joints, list_pictures(pictures))
        series = read_series([path for _, path in pairs], damaged)
        shots = ((pairs[k][1].name, pairs[k][0], grey) for k, grey in series)
    elif len(pictures) == len(joints.q):
        known = joints.pictures or [f"picture {k + 1}" for k in range(len(pictures))]
        shots = ((known[k], k, grey) for k, grey in enumerate(pictures))
    else:
        raise LogError(f"{len(pictures)} pictures and {len(joints.q)} rows of joints")
    finder, looked, size = BoardFinder(board), list[Picture](), (0, 0)
    found, missing = list[tuple[str, int, dict[int, Array]]](), list[str]()
    most = 0
    for name, row, grey in shots:
        corners = finder.find(grey)
        size = (grey.shape[1], grey.shape[0])
        most = max(most, len(corners))
        if len(corners) >= LEAST_CORNERS:
            found.append((name, row, corners))
        else:
            missing.append(name)
            looked += [grey] * (len(looked) < _LOOKED)
    count = len(found) + len(missing)
    if len(found) < LEAST:
        raise LogError(
            f"the board is in {len(found)} of {count} pictures (at most {most} corners, expected "
            f"{LEAST} with {LEAST_CORNERS} or more): {_instead(looked, board)}"
        )
    notes += damaged[:5]
    if missing:
        notes.append(f"no board in {len(missing)} pictures, left out: {listed(missing)}")
    rows = [row for _, row, _ in found]
    return BoardPictures(
        board, joints.names, tuple(name for name, _, _ in found), joints.q[rows],
        tuple(corners for *_, corners in found), size, count, tuple(notes),
        None if joints.episodes is None else joints.episodes[rows],
    )  # fmt: skip


def _instead(looked: Sequence[Picture], board: Board) -> str:
    """What pictures without the board show."""
    turned = replace(board, columns=board.rows, rows=board.columns)
    tried: list[tuple[str, Board, Callable[[Any], Any]]] = [
        ("the pictures are mirrored: turn that off in the camera's settings", board, np.fliplr),
        (f"they show a board of {turned.columns}x{turned.rows} squares", turned, np.asarray),
    ]
    for words, other, change in tried:
        finder = BoardFinder(other)
        if any(len(finder.find(np.ascontiguousarray(change(p)))) >= LEAST_CORNERS for p in looked):
            return words
    return "check the board's columns, rows and dictionary"
