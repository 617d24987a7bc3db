"""Tables of joints that were recorded beside pictures or a video."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import Source, open_source
from .pictures import Frame, list_pictures, read_series

_OTHERS = {
    *("time", "timestamp", "picture", "episode"),
    *("x", "y", "z", "qx", "qy", "qz", "qw"),
}
# [rad]; joints that go beyond two turns are taken for degrees
_TURNS = 4.0 * np.pi


def joint_columns(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table that are not a time, a picture or a position."""
    return tuple(name for name in header if name.lower() not in _OTHERS)


@dataclass(frozen=True, eq=False)
class JointTable:
    """Joints as they were recorded; rows with a missing value are left out, and counted."""

    label: str
    names: tuple[str, ...]
    q: Array  # (n, joints) [rad or m]
    time: Array | None  # times of the rows, by the joints' clock (n,) [s]
    pictures: tuple[str, ...] | None  # names of the rows' pictures
    dropped: int = 0
    episodes: Index | None = None  # (n,), the series that each row is of


def read_joints(
    path: str | os.PathLike[str],
    joints: Sequence[str] | None = None,
    *,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> JointTable:
    """Read a table of joints; a column `time` [s] or `picture` says what a row is of.

    joints : the joints' columns; all columns of numbers but those if not given
    degrees, prismatic : whether joints that turn are in degrees, and which slide [m]
    Raises LogError if there are no joints, or they look like degrees and are not said to be.
    """
    source = open_source(path)
    beside = [name for name in ("time", "episode") if name in source.header]
    names = list(joint_columns(source.header) if joints is None else joints)
    values = source.numbers([*names, *beside])[0]
    about = values[:, len(names) :]
    values = values[:, : len(names)]
    if joints is None:
        numbers = np.isfinite(values).any(axis=0)
        names = [names[k] for k in np.flatnonzero(numbers)]
        values = values[:, numbers]
    good: Mask = np.asarray(
        np.isfinite(np.column_stack([values, about])).all(axis=1)
    )
    if not names or not good.any():
        raise LogError(
            f"{source.label} has no row with numbers for {listed(names)}: expected a column for "
            f"each joint; columns: {listed(source.header)}"
        )
    q = values[good]
    turning = [k for k, name in enumerate(names) if name not in prismatic]
    most = float(np.abs(q[:, turning]).max(initial=0.0))
    if degrees:
        q[:, turning] = np.deg2rad(q[:, turning])
    elif most > _TURNS:
        raise LogError(
            f"{source.label}: a joint goes to {most:.4g} rad, more than two turns: are these "
            "degrees? expected rad, or `degrees=True`"
        )
    columns = dict(zip(beside, about[good].T, strict=True))
    pictures = None
    if "picture" in source.header:
        pictures = picture_names(source, "picture", good)
    episodes = columns.get("episode")
    return JointTable(
        source.label,
        tuple(names),
        q,
        columns.get("time"),
        pictures,
        dropped=int((~good).sum()),
        episodes=None if episodes is None else episodes.astype(np.intp),
    )


def picture_names(source: Source, column: str, good: Mask) -> tuple[str, ...]:
    """Names of some rows' pictures, without their folders, of this system or another."""
    cells = source.read([column])[column].to_list()
    names = [
        str(cell or "").strip().replace("\\", "/").rpartition("/")[2]
        for cell in cells
    ]
    return tuple(names[k] for k in np.flatnonzero(good))


def read_shots(
    table: JointTable, source: str | os.PathLike[str] | Sequence[str]
) -> tuple[list[int], Iterator[Frame], list[str]]:
    """Rows of the joints (p), in their order, the picture of each, and what is left out.

    Notes of damaged pictures come as these are read.
    Raises LogError if names of pictures do not fit, or without names their counts.
    """
    pictures = list_pictures(source)
    count = len(table.q) + table.dropped
    notes: list[str] = []
    rows = list(range(len(table.q)))
    paths = pictures
    if table.pictures is not None:
        by_name: dict[str, Path] = {}
        for path in reversed(pictures):
            by_name |= {path.stem: path, path.name: path}
        rows = [
            row for row, name in enumerate(table.pictures) if name in by_name
        ]
        paths = [by_name[table.pictures[row]] for row in rows]
        lonely = {
            "rows of joints, without a picture": len(table.pictures),
            "pictures, without joints": len(pictures),
        }
        for what, number in lonely.items():
            if number > len(rows):
                notes.append(f"{number - len(rows)} {what}, are left out")
    is_by_order = table.pictures is None and count != len(pictures)
    if not rows or len(set(paths)) != len(rows) or is_by_order:
        named = (
            f", which name {listed(table.pictures, 3)}"
            if table.pictures
            else ""
        )
        raise LogError(
            f"{len(pictures)} pictures and {count} rows of joints in "
            f"{table.label} ({table.dropped} with a missing value){named}: expected one row for "
            "each picture, in the order of names or by a column 'picture'"
        )
    return rows, read_series(paths, notes), notes
