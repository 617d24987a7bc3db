"""Hand-eye calibration: where cameras and a board are, from pictures and the motions of the arm.

Pictures become corners (:mod:`.board_pictures`), corners a lens and the board before each camera
(:mod:`.board_pictures`, :mod:`.lens`); motions are joints of a drawn arm or flange poses of a
controller.  A closed form (:mod:`.start`, :mod:`.problem`) starts one fit of all (:mod:`.bundle`,
:mod:`.fit`), and the places with their intervals are the answer (:mod:`.answer`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.loading import load_arm
from ..arm.rigid import place_points, shift_of, turn_of
from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.choices import EYES, PICTURES, Eye, check_choice
from ..common.parallel import one_blas_thread
from ..errors import CalibError, OptionError
from ..samples.lens import Lens
from ..samples.tables import Source, open_source
from .answer import solve_rig
from .board import Pattern, TagGrid
from .board_pictures import (
    BoardPictures,
    PictureSource,
    find_board,
    view_of,
)
from .lerobot import is_dataset
from .motion_tables import JointTable
from .pictures import Picture
from .pose_files import FlangeTable, read_flange_poses
from .problem import problem_of_joints, problem_of_poses
from .rig import HandEye as HandEye

BoardSource = PictureSource | BoardPictures
_T = TypeVar("_T")


def handeye(
    arm: Arm | FilePath | None = None,
    pictures: BoardSource | Mapping[str, BoardSource] | None = None,
    joints: FilePath | Source | JointTable | None = None,
    board: Pattern | str | None = None,
    eye: str | Mapping[str, str] = "hand",
    *,
    poses: FilePath | FlangeTable | Array | None = None,
    boards: Array | None = None,
    lens: Lens | Mapping[str, Lens] | None = None,
    degrees: bool | None = None,
    camera: str | None = None,
    unit: str | None = None,
    rotation: str | None = None,
) -> HandEye:
    """Find camera and board from pictures of a board that an arm took, or held.

    arm : an arm that moves in space, as `load_arm` returns it or reads it; none with `poses`
    pictures : folder, pattern or LeRobotDataset; grey pictures (height, width) themselves; the
        corners that they show; of several cameras a folder with a folder for each, or any of
        these by the cameras' names
    joints : table of joints (CSV, Parquet, JSON, or an array of `numpy.save`), one row for each
        picture; a dataset brings them
    board : ``"10x7:22mm"``, a chessboard of 10x7 squares; ``"7x5:24mm:18mm:5x5_100"``, ChArUco;
        ``"grid:6x6:88mm:26.4mm:t36h11"``, AprilTags
    eye : {"hand", "base"}, or one for each camera: ``{"left": "hand", "right": "base"}``
    poses : in place of arm and joints: a table of flange poses, or matrices (n, 4, 4) [m], of the
        flange in the base
    boards : in place of pictures: the board before the camera (n, 4, 4) [m], one for each pose
    lens : the camera's lens where it is known; by default it is fitted to the same pictures
    degrees : whether angles of joints or poses are in degrees; of poses it is found by default
    camera : of a dataset with several
    unit, rotation : of the poses; found by default
    Raises LogError in one line if the pictures show nothing, OptionError if an option is wrong.

    Examples
    --------
    >>> import calib
    >>> calib.handeye(pictures="shots", poses="flange.csv", board="10x7:22mm")  # doctest: +SKIP
    """
    if pictures is not None and boards is None:
        cameras = _cameras(pictures)
    elif boards is not None and pictures is None:
        corners, lens = pictures_of_boards(boards)
        cameras = {"camera": corners}
    else:
        raise OptionError("expected either pictures or the board's poses")
    motions = _motions(arm, poses)
    spatial_arm = None
    if isinstance(motions, FlangeTable):
        if boards is not None and len(boards) != len(motions.numbers):
            raise OptionError(
                f"boards: {len(boards)}, poses: {len(motions.numbers)}: expected a board of each "
                "pose"
            )
        motions = replace(
            motions, unit=unit, rotation=rotation, degrees=degrees
        )
        joints = motions.joints
    else:
        spatial_arm = motions
        if isinstance(joints, (str, os.PathLike)):
            joints = open_source(joints)  # once: it may be a pipe

    with one_blas_thread():
        # pictures -> corners -> lens and board before each camera
        views = []
        for name, source in cameras.items():
            camera_eye = cast("Eye", _of_camera(eye, name))
            check_choice(f"eye of {name}", camera_eye, EYES)
            shown = source
            if not isinstance(shown, BoardPictures):
                shown = find_board(
                    shown,
                    joints,
                    board,
                    spatial_arm,
                    camera,
                    degrees=bool(degrees),
                )
            views.append(
                view_of(name, shown, camera_eye, _of_camera(lens, name))
            )

        # corners and motions -> start -> bundle -> answer
        if isinstance(motions, FlangeTable):
            return solve_rig(problem_of_poses(motions, views))
        return solve_rig(problem_of_joints(motions, views))


def best_rig(
    arm: Arm,
    pictures: Sequence[Picture],
    tables: Mapping[str, JointTable],
    board: Pattern | str,
    eye: str,
) -> tuple[str, HandEye]:
    """The unit of the joints under which pictures are predicted best, and its rig.

    tables : joints by the unit that they may be in
    Raises the CalibError of the first unit where none explains the pictures.
    """
    spatial = _spatial_arm(arm)
    first = next(iter(tables.values()))
    shown = find_board(pictures, first, board, spatial)
    rigs: dict[str, HandEye] = {}
    refusals: list[CalibError] = []
    for unit, table in tables.items():
        board_pictures = replace(shown, q=table.q[shown.rows])
        try:
            rigs[unit] = handeye(spatial, board_pictures, eye=eye)
        except CalibError as error:
            refusals.append(error)
    if not rigs:
        raise refusals[0]
    best = min(rigs, key=lambda unit: rigs[unit].held_out["rms"])
    return best, rigs[best]


def _motions(
    arm: Arm | FilePath | None, poses: FilePath | FlangeTable | Array | None
) -> SpatialArm | FlangeTable:
    """An arm in space, or flange poses; OptionError where none or both are given."""
    if arm is not None and poses is None:
        return _spatial_arm(arm)
    if poses is not None and arm is None:
        return _flange_table(poses)
    raise OptionError("expected either an arm with joints or flange poses")


def _spatial_arm(arm: Arm | FilePath) -> SpatialArm:
    """An arm that moves in space; OptionError of others."""
    if isinstance(arm, (str, os.PathLike)):
        arm = load_arm(os.fspath(arm))
    if not isinstance(arm, SpatialArm):
        raise OptionError(
            f"{arm.name} moves in a plane: expected an arm that moves in space"
        )
    return arm


def _of_camera(values: _T | Mapping[str, _T], name: str) -> _T | None:
    """The value of a camera, where one value holds for all or each camera has its own."""
    return values.get(name) if isinstance(values, Mapping) else values


def _cameras(
    pictures: BoardSource | Mapping[str, BoardSource],
) -> Mapping[str, BoardSource]:
    """The pictures of each camera, by its name."""
    if isinstance(pictures, Mapping):
        return pictures
    if not isinstance(pictures, (str, os.PathLike)) or is_dataset(pictures):
        return {"camera": pictures}
    paths = sorted(Path(pictures).iterdir()) if Path(pictures).is_dir() else []
    if any(path.suffix.lower() in PICTURES for path in paths):
        return {"camera": pictures}
    folders = [path for path in paths if path.is_dir() and any(path.iterdir())]
    return {path.name: path for path in folders} or {"camera": pictures}


def _flange_table(poses: FilePath | FlangeTable | Array) -> FlangeTable:
    """The table of flange poses in a file, or of matrices (n, 4, 4) [m]."""
    if isinstance(poses, (str, os.PathLike)):
        return read_flange_poses(poses)
    if isinstance(poses, FlangeTable):
        return poses
    matrices = _matrices("poses", poses)
    turns = turn_of(matrices).reshape(-1, 9)
    numbers = np.column_stack([shift_of(matrices), turns])
    return FlangeTable("poses", numbers, None, "matrix")


def _matrices(name: str, values: Array) -> Array:
    """Poses (n, 4, 4) of an option, all of numbers.  Raises OptionError of others."""
    matrices = np.asarray(values, float)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise OptionError(
            f"{name} of shape {matrices.shape}: expected (n, 4, 4), or a table"
        )
    finite = np.isfinite(matrices).all(axis=(1, 2))
    if not finite.all():
        raise OptionError(
            f"{name}[{np.argmin(finite)}] holds what is no number: expected a pose (4, 4)",
            hint="leave it out of boards and poses",
        )
    return matrices


def pictures_of_boards(boards: Array) -> tuple[BoardPictures, Lens]:
    """Corners that an ideal camera sees of boards (n, 4, 4) [m] before it, and its lens.

    The board is a square of four tags, which is as large in a picture as boards usually are.
    """
    boards = _matrices("boards", boards)
    if not (boards[:, 2, 3] > 0.0).all():
        raise OptionError("boards: expected each before the camera (z > 0)")
    side = 0.08 * float(np.median(boards[:, 2, 3]))
    pattern = TagGrid(2, 2, side, side)
    middle = np.array([1000.0, 1000.0])
    lens = Lens((2000, 2000), middle, middle, np.zeros(5))
    places = place_points(boards, pattern.points())
    pixels = lens.distort(places[:, :, :2] / places[:, :, 2:])
    count = len(boards)
    pictures = BoardPictures(
        pattern,
        (),
        tuple(f"pose {k + 1}" for k in range(count)),
        np.zeros((count, 0)),
        tuple(dict(enumerate(picture)) for picture in pixels),
        lens.size,
        count,
        (),
        np.arange(count),
        is_of_poses=True,
    )
    return pictures, lens
