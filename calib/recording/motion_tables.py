"""Tables of motions beside pictures: joints, or flange poses as controllers write them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Index
from ..common.atomic import FilePath
from ..common.choices import PICTURES
from ..common.rows import finite_rows
from ..common.wording import listing, printable
from ..errors import LogError
from ..samples.header import name_and_unit
from ..samples.tables import Source, open_source
from .pictures import Shot, list_pictures, natural_key, read_series

TURNS = {
    "xyzw": ("qx", "qy", "qz", "qw"),
    "vector": ("rx", "ry", "rz"),
    "rpy": ("roll", "pitch", "yaw"),
    "kuka": ("A", "B", "C"),
    "fanuc": ("w", "p", "r"),
    "matrix": tuple(f"r{i}{k}" for i in (1, 2, 3) for k in (1, 2, 3)),
}
"""Columns of a turn, by what their names say."""

MATRIX = tuple(f"m{i}{k}" for i in range(4) for k in range(4))

EXPECTED = (
    f"x, y, z and one of {', '.join(f'{n[0]}..{n[-1]}' for n in TURNS.values())}, or m00..m33, "
    "and perhaps picture; without a header six, seven, twelve or sixteen numbers, or matrices of "
    "3x4 or 4x4"
)

_LENGTHS = (6, 7, 12, 16)  # numbers of a row without a header
_ARRAYS = (".npy", ".json")
_BESIDE = {"picture", "time", "timestamp", "episode"}
# numbers of rows, as pandas and databases write them, tell nothing
_IGNORED = {*_BESIDE, "", "id", "index", *map(str.lower, MATRIX)}
# "[mm]", "(deg)", "_mm": the fit finds units
_UNIT = r"\s*[\[(].*[\])]$|_(?:m|cm|mm|in|rad|deg|grad)$"
_OTHERS = {*_BESIDE, "x", "y", "z", *TURNS["xyzw"]}
_KNOWN = {*_IGNORED, *"xyz", *map(str.lower, chain(*TURNS.values()))}
# [rad]; joints that go beyond two turns are taken for degrees
_TURNS = 4.0 * np.pi


def joint_columns(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table that are not a time, a picture or a position."""
    return tuple(
        name for name in header if name_and_unit(name)[0].lower() not in _OTHERS
    )


@dataclass(frozen=True, eq=False)
class JointTable:
    """Joints as they were recorded; rows with a missing value are left out, and counted."""

    label: str
    names: tuple[str, ...]
    q: Array  # (n, joints) [rad or m]
    time: Array | None  # times of the rows, by the joints' clock (n,) [s]
    pictures: Sequence[str] | None  # names of the rows' pictures
    dropped: int = 0
    episodes: Index | None = None  # (n,), the series that each row is of
    revolute: Sequence[bool] | None = None  # which joints turn; None: all

    @property
    def what(self) -> str:
        """What messages call the rows' numbers."""
        return "joints" if self.names else "poses"


def read_joints(
    path: FilePath,
    joints: Sequence[str] | None = None,
    *,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> JointTable:
    """Read a table of joints; a column `time` [s], or one of pictures, says what a row is of.

    joints : the joints' columns; all columns of numbers but those if not given
    degrees, prismatic : whether joints that turn are in degrees, and which slide [m]
    Raises LogError if there are no joints, or they look like degrees and are not said to be.
    """
    source = open_source(path)
    names = tuple(joint_columns(source.header) if joints is None else joints)
    if joints is None:
        is_number = np.isfinite(source.numbers(names)[0]).any(axis=0)
        names = tuple(np.array(names, object)[is_number])
    beside = [name for name in ("time", "episode") if name in source.header]
    rows = number_rows_of(source, [*names, *beside])
    if not names or not len(rows.q):
        raise LogError(
            f"{source.label} has no row with numbers for {listing(names)}: expected a column for "
            f"each joint, decimals with a point; columns: {listing(source.header)}"
        )
    q, about = np.split(rows.q, [len(names)], axis=1)
    revolute = np.array([name not in prismatic for name in names])
    most = float(np.abs(q[:, revolute]).max(initial=0.0))
    if degrees:
        q[:, revolute] = np.deg2rad(q[:, revolute])
    elif most > _TURNS:
        raise LogError(
            f"{source.label}: a joint goes to {most:.4g} rad, more than two turns: are these "
            "degrees? expected rad, or `degrees=True`"
        )
    columns = dict(zip(beside, about.T, strict=True))
    episodes = columns.get("episode")
    return replace(
        rows,
        names=names,
        q=q,
        time=columns.get("time"),
        episodes=None if episodes is None else episodes.astype(np.intp),
        revolute=tuple(revolute.tolist()),
    )


def number_rows_of(source: Source, columns: Sequence[str]) -> JointTable:
    """Read columns of numbers as `q`; rows in which one is missing are left out, and counted."""
    numbers = source.numbers(columns)[0]
    good = np.flatnonzero(finite_rows(numbers))
    pictures = None
    column = picture_column(source)
    if column is not None:
        cells = source.read([column])[column].to_list()
        # without their folders, of this system or another
        paths = [str(cell or "").replace("\\", "/").strip() for cell in cells]
        pictures = [paths[k].rpartition("/")[2] for k in good]
    return JointTable(
        source.label,
        tuple(columns),
        numbers[good],
        None,
        pictures,
        len(numbers) - len(good),
    )


def picture_column(source: Source) -> str | None:
    """The column `picture`, or else the first whose cells end as names of pictures do."""
    for name in source.header:
        if name.lower() == "picture":
            return name
    for name, cells in source.read(source.header).head(20).to_dict().items():
        if any(str(cell).lower().endswith(PICTURES) for cell in cells):
            return name
    return None


def read_shots(
    table: JointTable, source: FilePath | Sequence[str]
) -> tuple[list[int], Iterator[Shot], list[str]]:
    """Rows of the joints (p), in their order, the shot of each, and notes of what is left out.

    Notes of damaged pictures come as the shots are read.
    Raises LogError if names of pictures do not fit, or without names their counts.
    """
    paths = list_pictures(source)
    total = len(paths)
    rows = list(range(len(table.q)))
    notes: list[str] = []
    words = ""
    is_fitting = len(rows) == total and not table.dropped
    if table.pictures is not None:
        by_name = {path.stem: path for path in reversed(paths)}
        by_name |= {path.name: path for path in paths}
        names = table.pictures
        rows = [row for row, name in enumerate(names) if name in by_name]
        paths = [by_name[names[row]] for row in rows]
        words = f", which name {listing(names, 3)}"
        is_fitting = bool(rows) and len(set(paths)) == len(rows)
        lonely = {
            f"rows of {table.what}, without a picture": len(names) - len(rows),
            f"pictures, without {table.what}": total - len(rows),
        }
        for what, number in lonely.items():
            if number > 0:
                notes.append(f"{number} {what}, are left out")
    if not is_fitting:
        raise LogError(
            f"{total} pictures and {len(table.q) + table.dropped} rows of {table.what} in "
            f"{table.label} "
            f"({table.dropped} with a missing value){words}: expected one row for each picture, in "
            "the order of names or by a column 'picture'"
        )
    return rows, read_series(paths, notes), notes


@dataclass(frozen=True, eq=False)
class FlangeTable:
    """Flange poses as numbers, one row for each picture."""

    label: str
    numbers: Array  # (n, 3 + k): x, y, z and 3, 4 or 9 numbers of a turn
    pictures: Sequence[str] | None  # names of the rows' pictures
    named: str = ""  # the rotation that the columns' names say
    dropped: int = 0  # rows with a missing value
    # what the user states of the poses; by default all readings are tried
    unit: str | None = None
    rotation: str | None = None
    degrees: bool | None = None

    @property
    def joints(self) -> JointTable:
        """The same rows without a joint."""
        q = np.zeros((len(self.numbers), 0))
        return JointTable(self.label, (), q, None, self.pictures, self.dropped)


def read_flange_poses(path: FilePath) -> FlangeTable:
    """Read flange poses, a row or a matrix for each picture.

    Columns of a table are x, y, z and one of qx, qy, qz, qw; rx, ry, rz; roll, pitch, yaw;
    A, B, C; w, p, r; r11 .. r33; or m00 .. m33 alone, with a unit in brackets or behind "_" or
    without; a column of names of pictures may have any name.  Without a header six, seven, twelve
    or sixteen numbers, or matrices: as text, in JSON or of `numpy.save`; a folder has a file for
    each picture.
    Raises LogError, which lists these, where it is none.
    """
    place = Path(path)
    if place.is_dir():
        return _folder_of_poses(place)
    if place.suffix.lower() in _ARRAYS:
        return FlangeTable(printable(str(place)), _array(place), None)
    source = open_source(path, headless=True)
    label = source.label
    if source.is_headless:
        return FlangeTable(label, _array(place), None)

    shown = picture_column(source)
    names = {
        re.sub(_UNIT, "", name.lower()): name
        for name in source.header
        if name != shown
    }
    rotation, columns = _columns(set(names))
    if not columns or names.keys() - {*columns, *_IGNORED}:
        odd = [name for key, name in names.items() if key not in _KNOWN]
        raise LogError(
            f"{label} has the columns {listing(source.header)}: expected {EXPECTED}; "
            f"rename or drop {listing(odd)}"
        )
    rows = number_rows_of(source, [names[column] for column in columns])
    if not len(rows.q):
        raise LogError(
            f"{label} has no row with numbers alone: expected decimals with a point"
        )
    numbers = rows.q
    if rotation != "matrix":
        numbers = _shift_first(numbers)
    return FlangeTable(label, numbers, rows.pictures, rotation, rows.dropped)


def _folder_of_poses(folder: Path) -> FlangeTable:
    """The poses of a folder with a file for each, in natural order."""
    label = printable(str(folder))
    kinds = {*_ARRAYS, ".txt", ".csv"}
    paths = [path for path in folder.iterdir() if path.suffix.lower() in kinds]
    poses = [_array(path) for path in sorted(paths, key=natural_key)]
    if {pose.shape for pose in poses} not in ({(1, 6)}, {(1, 7)}, {(1, 12)}):
        raise LogError(
            f"{label} has {len(poses)} files of poses: expected one pose of one kind in each, of "
            f"{listing(sorted(kinds))}"
        )
    return FlangeTable(label, np.concatenate(poses), None)


def _array(path: Path) -> Array:
    """The poses (n, 3 + k) of a file without a header, as of :func:`_shift_first`."""
    label = printable(str(path))
    try:
        if path.suffix.lower() == ".npy":
            numbers = np.load(path, allow_pickle=False)
        elif path.suffix.lower() == ".json":
            numbers = json.loads(path.read_bytes())
        else:
            text = re.sub(
                r"[;,\t\[\]]", " ", path.read_text(encoding="utf-8-sig")
            )
            numbers = np.loadtxt(text.splitlines(), ndmin=2)
        poses = np.array(numbers, float)
    except (OSError, TypeError, ValueError) as error:
        raise LogError(
            f"{label} holds no poses ({error}): expected {EXPECTED}"
        ) from None
    # matrices, in a stack or one below the other
    if poses.ndim == 3:
        poses = poses.reshape(len(poses), -1)
    elif poses.shape[1:] == (4,) and not len(poses) % 4:
        poses = poses.reshape(-1, 16)
    if poses.ndim != 2 or poses.shape[1] not in _LENGTHS:
        raise LogError(
            f"{label} has no header and numbers of shape {poses.shape}: expected {EXPECTED}"
        )
    if not np.isfinite(poses).all():
        raise LogError(f"{label} holds a number that is not finite")
    return _shift_first(poses)


def _shift_first(numbers: Array) -> Array:
    """Rows (n, 3 + k) of x, y, z and a turn, of such rows or of matrices (n, 12 or 16) by rows.

    Matrices whose last column is 0, 0, 0, 1 are by columns, as Franka's controllers write them.
    """
    if numbers.shape[1] < 12:
        return numbers
    matrices = numbers.reshape(len(numbers), -1, 4)
    if np.allclose(matrices[:, :, 3], [*np.zeros(matrices.shape[1] - 1), 1.0]):
        matrices = np.swapaxes(matrices, 1, 2)
    turns = matrices[:, :3, :3].reshape(-1, 9)
    return np.column_stack([matrices[:, :3, 3], turns])


def _columns(header: set[str]) -> tuple[str, list[str]]:
    """The rotation that names of columns (small letters) say, and its columns, if all are there."""
    if header.issuperset(MATRIX[:12]):
        return "", list(MATRIX[:12])
    for kind, names in TURNS.items():
        columns = ["x", "y", "z", *map(str.lower, names)]
        if header.issuperset(columns):
            return "rpy" if kind == "fanuc" else kind, columns
    return "", []
