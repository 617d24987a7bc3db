"""Flange poses as controllers and programs write them: tables, lists in text, JSON, NumPy."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.choices import PICTURES
from ..common.wording import listing, printable
from ..errors import LogError
from ..samples.tables import Source, open_source, parse_source
from .motion_tables import JointTable, file_name, number_rows_of, picture_column
from .pictures import natural_key

EXPECTED = (
    "x, y, z and one of qx..qw, rx..rz, roll..yaw, A..C, w..r, r11..r33, or m00..m33, of one pose, "
    "and perhaps picture; without a header six, seven, twelve or sixteen numbers, the shift first, "
    "or matrices of 3x4 or 4x4"
)

_TURNS = {
    "rpy": "roll pitch yaw",
    "kuka": "a b c",
    "fanuc": "w p r",
    "matrix": "r11 r12 r13 r21 r22 r23 r31 r32 r33",
    "": "m00 m01 m02 m10 m11 m12 m20 m21 m22",  # beside m03, m13, m23
}
"""Columns of a turn by the rotation that they mean, except those of axes such as rx, ry, rz."""

# rx, tcp_rx, rot_x, q.x, orientation.x
_TURN = r"(?<![a-z])[qr][._]?x|rot|orient|quat|euler|rpy|angle"
_KNOWN = (
    r"[rq]?[xyz]|qw|roll|pitch|yaw|[abcwpr]|r[1-3][1-3]|m[0-3][0-3]|"
    "picture|time|timestamp|episode|id|index|"
)
# "[mm]", "(deg)", "_mm": the fit finds units
_UNIT = r"\s*[\[(].*[\])]$|_(?:m|cm|mm|in|rad|deg|grad)$"
_NUMBER = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])"
_LIST = r"(\w*)[^\w\[\]\n]*\[([^\[\]]*)\]"
_KINDS = (".csv", ".json", ".npy", ".txt", ".yaml", ".yml")
_ROUNDED = 0.05  # of quaternions and matrices of few digits


@dataclass(frozen=True, eq=False)
class FlangeTable:
    """Flange poses as numbers, one row for each picture."""

    label: str
    numbers: Array  # (n, 3 + k): x, y, z and 3, 4 or 9 numbers of a turn
    pictures: Sequence[str] | None = None  # names of the rows' pictures
    named: str = ""  # the rotation that the columns' names mean
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
    A, B, C; w, p, r; r11 .. r33; or m00 .. m33, with a unit in brackets or behind "_" or without;
    those of axes may share more of their names (tcp_x, pos_x, orientation.x); a column of names of
    pictures may have any name.  Without a header six, seven, twelve or sixteen numbers, or
    matrices: as text, in brackets, in JSON, of `numpy.save` or `numpy.savez`, rotations and shifts
    together or apart; a folder or a pattern such as `shots/pose*.txt` has a file for each picture.
    Raises LogError, which lists these, where it is none.
    """
    place = Path(path)
    label = printable(str(place))
    if place.is_dir():
        place /= "*"
    if "*" in place.name:
        return _files(label, place)
    try:
        if place.suffix.lower() in (".npy", ".npz"):
            return FlangeTable(label, _poses(label, _arrays(label, place)))
        text = place.read_text(encoding="utf-8-sig")
    except (OSError, EOFError, ValueError):  # a pipe, UTF-16, Parquet
        return _table(open_source(path))
    with suppress(ValueError):
        return FlangeTable(label, _poses(label, json.loads(text)))
    return _text(label, text)


def _arrays(label: str, place: Path) -> Array | dict[str, list[Any]]:
    """The array of `numpy.save`, or those of `numpy.savez` as lists by name."""
    try:
        arrays = np.load(place)
        if isinstance(arrays, np.ndarray):
            return arrays
        with arrays:
            return {name: array.tolist() for name, array in arrays.items()}
    except (BadZipFile, EOFError, ValueError):
        raise LogError(
            f"{label} cannot be read: expected numbers alone, of numpy.save or numpy.savez"
        ) from None


def _files(label: str, pattern: Path) -> FlangeTable:
    """The poses of files with one each, in natural order."""
    poses = [
        read_flange_poses(path).numbers
        for path in sorted(pattern.parent.glob(pattern.name), key=natural_key)
        if path.suffix.lower() in _KINDS
    ]
    if len({pose.shape for pose in poses}) != 1 or len(poses[0]) != 1:
        raise LogError(
            f"{label} has {len(poses)} files of poses: expected one pose of one kind in each, of "
            f"{listing(_KINDS)}; a pattern such as 'shots/pose*.txt' names some of a folder"
        )
    return FlangeTable(label, np.concatenate(poses))


def _table(source: Source) -> FlangeTable:
    """The poses of a table with a header; columns of other things are left out."""
    shown = picture_column(source)
    names = {
        re.sub(_UNIT, "", name.lower()): name
        for name in source.header
        if name != shown
    }
    ways = _columns(set(names))
    if len(ways) != 1:
        odd = [
            name for key, name in names.items() if not re.fullmatch(_KNOWN, key)
        ]
        raise LogError(
            f"{source.label} has the columns {listing(source.header)}: expected {EXPECTED}; "
            f"rename or drop {listing(odd)}"
        )
    rotation, columns = ways[0]
    rows = number_rows_of(source, [names[column] for column in columns])
    if not len(rows.q):
        raise LogError(
            f"{source.label} has no row with numbers alone: expected decimals with a point"
        )
    return FlangeTable(
        source.label, rows.q, rows.pictures, rotation, rows.dropped
    )


def _columns(names: set[str]) -> list[tuple[str, list[str]]]:
    """All ways (rotation, columns) in which a header of small letters names a pose."""
    shifts = [["m03", "m13", "m23"]]
    turns = [(rotation, turn.split()) for rotation, turn in _TURNS.items()]
    for name in sorted(names):
        before, _, after = name.rpartition("x")
        x, y, z, w = (before + axis + after for axis in "xyzw")
        if name != x or not names.issuperset((y, z)):
            continue
        if not re.search(_TURN, name):
            shifts.append([x, y, z])
        elif w in names:
            turns.append(("xyzw", [x, y, z, w]))
        else:
            turns.append(("vector", [x, y, z]))
    return [
        (rotation, shift + turn)
        for shift in shifts
        for rotation, turn in turns
        if names.issuperset(shift + turn)
    ]


def _text(label: str, text: str) -> FlangeTable:
    """The poses of a text: lists in brackets, a table, or rows of numbers, perhaps with a name."""
    lines = [line for line in text.splitlines() if re.match(r"\s*[^\s#]", line)]
    text = "\n".join(lines)
    lists: dict[str, list[list[str]]] = {}
    for name, content in re.findall(_LIST, text):
        numbers = re.findall(_NUMBER, content)
        if len(numbers) > 3:
            lists.setdefault(name, []).append(numbers)
    if lists:
        return FlangeTable(label, _poses(label, lists))

    rows = [re.findall(_NUMBER, line) for line in lines]
    names = [re.sub(_NUMBER, "", line).strip(" ,;\t") for line in lines]
    if not rows or (names[0] and len(rows[0]) < 4):
        return _table(parse_source(text.encode(), label))
    words = sorted({re.sub(r"\d", "", name) for name in names})
    pictures = None
    if all(name.lower().endswith(PICTURES) for name in names):
        pictures = [file_name(name) for name in names]
    elif len(words) > 1:
        raise LogError(
            f"{label} has rows of several kinds, by the words {listing(words)} beside the "
            "numbers: keep those of one"
        )
    return FlangeTable(label, _poses(label, rows), pictures)


def _poses(label: str, document: Any) -> Array:
    """The only poses in a document (n, 3 + k), as of :func:`_shift_first`."""
    rows = list(_rows(document))
    names = {
        name
        for name, row in rows
        if _is_pose(row) and "joint" not in name.lower()
    }
    if len(names) > 1:
        raise LogError(
            f"{label} holds several poses, {listing(sorted(names))}: keep one of them"
        )
    poses = [row for name, row in rows if name in names]
    if len({len(row) * _is_pose(row) for row in poses}) != 1:
        raise LogError(
            f"{label} holds no poses, or some with other numbers between them: expected {EXPECTED}"
        )
    return _shift_first(np.array(poses, float))


def _rows(document: Any, path: str = "") -> Iterator[tuple[str, Array]]:
    """Poses and lists of numbers in a document, with their paths without digits."""
    if isinstance(document, dict):
        values = _axes(document)
        ways = _columns(set(values))
        if len(ways) == 1:
            yield path, np.array([values[column] for column in ways[0][1]])
            return
        poses = [(path, row) for row in _poses_of_parts(document)]
        yield from poses
        if poses:
            return
    elif isinstance(document, (list, np.ndarray)):
        with suppress(TypeError, ValueError):
            for row in _as_rows(np.array(document, float)):
                yield path, row
            return
        document = dict(enumerate(document))
    else:
        return
    for name in sorted(document, key=lambda name: natural_key(Path(str(name)))):
        inner = re.sub(r"\d+", "", f"{path}.{name}").strip(".")
        yield from _rows(document[name], inner)


def _poses_of_parts(document: dict[str, Any]) -> Array:
    """Poses (n, 12) by rows of rotations (.., 3, 3) and shifts (.., 3) apart; else none."""
    turns: list[Array] = []
    shifts: list[Array] = []
    for item in document.values():
        with suppress(TypeError, ValueError):
            part = np.array(item, float)
            if part.shape[-2:] == (3, 3) and _are_turns(part):
                turns.append(part.reshape(-1, 3, 3))
            elif 3 in part.shape[-2:]:
                shifts.append(part.reshape(-1, 3, 1))
    if [*map(len, turns)] != [*map(len, shifts)] or len(turns) != 1:
        return np.zeros((0, 12))
    return np.concatenate([*turns, *shifts], axis=2).reshape(-1, 12)


def _axes(document: Any, path: str = "") -> dict[str, float]:
    """Numbers in nested mappings by their paths in small letters; of lists by axes."""
    if isinstance(document, (int, float)):
        return {path: document}
    if isinstance(document, list) and len(document) < 5:
        axes = zip("xyzw", document, strict=False)
        document = {axis: n for axis, n in axes if isinstance(n, (int, float))}
    values: dict[str, float] = {}
    if isinstance(document, dict):
        for name, item in document.items():
            values |= _axes(item, f"{path}.{name}".lower())
    return values


def _as_rows(numbers: Array) -> Array:
    """Numbers as rows, of a row or of matrices in a stack, one below or one beside the other."""
    if numbers.ndim == 2 and len(numbers) == 4:
        last_rows = np.resize(np.eye(4)[3], numbers.shape[1])
        if np.allclose(numbers[3], last_rows):
            numbers = numbers.reshape(4, -1, 4).swapaxes(0, 1)
    elif numbers.ndim == 2 and numbers.shape[1] == 4:
        height = 3 if len(numbers) % 4 else 4
        numbers = numbers.reshape(-1, height, 4)
    if numbers.ndim == 1:
        return numbers[None]
    rows = numbers.reshape(len(numbers), -1)
    is_index = (np.diff(rows[:, 0]) > 0.0).all()
    if len(rows[0]) == 7:  # others are checked by their turns
        is_index &= not (rows[:, 0] % 1.0).any()
    if is_index and not _is_pose(rows[0]) and _is_pose(rows[0, 1:]):
        return rows[:, 1:]  # without indices or times
    behind_turns = np.roll(rows, 3, axis=1)
    is_behind = len(rows[0]) == 7 and not _is_pose(rows[0])
    if is_behind and all(map(_is_pose, behind_turns)):
        return behind_turns
    return rows


def _is_pose(row: Array) -> bool:
    """Whether numbers are a shift and three angles or a quaternion, or a matrix."""
    turn = np.zeros((0, 0))  # three angles are any
    if len(row) == 7:
        turn = row[None, 3:]
    elif len(row) in (12, 16):
        turn = row.reshape(-1, 4)[:3, :3]
    elif len(row) != 6:
        return False
    return _are_turns(turn) and bool(np.isfinite(row).all())


def _are_turns(turns: Array) -> bool:
    """Whether matrices (.., k, 3) are rotations, or quaternions (1, 4) of length 1."""
    products = turns @ turns.swapaxes(-1, -2)
    return np.allclose(products, np.eye(turns.shape[-2]), atol=_ROUNDED)


def _shift_first(numbers: Array) -> Array:
    """Rows (n, 3 + k) of x, y, z and a turn, of such rows or of matrices (n, 12 or 16) by rows.

    Matrices whose last column is 0, 0, 0, 1 are by columns, as Franka's controllers write them.
    """
    if numbers.shape[1] < 12:
        return numbers
    matrices = numbers.reshape(len(numbers), -1, 4)
    if matrices.shape[1] == 4 and np.allclose(matrices[:, :3, 3], 0.0):
        matrices = matrices.mT
    turns = matrices[:, :3, :3].reshape(-1, 9)
    return np.column_stack([matrices[:, :3, 3], turns])
