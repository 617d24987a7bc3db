"""Flange poses as controllers and programs write them: tables, lists in text, JSON, NumPy."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.choices import PICTURES
from ..common.wording import listing, printable
from ..errors import LogError
from ..samples.tables import Source, open_source, parse_source
from .documents import Json, parse_document
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

# start of a column of a turn: rx, tcp_rx, rot_x, q.x, orientation.x
_TURN = r"(?<![a-z])[qr][._]?x|rot|orient|quat|euler|rpy|angle"
_KNOWN = (
    r"[rq]?[xyz]|qw|roll|pitch|yaw|[abcwpr]|r[1-3][1-3]|m[0-3][0-3]|"
    "picture|time|timestamp|episode|id|index|"
)
# names of the board before the camera in MoveIt, easy_handeye and OpenCV's arguments
_BOARD = "(?i:object_wrt|optical|target2?cam|board)"
# "[mm]", "(deg)", "_mm": ignored, since the fit finds units
_UNIT = r"\s*[\[(].*[\])]$|_(?:m|cm|mm|in|rad|deg|grad)$"
_NUMBER = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])"
_LIST = r"(\w*)[^\w\[\]\n]*\[([^\[\]]*)\]"
_KINDS = (".csv", ".txt", ".json", ".npy", ".npz", ".yaml", ".yml")
_ROUNDED = 0.05  # largest rounding error of quaternions and matrices


@dataclass(frozen=True, eq=False)
class FlangeTable:
    """Flange poses as numbers, one row for each picture."""

    label: str
    numbers: Array  # (n, 3 + k): x, y, z and 3, 4 or 9 numbers of a turn
    pictures: Sequence[str] | None = None  # names of the rows' pictures
    named: str = ""  # the rotation by the columns' names
    dropped: int = 0  # rows with a missing value
    # the user's options; by default all readings are tried
    unit: str | None = None
    rotation: str | None = None
    degrees: bool | None = None

    @property
    def joints(self) -> JointTable:
        """The rows as a table without joints."""
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
        files: dict[str, Json] = {}
        for file in place.parent.glob(place.name):
            if file.suffix.lower() in _KINDS:
                content = _document(file)
                if isinstance(content, str):
                    content = _numbers(_filled(content))
                files[file.stem] = content
        return _poses(label, files)
    try:
        content = _document(place)
    except (OSError, EOFError, ValueError):  # a pipe, UTF-16, Parquet
        return _table(open_source(path))
    if isinstance(content, str):
        return _text(label, content)
    return _poses(label, content)


def _document(path: Path) -> Json:
    """The document that a file is, or its text."""
    kind = path.suffix.lower()
    if kind in (".npy", ".npz"):
        return _arrays(path)
    text = path.read_text(encoding="utf-8-sig")
    with suppress(ValueError, RecursionError):
        is_yaml = kind in (".yaml", ".yml")
        return parse_document(text) if is_yaml else json.loads(text)
    return text


def _filled(text: str) -> list[str]:
    """Lines of a text without empty ones and comments."""
    lines = map(str.strip, text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def _numbers(lines: Sequence[str]) -> list[list[str]]:
    """The numbers in each line."""
    return [re.findall(_NUMBER, line) for line in lines]


def _arrays(path: Path) -> Array | dict[str, list[Json]]:
    """The array of `numpy.save`, or those of `numpy.savez` as lists by name."""
    try:
        arrays = np.load(path)
        if isinstance(arrays, np.ndarray):
            return arrays
        with arrays:
            return {name: array.tolist() for name, array in arrays.items()}
    except (BadZipFile, EOFError, ValueError):
        raise LogError(
            f"{path} cannot be read: expected numbers alone, of numpy.save or numpy.savez"
        ) from None


def _table(source: Source) -> FlangeTable:
    """The poses of a table with a header; other columns are ignored."""
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
    """All ways (rotation, columns) in which a header, in lower case, names a pose."""
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
    above = re.findall(r"\A\s*(?:#.*\s+)*(#.*)", text)
    lines = _filled(text) or [""]
    text = "\n".join(lines)
    lists: dict[str, list[list[str]]] = {}
    for name, content in re.findall(_LIST, text):
        numbers = re.findall(_NUMBER, content)
        if len(numbers) > 3:
            lists.setdefault(name, []).append(numbers)
    if lists:
        return _poses(label, lists)

    # a header in a comment, as numpy.savetxt writes it
    table = _named_columns([*above, *lines]) or _named_columns(lines)
    rows = _numbers(lines)
    names = [re.sub(_NUMBER, "", line).strip(" ,;\t") for line in lines]
    is_named = names[0] or not text
    if table or (is_named and len(rows[0]) < 4):
        return _table(parse_source((table or text).encode(), label))
    words = sorted({re.sub(r"\d", "", name) for name in names})
    pictures = None
    if all(name.lower().endswith(PICTURES) for name in names):
        pictures = [file_name(name) for name in names]
    elif len(words) > 1:
        raise LogError(
            f"{label} has rows of several kinds, by the words {listing(words)} beside the "
            "numbers: keep those of one"
        )
    return _poses(label, rows, pictures)


def _named_columns(lines: Sequence[str]) -> str:
    """A table with commas from lines whose first one names columns between blanks; else ""."""
    # without units in brackets
    plain = [re.sub(r"\s*[\[(].*?[\])]", "", line) for line in lines]
    table = [re.split(r"[\s,;]+", line.strip("# \t")) for line in plain]
    names = {re.sub(_UNIT, "", name.lower()) for name in table[0]}
    if len(table[0]) != len(table[-1]) or len(_columns(names)) != 1:
        return ""
    return "\n".join(map(",".join, table))


def _poses(
    label: str, document: Json, pictures: Sequence[str] | None = None
) -> FlangeTable:
    """The only poses in a document."""
    rows = list(_rows(document))
    names = _of_flange({name for name, row in rows if _is_pose(row)})
    if len(names) > 1:
        raise LogError(
            f"{label} holds several poses, {listing(sorted(names))}: keep one of them"
        )
    poses = [row for name, row in rows if name in names]
    if len({len(row) * _is_pose(row) for row in poses}) != 1:
        raise LogError(
            f"{label} holds no poses, or some with other numbers between them: expected {EXPECTED}"
        )
    numbers = _shift_first(np.array(poses, float))
    return FlangeTable(label, numbers, pictures)


def _of_flange(names: Iterable[str]) -> set[str]:
    """Names without those of joints, and without those of a board if there are others."""
    no_joints = {name for name in names if "joint" not in name.lower()}
    no_boards = {name for name in no_joints if not re.search(_BOARD, name)}
    return no_boards or no_joints


def _rows(document: Json, path: str = "") -> Iterator[tuple[str, Array]]:
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
    for name, item in _items(document):
        yield from _rows(item, f"{path}.{name}".strip("."))


def _poses_of_parts(document: dict[str, Json]) -> Array:
    """Poses (n, 12), by rows, of separate rotations (.., 3, 3) and shifts (.., 3); else none."""
    # by number of columns and name
    parts: dict[tuple[int, str], list[Array]] = {}
    for name, item in _items(document):
        with suppress(TypeError, ValueError, KeyError):
            # OpenCV's matrices have their numbers by rows
            numbers = item["data"] if isinstance(item, dict) else item
            array = np.array(numbers, float)
            if array.size != 9 and 3 not in array.shape[-2:]:
                continue
            part = array.reshape(-1, 3, 1)
            if len(part) % 3 == 0 and _are_turns(part.reshape(-1, 3, 3)):
                part = part.reshape(-1, 3, 3)
            parts.setdefault((part.shape[2], name), []).append(part)
    names = _of_flange(name for _, name in parts)
    chosen = sorted(key for key in parts if key[1] in names)
    if [width for width, _ in chosen] != [1, 3]:
        return np.zeros((0, 12))
    shifts, turns = (np.concatenate(parts[key]) for key in chosen)
    if len(shifts) != len(turns):
        return np.zeros((0, 12))
    return np.concatenate([turns, shifts], axis=2).reshape(-1, 12)


def _items(document: dict[str, Json]) -> list[tuple[str, Json]]:
    """Names without digits, and values of a mapping, in natural order."""
    names = sorted(document, key=lambda name: natural_key(Path(str(name))))
    return [(re.sub(r"\d+", "", str(name)), document[name]) for name in names]


def _axes(document: Json, path: str = "") -> dict[str, float]:
    """Numbers in nested mappings by their paths in lower case; in lists by their axes."""
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
    """Numbers as rows: those of a row, or of matrices in a stack, below or beside each other."""
    if numbers.ndim == 2 and len(numbers) == 4:
        last_rows = np.resize(np.eye(4)[3], numbers.shape[1])
        if np.allclose(numbers[3], last_rows):
            numbers = numbers.reshape(4, -1, 4).swapaxes(0, 1)
    elif numbers.ndim == 2 and numbers.shape[1] == 4:
        height = 3 if len(numbers) % 4 else 4
        numbers = numbers.reshape(-1, height, 4)
    if numbers.ndim < 2 or not numbers.size:
        return numbers.reshape(1, -1)
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
    products = turns @ turns.mT
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
