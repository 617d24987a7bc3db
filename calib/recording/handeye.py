"""Hand-eye calibration: where cameras and a board are, from pictures, with the motions of the arm.

Motions are joints of a drawn arm or flange poses of a controller; one fit (:mod:`.bundle`) has
both.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.loading import load_arm
from ..common.arrays import Array
from ..common.choices import EYES
from ..common.parallel import one_blas_thread
from ..errors import OptionError
from .board import Pattern
from .board_pictures import BoardPictures, Source, find_board
from .flange_table import FlangeTable, read_flange_poses
from .joint_table import JointTable
from .lens import Lens
from .lerobot import is_dataset
from .places import HandEye as HandEye
from .places import answer
from .solver import View, of_joints, of_poses

_IMAGINED = 0.08  # of the distance: side of an imagined square
Eyes = str | Mapping[str, str]
Lenses = Lens | Mapping[str, Lens] | None


def handeye(
    arm: Arm | str | os.PathLike[str] | None = None,
    pictures: Source | BoardPictures | None = None,
    joints: str | os.PathLike[str] | JointTable | None = None,
    board: Pattern | str | None = None,
    eye: Eyes = "hand",
    *,
    poses: str | os.PathLike[str] | FlangeTable | Array | None = None,
    boards: Array | None = None,
    lens: Lenses = None,
    degrees: bool | None = None,
    camera: str | None = None,
    unit: str | None = None,
    rotation: str | None = None,
) -> HandEye:
    """Find camera and board from pictures of a board that an arm took, or held.

    arm : an arm that moves in space, as `load_arm` returns it or reads it; none with `poses`
    pictures : folder, pattern or LeRobotDataset; grey pictures (height, width) themselves; the
        corners that they show; or a folder with a folder for each camera
    joints : table of joints, one row for each picture; a dataset brings them
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
    Raises LogError in one line if the pictures tell nothing, OptionError if an option is wrong.

    Examples
    --------
    >>> import calib
    >>> calib.handeye(pictures="shots", poses="flange.csv", board="10x7:22mm")  # doctest: +SKIP
    """
    if (pictures is None) == (boards is None) or (arm is None) == (poses is None):
        raise OptionError(
            "expected pictures or the board's poses, and either an arm with joints or flange poses"
        )
    if isinstance(arm, (str, os.PathLike)):
        arm = load_arm(os.fspath(arm))
    if boards is not None:
        pictures, lens = _imagined(np.asarray(boards, float))
    assert pictures is not None  # noqa: S101 - refused above
    if arm is not None and not isinstance(arm, SpatialArm):
        raise OptionError(
            f"{arm.name} moves in a plane: expected an arm that moves in space"
        )
    flange = _flange_table(poses) if poses is not None else None
    table = joints if flange is None else flange
    cameras = _cameras(arm, pictures, table, board, eye, camera, degrees=bool(degrees))
    with one_blas_thread():
        views = [
            View.of(name, *each, _lens_of(lens, name)) for name, each in cameras.items()
        ]
        if arm is not None:
            return answer(of_joints(arm, views))
        assert flange is not None  # noqa: S101 - one of both is given
        return answer(of_poses(flange, views, unit, rotation, degrees))


@dataclass(frozen=True)
class _Points(Pattern):
    """Points that stand for a board of which poses alone are known."""

    square: float  # [m]
    columns: int = 4
    rows: int = 4

    @property
    def side(self) -> float:
        """Side of a square [m]."""
        return self.square

    @property
    def text(self) -> str:
        """No pattern."""
        return "poses of a board"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return 3 * self.square, 3 * self.square

    def points(self) -> Array:
        """A grid about the origin (16, 3) [m]."""
        x, y = np.meshgrid(np.arange(4) - 1.5, np.arange(4) - 1.5)
        return self.square * np.column_stack([x.ravel(), y.ravel(), np.zeros(16)])


def _imagined(boards: Array) -> tuple[BoardPictures, Lens]:
    """Corners that a camera without errors sees of boards (n, 4, 4), and its lens."""
    if (
        boards.ndim != 3
        or boards.shape[1:] != (4, 4)
        or not (boards[:, 2, 3] > 0.0).all()
    ):
        raise OptionError(
            f"boards of shape {boards.shape}: expected (n, 4, 4), each before the camera (z > 0)"
        )
    pattern = _Points(_IMAGINED * float(np.median(boards[:, 2, 3])))
    centre = np.array([1000.0, 1000.0])
    lens = Lens((2000, 2000), np.array([1000.0, 1000.0]), centre, np.zeros(5))
    corners = []
    for board in boards:
        seen = pattern.points() @ board[:3, :3].T + board[:3, 3]
        corners.append(dict(enumerate(1000.0 * seen[:, :2] / seen[:, 2:] + centre)))
    count = len(boards)
    names = tuple(f"pose {k + 1}" for k in range(count))
    none = np.zeros((count, 0))
    shots = BoardPictures(
        pattern, (), names, none, tuple(corners), lens.size, count, ()
    )
    return shots, lens


def _flange_table(poses: str | os.PathLike[str] | FlangeTable | Array) -> FlangeTable:
    if isinstance(poses, (str, os.PathLike)):
        return read_flange_poses(poses)
    if isinstance(poses, FlangeTable):
        return poses
    matrices = np.asarray(poses, float)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise OptionError(
            f"poses of shape {matrices.shape}: expected (n, 4, 4), or a table"
        )
    numbers = np.column_stack([matrices[:, :3, 3], matrices[:, :3, :3].reshape(-1, 9)])
    return FlangeTable("poses", numbers, None, "matrix")


def _cameras(
    arm: SpatialArm | None,
    pictures: Source | BoardPictures,
    table: str | os.PathLike[str] | JointTable | FlangeTable | None,
    board: Pattern | str | None,
    eye: Eyes,
    camera: str | None,
    *,
    degrees: bool,
) -> dict[str, tuple[BoardPictures, bool]]:
    """The pictures of each camera by its name, and whether it is in the hand."""
    folders = _folders(pictures)
    names = list(folders) or ["camera"]
    eyes = dict.fromkeys(names, eye) if isinstance(eye, str) else dict(eye)
    for name in names:
        if eyes.get(name) not in EYES:
            raise OptionError(
                f"eye {eyes.get(name)!r} of {name}: expected one of {', '.join(EYES)}"
            )
    if isinstance(pictures, BoardPictures):
        return {names[0]: (pictures, eyes[names[0]] == "hand")}
    if board is None:
        raise OptionError("pictures need the board that they show: expected `board`")
    joint_names = arm.joint_names if arm is not None else None
    sliding: list[str] = []
    if arm is not None:
        kinds = zip(arm.joint_names, arm.revolute, strict=True)
        sliding = [name for name, turns in kinds if not turns]
    found = {}
    for name in names:
        shots = find_board(
            folders.get(name, pictures),
            table,
            board,
            joint_names,
            camera=camera,
            degrees=degrees,
            prismatic=sliding,
        )
        found[name] = shots, eyes[name] == "hand"
    return found


def _folders(pictures: Source | BoardPictures) -> dict[str, Path]:
    """The folders of several cameras, by their names."""
    if not isinstance(pictures, (str, os.PathLike)) or is_dataset(pictures):
        return {}
    folder = Path(pictures)
    if not folder.is_dir() or any(
        path.is_file() for path in folder.glob("*.[jpbJPB]*")
    ):
        return {}
    some = sorted(path for path in folder.iterdir() if path.is_dir())
    return {path.name: path for path in some if any(path.iterdir())}


def _lens_of(lens: Lenses, name: str) -> Lens | None:
    if isinstance(lens, Mapping):
        return lens.get(name)
    return lens
