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

POSITION = ("x", "y", "z")

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
    def names(self) -> tuple[str, ...]:
        """No joints."""
        return ()

    @property
    def episodes(self) -> None:
        """No series."""
        return

    @property
    def q(self) -> Array:
        """No joint values (n, 0)."""
        return np.zeros((len(self.numbers), 0))


def read_flange_poses(path: str | os.PathLike[str]) -> FlangeTable:
    """Read a table of flange poses.

    Its columns are x, y, z and one of qx, qy, qz, qw; rx, ry, rz; roll, pitch, yaw; A, B, C;
    w, p, r; r11 .. r33; or m00 .. m33 alone; without a header six, seven, twelve or sixteen
    numbers.
    Raises LogError, which lists these, where it is none.
    """
    source = open_source(path)
    cells = " ".join(
        name.partition("_duplicated_")[0] for name in source.header
    ).split()
    if all(_is_number(cell) for cell in cells):
        return _without_header(path, source.label)
    header = {name.lower(): name for name in source.header}
    named, columns = _columns(set(header))
    expected = {name.lower() for name in (*columns, *MATRIX)} | IGNORED
    if not columns or header.keys() - expected:
        raise LogError(
            f"{source.label} has the columns {listed(source.header)}: expected {_expected()}"
        )
    values = source.numbers([header[name.lower()] for name in columns])[0]
    if columns[0] == "m00":
        values = _of_matrices(values.reshape(-1, 3, 4))
    good: Mask = np.asarray(np.isfinite(values).all(axis=1))
    pictures = None
    if "picture" in header:
        cells = source.read([header["picture"]])[header["picture"]].to_list()
        names = [
            str(cell or "").strip().replace("\\", "/").rpartition("/")[2]
            for cell in cells
        ]
        pictures = tuple(
            name for name, whole in zip(names, good, strict=True) if whole
        )
    return _checked(source, values, good, pictures, named)


def _columns(header: set[str]) -> tuple[str, list[str]]:
    """The rotation that names of columns (small letters) say, and its columns, if all are there."""
    kinds = {kind: [*POSITION, *names] for kind, names in TURNS.items()}
    for kind, columns in (("matrix", list(MATRIX[:12])), *kinds.items()):
        if header.issuperset(name.lower() for name in columns):
            return "rpy" if kind == "fanuc" else kind, columns
    return "", []


def _without_header(
    path: str | os.PathLike[str] | Source, label: str
) -> FlangeTable:
    if isinstance(path, Source) or os.fspath(path) == "-":
        raise LogError(f"{label} has no header: expected {_expected()}")
    text = Path(path).read_text(encoding="utf-8-sig")
    lines = re.sub(r"[;,\t]", " ", text).splitlines()
    try:
        values = np.array(
            [line.split() for line in lines if line.strip()], float
        )
        count = values.shape[1]
    except ValueError:
        count = 0
    if count not in _LENGTHS:
        raise LogError(
            f"{label} has no header and {count} numbers a row: expected {_expected()}"
        )
    if count >= 12:
        values = _of_matrices(values.reshape(len(values), -1, 4)[:, :3])
    good = np.isfinite(values).all(axis=1)
    return FlangeTable(label, values[good], None, "", int((~good).sum()))


def _checked(
    source: Source,
    values: Array,
    good: Mask,
    pictures: tuple[str, ...] | None,
    named: str,
) -> FlangeTable:
    values = values[good]
    if len(values) and values.shape[1] > 6:
        lengths = np.linalg.norm(values[:, 3:], axis=1)
        expected = 1.0 if values.shape[1] == 7 else np.sqrt(3.0)
        wrong = np.flatnonzero(np.abs(lengths / expected - 1.0) > _TOLERANCE)
        if len(wrong):
            what = "quaternion" if values.shape[1] == 7 else "rotation matrix"
            raise LogError(
                f"{source.label}, row {wrong[0] + 1}: a {what} of length {lengths[wrong[0]]:.4g}, "
                f"expected {expected:.4g}"
            )
    return FlangeTable(
        source.label, values, pictures, named, int((~good).sum())
    )


def _of_matrices(rows: Array) -> Array:
    """Positions and turns (n, 12) of the first three rows of matrices (n, 3, 4)."""
    return np.column_stack([rows[:, :, 3], rows[:, :, :3].reshape(-1, 9)])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _expected() -> str:
    kinds = [f"{names[0]}..{names[-1]}" for names in TURNS.values()]
    return (
        f"x, y, z and one of {', '.join(kinds)}, or m00..m33, and perhaps picture; without a "
        "header six, seven, twelve or sixteen numbers"
    )
