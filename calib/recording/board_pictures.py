"""Pictures of a board that an arm took or held: corners, poses, logs, and the view of a camera."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rigid import inverse, place_points, rigid, shift_of, turn_of
from ..arm.rotations import cross_matrix, matrix_of, quaternion_of
from ..common.arrays import Array, Index, Mask
from ..common.atomic import FilePath
from ..common.choices import Eye
from ..common.wording import listing
from ..errors import LogError, OptionError
from ..model.about import About
from ..model.model import Model
from ..samples.lens import Lens
from ..samples.samples import Samples
from ..samples.tables import Source
from .board import (
    LEAST_CORNERS,
    LEAST_PICTURES,
    Chessboard,
    Pattern,
    parse_board,
)
from .lens import calibrate_lens, lens_of_model, refuse_size
from .lerobot import is_dataset, read_dataset
from .motion_tables import JointTable, read_joints, read_shots
from .pictures import Picture, Shot
from .reference import Pose, find_pose, frames_of

POINT_DISTANCE = 2.0
"""Distance, in diagonals of the board, of the logged point ahead of the camera.

A picture determines that point ten times better than the camera's own position, whose error trades
off against that of the tilt (.2 mm for .5 over 24 rendered pictures).
"""

# share by which the focal length of a camera that was not touched may differ
_REFOCUSED = 0.02

PictureSource = FilePath | Sequence[Picture]
"""A folder or pattern of pictures, a LeRobotDataset, or grey pictures (height, width)."""


@dataclass(frozen=True, eq=False)
class BoardPictures:
    """Corners that pictures show, and the joints at which they were taken."""

    board: Pattern
    joint_names: tuple[str, ...]
    names: tuple[str, ...]  # of the pictures
    q: Array  # (p, dof) [rad or m]
    corners: tuple[Mapping[int, Array], ...]  # place (2,) [px] by number
    size: tuple[int, int]  # width and height [px]
    count: int  # pictures, with those that do not show the board
    notes: tuple[str, ...]
    rows: Index  # (p,), of joints or poses, one for each
    episodes: Array | None = None  # (p,), number of the series of each
    # whether corners are those of boards' poses, which no camera took
    is_of_poses: bool = False

    def poses(self, lens: Lens) -> list[Pose]:
        """Where the board is before the camera in each picture."""
        points = self.board.points()
        return [
            find_pose(lens, points[list(shown)], np.array([*shown.values()]))
            for shown in self.corners
        ]

    def lens(self) -> Lens:
        """The camera's lens, calibrated by the same pictures."""
        return calibrate_lens(self.corners, self.board, self.size)

    def log(self, lens: Lens, eye: str) -> Samples:
        """The pictures as a log of poses of what is in the hand, in the frame of what is at rest.

        The logged point is ahead of the camera, or in the middle of the board.
        """
        poses = self.poses(lens)
        hand = hand_poses(poses, eye)
        turns = turn_of(hand)
        point = self.board.points().mean(axis=0)
        if eye == "hand":
            diagonal = float(np.hypot(*self.board.size))
            point = np.array([0.0, 0.0, POINT_DISTANCE * diagonal])
        covariance = _log_covariance(poses, point, eye)
        variances = np.einsum("njj->n", covariance[:, :3, :3])
        noise = np.sqrt(variances.mean() / 3)
        source = {
            "source": "board",
            "eye": eye,
            "board": self.board.text,
            "point": point.tolist(),
            "size": list(self.size),
            "lens": lens.to_json(),
            "noise": float(noise),
            "noise_of_reference": 0.0,
            "dropped": {},
        }
        return Samples(
            self.q,
            turns @ point + shift_of(hand),
            self.joint_names,
            source=source,
            notes=self.notes,
            orientation=quaternion_of(turns),
            covariance=covariance,
            pictures=np.array(self.names),
            episode=self.episodes,
        )


def _log_covariance(poses: Sequence[Pose], point: Array, eye: str) -> Array:
    """Covariance (p, 6, 6) of the place of a point (3,) of what is in the hand, and of its turn.

    Both are along the axes of what is at rest; a board's turn and shift are along the camera's.
    """
    boards = frames_of(poses)
    if eye == "hand":
        axes = -turn_of(boards).mT
        lever = point - shift_of(boards)
    else:
        axes = np.broadcast_to(np.eye(3), (len(poses), 3, 3))
        lever = turn_of(boards) @ point
    slopes = np.zeros((len(poses), 6, 6))
    slopes[:, :3, :3] = -axes @ cross_matrix(lever)
    slopes[:, :3, 3:] = axes
    slopes[:, 3:, :3] = axes
    of_boards = np.array([pose.covariance[:6, :6] for pose in poses])
    covariance: Array = slopes @ of_boards @ slopes.mT
    return covariance


def hand_poses(poses: Sequence[Pose], eye: str) -> Array:
    """What is in the hand, in the frame of what is at rest (p, 4, 4) [m]."""
    boards = frames_of(poses)
    return inverse(boards) if eye == "hand" else boards


@dataclass(frozen=True, eq=False, kw_only=True)
class View(BoardPictures):
    """The pictures of one camera, with its lens and the boards before it."""

    name: str
    eye: Eye  # where the camera is
    stated_lens: Lens | None  # by the user
    first_lens: Lens  # where the fit begins
    boards: Array  # (p, 4, 4), the board before the camera, by each picture alone [m]

    @property
    def in_hand(self) -> bool:
        """Whether the camera is in the hand."""
        return self.eye == "hand"

    @property
    def other_eye(self) -> Eye:
        """Where the camera is not."""
        return "base" if self.in_hand else "hand"

    def turned(self, others: Mask) -> View:
        """The view with the board of some pictures (p,) numbered from its other end."""
        last = len(self.board.points()) - 1
        corners = list(self.corners)
        for k in np.flatnonzero(others):
            corners[k] = {
                last - number: place for number, place in corners[k].items()
            }
        boards = self.boards.copy()
        if self.board.half_turn is not None:
            boards[others] @= self.board.half_turn
        return replace(self, corners=tuple(corners), boards=boards)


def view_of(
    name: str, pictures: BoardPictures, eye: Eye, stated: Lens | None
) -> View:
    """The view, its lens calibrated by its own pictures where none is stated."""
    refuse_size(stated, pictures.size, f"a picture of {name}")
    if stated is not None:
        stated = replace(stated, size=pictures.size)
    lens = stated or pictures.lens()
    return View(
        **vars(pictures),
        name=name,
        eye=eye,
        stated_lens=stated,
        first_lens=lens,
        boards=frames_of(pictures.poses(lens)),
    )


def find_board(
    pictures: PictureSource,
    table: FilePath | Source | JointTable | None,
    board: Pattern | str | None,
    arm: SpatialArm | About | None = None,
    camera: str | None = None,
    *,
    names: Sequence[str] | None = None,
    degrees: bool = False,
) -> BoardPictures:
    """Find a board in pictures.

    table : of joints, or its file, one row for each picture; a dataset brings it
    arm : arm, or the `About` of a model, whose joints are read; else those of `names`, which turn
    camera : of a dataset with several
    Raises LogError if too few pictures show the board; the message names what they show instead.
    """
    if board is None:
        raise OptionError(
            "pictures need the board that they show: expected `board`"
        )
    board = parse_board(board)
    prismatic: list[str] = []
    if arm is not None:
        names = arm.joint_names
        kinds = zip(names, arm.revolute, strict=True)
        prismatic = [name for name, turns in kinds if not turns]

    # joints, and the picture of each row
    notes: list[str] = []
    if is_dataset(pictures):
        tables, pictures, notes = read_dataset(str(pictures), names, camera)
        unit, table = next(iter(tables.items()))
        notes.append(f"joints of {table.label} are read as {unit}")
    elif table is None:
        raise OptionError("pictures need the arm's joints: expected `joints`")
    if not isinstance(table, JointTable):
        table = read_joints(table, names, degrees=degrees, prismatic=prismatic)
    if isinstance(pictures, (str, os.PathLike)):
        rows, shots, notes = read_shots(table, pictures)
    else:
        rows, shots = _shots_of(table, pictures)
    return _corners_in(shots, rows, table, board, notes)


def _corners_in(
    shots: Iterator[Shot],
    rows: Sequence[int],
    table: JointTable,
    board: Pattern,
    notes: list[str],
) -> BoardPictures:
    """The corners of a board in shots, of each of which `rows` has the row of joints.

    Reading the shots adds notes.
    """
    corners: dict[int, dict[int, Array]] = {}  # by row
    names: list[str] = []
    few: dict[str, int] = {}  # corners of pictures that do not show the board
    without: list[Picture] = []
    grey = np.zeros((0, 0), np.uint8)
    for number, name, grey in shots:
        marks = board.find(grey)
        if len(marks) < LEAST_CORNERS:
            few[name] = len(marks)
            without.append(grey)
        else:
            corners[rows[number]] = marks
            names.append(name)
    count = len(names) + len(few)
    if len(names) < LEAST_PICTURES:
        counts = [*few.values(), *map(len, corners.values())]
        raise LogError(
            f"the board is in {len(names)} of {count} pictures, expected {LEAST_PICTURES} with "
            f"{LEAST_CORNERS} corners or more (at most {max(counts, default=0)} found): "
            f"{_instead(without[:LEAST_PICTURES], board)}"
        )
    if few:
        notes.append(
            f"no board, or fewer than {LEAST_CORNERS} corners of it, in {len(few)} pictures, "
            f"left out: {listing(few)}"
        )
    shown = np.array([*corners])
    episodes = table.episodes
    return BoardPictures(
        board=board,
        joint_names=table.names,
        names=tuple(names),
        q=table.q[shown],
        corners=tuple(corners.values()),
        size=(grey.shape[1], grey.shape[0]),
        count=count,
        notes=tuple(notes),
        rows=shown,
        episodes=None if episodes is None else episodes[shown],
    )


def _shots_of(
    table: JointTable, pictures: Sequence[Picture]
) -> tuple[list[int], Iterator[Shot]]:
    """The row of each shot, and the shots, of pictures in the order of the rows."""
    rows = list(range(len(table.q)))
    if len(pictures) != len(rows):
        raise LogError(
            f"{len(pictures)} pictures and {len(rows)} rows of joints: expected as many"
        )
    labels = table.pictures or [f"picture {k + 1}" for k in rows]
    return rows, zip(rows, labels, pictures, strict=True)


def _instead(looked: Sequence[Picture], board: Pattern) -> str:
    """What pictures without the board show instead, or what to check."""
    columns = board.columns
    rows = board.rows
    turned = replace(board, columns=rows, rows=columns)
    mirrored = [np.ascontiguousarray(grey[:, ::-1]) for grey in looked]
    explanations = [
        (turned, looked, f"they show a board of {rows}x{columns} squares"),
        (
            board,
            mirrored,
            "the pictures are mirrored: turn that off in the camera's settings",
        ),
    ]
    if isinstance(board, Chessboard):  # it looks the same turned and mirrored
        # corners may have been counted, or a row or column too many or too few
        explanations = []
        for across, down in product((1, 0, -1), repeat=2):
            other = replace(
                board,
                columns=max(columns + across, 4),
                rows=max(rows + down, 4),
            )
            words = f"give `board={other.text!r}`, which they show"
            explanations.append((other, looked, words))
    for pattern, pictures, words in explanations:
        shown = [len(pattern.find(grey)) >= LEAST_CORNERS for grey in pictures]
        if sum(shown) > len(shown) / 2:
            return words
    return "check the board's columns and rows of squares, its dictionary, that it is in focus"


def with_lens_of(model: Model, log: Samples) -> Samples:
    """Return a log of the model's board with the poses that the model's lens gives.

    A pose depends on the lens: with a lens that was calibrated anew, poses differ by millimetres,
    although nothing has moved.
    Other logs stay as they are, and so do those of a camera that was refocused.
    """
    board = model.about.board
    source = log.source
    if (
        not board
        or "lens" not in source
        or source.get("board") != board["board"]
    ):
        return log
    lens = lens_of_model(model)
    log_lens = Lens.from_json(source["lens"])
    same_lens = (log_lens.parameters == lens.parameters).all()
    if same_lens or log.orientation is None:
        return log
    growth = float(log_lens.focal.mean() / lens.focal.mean()) - 1.0
    if log_lens.size != lens.size or abs(growth) > _REFOCUSED:
        note = (
            f"the log's camera is another than the model's, or refocused: its focal length "
            f"differs by {growth:+.1%}"
        )
        return replace(log, notes=(*log.notes, note))
    point = np.array(source["point"])
    turns = matrix_of(log.orientation)
    hand = rigid(turns, log.x - turns @ point)
    eye = source["eye"]
    points = parse_board(source["board"]).points()
    # poses by the model's lens from the pixels that the log's lens saw
    places = place_points(inverse(hand) if eye == "hand" else hand, points)
    pixels = log_lens.distort(places[:, :, :2] / places[:, :, 2:])
    poses = [find_pose(lens, points, corners) for corners in pixels]
    hand = hand_poses(poses, eye)
    turns = turn_of(hand)
    note = (
        f"poses are computed with the model's lens: of these pictures alone the focal length was "
        f"{growth:+.2%} off it"
    )
    return replace(
        log,
        x=turns @ point + shift_of(hand),
        orientation=quaternion_of(turns),
        source={**source, "lens": lens.to_json()},
        notes=(*log.notes, note),
    )
