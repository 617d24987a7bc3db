"""Tables of flange poses as controllers write them, in any convention."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..common.arrays import Array
from ..common.wording import listing
from ..errors import LogError
from ..samples.tables import open_source
from .joint_table import JointTable, finite_rows, picture_column

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
    "and perhaps picture; without a header six, seven, twelve or sixteen numbers"
)

_LENGTHS = (6, 7, 12, 16)  # numbers of a row without a header
_IGNORED = {"picture", "time", "timestamp", "episode", *map(str.lower, MATRIX)}
# "[mm]", "(deg)", "_mm": the fit finds units
_UNIT = r"\s*[\[(].*[\])]$|_(?:m|cm|mm|in|rad|deg|grad)$"


@dataclass(frozen=True, eq=False)
class FlangeTable:
    """Flange poses as numbers, one row for each picture."""

    label: str
    numbers: Array  # (n, 3 + k): x, y, z and 3, 4 or 9 numbers of a turn
    pictures: Sequence[str] | None  # names of the rows' pictures
    named: str = ""  # the rotation that the columns' names say
    dropped: int = 0  # rows with a missing value

    @property
    def joints(self) -> JointTable:
        """The same rows without a joint."""
        q = np.zeros((len(self.numbers), 0))
        return JointTable(self.label, (), q, None, self.pictures, self.dropped)


def read_flange_poses(path: str | os.PathLike[str]) -> FlangeTable:
    """Read a table of flange poses.

    Its columns are x, y, z and one of qx, qy, qz, qw; rx, ry, rz; roll, pitch, yaw; A, B, C;
    w, p, r; r11 .. r33; or m00 .. m33 alone, with a unit in brackets or behind "_" or without; a
    column of names of pictures may have any name; without a header six, seven, twelve or sixteen
    numbers.
    Raises LogError, which lists these, where it is none.
    """
    source = open_source(path)
    label = source.label
    cells = [name.partition("_duplicated_")[0] for name in source.header]
    named = ""
    pictures = None
    dropped = 0
    if re.fullmatch(r"[-+\d.eE\s]+", " ".join(cells)):
        numbers = _without_header(Path(path), label)
    else:
        shown = picture_column(source)
        names = {
            re.sub(_UNIT, "", name.lower()): name
            for name in source.header
            if name != shown
        }
        named, columns = _columns(set(names))
        if not columns or names.keys() - {*columns, *_IGNORED}:
            raise LogError(
                f"{label} has the columns {listing(source.header)}: expected {EXPECTED}"
            )
        rows = finite_rows(source, [names[column] for column in columns])
        numbers = rows.numbers
        pictures = rows.pictures
        dropped = rows.dropped
    if not len(numbers):
        raise LogError(
            f"{label} has no row with numbers alone: expected decimals with a point"
        )
    if numbers.shape[1] >= 12 and named != "matrix":
        lines = numbers[:, :12].reshape(-1, 3, 4)
        turns = lines[:, :, :3].reshape(-1, 9)
        numbers = np.column_stack([lines[:, :, 3], turns])
    return FlangeTable(label, numbers, pictures, named, dropped)


def _columns(header: set[str]) -> tuple[str, list[str]]:
    """The rotation that names of columns (small letters) say, and its columns, if all are there."""
    if header.issuperset(MATRIX[:12]):
        return "", list(MATRIX[:12])
    for kind, names in TURNS.items():
        columns = ["x", "y", "z", *map(str.lower, names)]
        if header.issuperset(columns):
            return "rpy" if kind == "fanuc" else kind, columns
    return "", []


def _without_header(path: Path, label: str) -> Array:
    """Numbers (n, 6, 7, 12 or 16) of a file."""
    text = re.sub(r"[;,\t]", " ", path.read_text(encoding="utf-8-sig"))
    try:
        numbers = np.loadtxt(text.splitlines(), ndmin=2)
    except ValueError as error:
        raise LogError(f"{label}: {error}") from None
    if numbers.shape[1] not in _LENGTHS:
        raise LogError(
            f"{label} has no header and {numbers.shape[1]} numbers a row: expected {EXPECTED}"
        )
    return numbers
