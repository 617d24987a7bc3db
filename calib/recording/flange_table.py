"""Tables of flange poses as controllers write them, in any convention."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Mask
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import Source, open_source
from .joint_table import JointTable, picture_names

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
_TOLERANCE = 0.02  # of the length of a quaternion, or of a matrix's rows
IGNORED = {"picture", "time", "timestamp", "episode"}


@dataclass(frozen=True, eq=False)
class FlangeTable:
    """Flange poses as numbers, one row for each picture."""

    label: str
    numbers: Array  # (n, 3 + k): x, y, z and 3, 4 or 9 numbers of a turn
    pictures: tuple[str, ...] | None  # names of the rows' pictures
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
    w, p, r; r11 .. r33; or m00 .. m33 alone; without a header six, seven, twelve or sixteen
    numbers.
    Raises LogError, which lists these, where it is none.
    """
    source = open_source(path)
    header = {name.lower(): name for name in source.header}
    pictures = None
    named = ""
    cells = [name.partition("_duplicated_")[0] for name in source.header]
    if re.fullmatch(r"[-+\d.eE\s]+", " ".join(cells)):
        values = _without_header(path, source.label)
    else:
        named, columns = _columns(set(header))
        expected = {name.lower() for name in (*columns, *MATRIX)} | IGNORED
        if not columns or header.keys() - expected:
            raise LogError(
                f"{source.label} has the columns {listed(source.header)}: expected {EXPECTED}"
            )
        values = source.numbers([header[name.lower()] for name in columns])[0]
    if values.shape[1] >= 12 and named != "matrix":
        rows = values[:, :12].reshape(-1, 3, 4)
        values = np.column_stack([rows[:, :, 3], rows[:, :, :3].reshape(-1, 9)])
    good: Mask = np.asarray(np.isfinite(values).all(axis=1))
    if "picture" in header:
        pictures = picture_names(source, header["picture"], good)
    values = values[good]
    if len(values) and values.shape[1] > 6:
        lengths = np.linalg.norm(values[:, 3:], axis=1)
        length = 1.0 if values.shape[1] == 7 else np.sqrt(3.0)
        wrong = np.flatnonzero(np.abs(lengths / length - 1.0) > _TOLERANCE)
        if len(wrong):
            what = "quaternion" if values.shape[1] == 7 else "rotation matrix"
            raise LogError(
                f"{source.label}, row {wrong[0] + 1}: a {what} of length {lengths[wrong[0]]:.4g}, "
                f"expected {length:.4g}"
            )
    dropped = int((~good).sum())
    return FlangeTable(source.label, values, pictures, named, dropped)


def _columns(header: set[str]) -> tuple[str, list[str]]:
    """The rotation that names of columns (small letters) say, and its columns, if all are there."""
    if header.issuperset(MATRIX[:12]):
        return "", list(MATRIX[:12])
    for kind, names in TURNS.items():
        columns = ["x", "y", "z", *names]
        if header.issuperset(name.lower() for name in columns):
            return "rpy" if kind == "fanuc" else kind, columns
    return "", []


def _without_header(path: str | os.PathLike[str] | Source, label: str) -> Array:
    """Numbers (n, 6, 7, 12 or 16) of a file."""
    count = 0
    if not isinstance(path, Source) and os.fspath(path) != "-":
        text = Path(path).read_text(encoding="utf-8-sig")
        lines = re.sub(r"[;,\t]", " ", text).splitlines()
        try:
            values = np.array([line.split() for line in lines if line.strip()])
            values = values.astype(float)
            count = values.shape[1]
        except (ValueError, IndexError):
            count = 0
    if count not in _LENGTHS:
        raise LogError(
            f"{label} has no header and {count} numbers a row: expected {EXPECTED}"
        )
    return values
