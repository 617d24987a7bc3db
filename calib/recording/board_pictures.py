"""Pictures of a board that an arm took, or held: corners, poses, and the log that they make."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import cross_matrix, quaternion_of
from ..common.arrays import Array, Index
from ..common.wording import listed
from ..errors import LogError, OptionError
from ..samples.samples import Samples
from .board import LEAST_CORNERS, Board, BoardFinder
from .joint_table import JointTable, read_joints, read_shots
from .lens import Lens, calibrate_lens
from .lerobot import is_dataset, read_dataset
from .pictures import Picture
from .reference import Pose, find_pose, turns_and_shifts

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

    @property
    def points(self) -> list[Array]:
        """The corners that each picture shows (n, 3), in OpenCV's frame of the board [m]."""
        world = np.asarray(self.board.opencv().getChessboardCorners(), float)
        return [world[list(found)] for found in self.corners]

    def poses(self, lens: Lens) -> list[Pose]:
        """Where the board is before the camera in each picture."""
        places = [np.array([*found.values()]) for found in self.corners]
        pairs = zip(self.points, places, strict=True)
        return [find_pose(lens, points, pixels) for points, pixels in pairs]

    def lens(self, known: Lens | None) -> tuple[Lens, tuple[str, ...]]:
        """The camera's lens, calibrated by the same pictures where it is not known; and doubts."""
        if known is not None:
            return known, ()
        return calibrate_lens(self.corners, self.board, self.size)

    def log(self, lens: Lens, in_hand: bool) -> Samples:
        """The pictures as a log of poses of what is in the hand, in the frame of the other.

        The point that it tells is ahead of the camera, or in the middle of the board.
        """
        poses, (width, height) = self.poses(lens), self.board.size
        turns, shift = held_poses(poses, in_hand)
        if in_hand:
            at = np.array([0.0, 0.0, _AHEAD * float(np.hypot(width, height))])
            sign, back, arm = -1.0, turns, at - np.array([pose.shift for pose in poses])
        else:
            at = np.array([width / 2, height / 2, 0.0])
            sign, back, arm = 1.0, np.eye(3), turns @ at
        # a small turn and a shift of the board, in the camera's axes, move and turn what is told
        change = np.zeros((len(turns), 6, 6))
        change[:, :3, :3], change[:, :3, 3:] = -sign * back @ cross_matrix(arm), sign * back
        change[:, 3:, :3] = sign * back
        covariance = change @ np.array([p.covariance[:6, :6] for p in poses])
        covariance = covariance @ np.swapaxes(change, 1, 2)
        source = {
            "source": "board", "eye": "hand" if in_hand else "base", "board": self.board.text,
            "point": at.tolist(), "size": list(self.size), "lens": lens.to_json(),
        }  # fmt: skip
        noise = float(np.sqrt(np.einsum("njj->n", covariance[:, :3, :3]).mean() / 3))
        source |= {"noise": noise, "noise_of_reference": 0.0, "dropped": {}}
        return Samples(
            self.q, turns @ at + shift, self.joint_names, source=source, notes=self.notes,
            orientation=quaternion_of(turns), covariance=covariance, pictures=self.names,
            episode=None if self.episodes is None else self.episodes.astype(float),
        )  # fmt: skip


def held_poses(poses: Sequence[Pose], in_hand: bool) -> tuple[Array, Array]:
    """Turns (p, 3, 3) and shifts (p, 3) [m] of what is in the hand, seen from what stands still."""
    turns, shifts = turns_and_shifts(poses)
    back = np.swapaxes(turns, 1, 2)
    return (back, -np.einsum("pij,pj->pi", back, shifts)) if in_hand else (turns, shifts)


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
    board, notes = Board.parse(board), list[str]()
    if is_dataset(pictures):
        joints, pictures, notes = read_dataset(str(pictures), names, camera)
    elif joints is None:
        raise OptionError("pictures need the joints beside them: expected `joints`")
    if not isinstance(joints, JointTable):
        joints = read_joints(joints, names, degrees=degrees, prismatic=prismatic)
    rows = list(range(len(joints.q)))
    if isinstance(pictures, (str, os.PathLike)):
        rows, frames, notes = read_shots(joints, pictures)
    elif len(pictures) == len(rows):
        known = joints.pictures or [f"picture {k + 1}" for k in rows]
        frames = zip(rows, known, pictures, strict=True)
    else:
        raise LogError(f"{len(pictures)} pictures and {len(rows)} rows of joints: expected as many")
    finder, looked, size = BoardFinder(board), list[Picture](), (0, 0)
    seen = list[tuple[str, int, dict[int, Array]]]()
    for number, name, grey in frames:
        seen.append((name, rows[number], finder.find(grey)))
        size = (grey.shape[1], grey.shape[0])
        if len(seen[-1][2]) < LEAST_CORNERS and len(looked) < _LOOKED:
            looked.append(grey)
    found = [each for each in seen if len(each[2]) >= LEAST_CORNERS]
    if len(found) < LEAST:
        raise LogError(
            f"the board is in {len(found)} of {len(seen)} pictures, expected {LEAST} with "
            f"{LEAST_CORNERS} corners or more (at most {max(len(c) for *_, c in seen)} found): "
            f"{_instead(looked, board)}"
        )
    if missing := [name for name, _, corners in seen if len(corners) < LEAST_CORNERS]:
        notes.append(f"no board in {len(missing)} pictures, left out: {listed(missing)}")
    shown, kept, corners = zip(*found, strict=True)
    return BoardPictures(
        board, joints.names, shown, joints.q[list(kept)], corners, size, len(seen), tuple(notes),
        None if joints.episodes is None else joints.episodes[list(kept)],
    )  # fmt: skip


def _instead(looked: Sequence[Picture], board: Board) -> str:
    """What pictures without the board show."""
    turned = replace(board, columns=board.rows, rows=board.columns)
    if any(len(BoardFinder(turned).find(grey)) >= LEAST_CORNERS for grey in looked):
        return f"they show a board of {turned.columns}x{turned.rows} squares"
    finder, flipped = BoardFinder(board), [np.ascontiguousarray(grey[:, ::-1]) for grey in looked]
    if any(len(finder.find(grey)) >= LEAST_CORNERS for grey in flipped):
        return "the pictures are mirrored: turn that off in the camera's settings"
    return "check the board's columns, rows and dictionary"
