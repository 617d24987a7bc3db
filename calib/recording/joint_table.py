"""Joint values beside pictures or a video: one row for a picture, or one for a time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import Source, open_source
from .pictures import Frame, list_pictures, read_series

_TIMES = ("time", "timestamp", "stamp", "t")
_PICTURES = ("picture", "image", "file", "filename")
_EPISODES = ("episode", "episode_index")
_OTHERS = {*_TIMES, *_PICTURES, *_EPISODES, "x", "y", "z", "qx", "qy", "qz", "qw"}
_TURNS = 4.0 * np.pi  # [rad]; joints that go beyond two turns are taken for degrees


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
    stamp, picture, series = (_named(source, kind) for kind in (_TIMES, _PICTURES, _EPISODES))
    names = [name for name in source.header if name.lower() not in _OTHERS]
    values = source.numbers(names if joints is None else joints)[0]
    if joints is None:
        numbers = np.isfinite(values).any(axis=0)
        names, values = [names[k] for k in np.flatnonzero(numbers)], values[:, numbers]
    names = list(names if joints is None else joints)
    time = None if stamp is None else source.numbers([stamp])[0][:, 0]
    good = np.isfinite(values).all(axis=1) & (True if time is None else np.isfinite(time))
    if not names or not good.any():
        raise LogError(
            f"{source.label} has no row with numbers for {listed(names)}: expected a column for "
            f"each joint; columns: {listed(source.header)}"
        )
    q, turning = values[good], [k for k, name in enumerate(names) if name not in prismatic]
    most = float(np.abs(q[:, turning]).max(initial=0.0))
    if degrees:
        q[:, turning] = np.deg2rad(q[:, turning])
    elif most > _TURNS:
        told = f"{source.label}: a joint goes to {most:.4g} rad, more than two turns"
        raise LogError(f"{told}: are these degrees? expected rad, or `degrees=True`")
    pictures = None
    if picture:  # one may stand with its folder, of this system or another
        cells = np.array(source.read([picture])[picture].to_list(), object)[good]
        named = (str(cell or "").strip().replace("\\", "/") for cell in cells)
        pictures = tuple(name.rpartition("/")[2] for name in named)
    return JointTable(
        source.label, tuple(names), q, None if time is None else time[good], pictures,
        int((~good).sum()),
        None if series is None else source.numbers([series])[0][good, 0].astype(np.intp),
    )  # fmt: skip


def _named(source: Source, kinds: Sequence[str]) -> str | None:
    return next((name for name in source.header if name.lower() in kinds), None)


def read_shots(
    table: JointTable, source: str | os.PathLike[str] | Sequence[str]
) -> tuple[list[int], Iterator[Frame], list[str]]:
    """Rows of the joints (p), in their order, the picture of each, and what is left out.

    Notes of damaged pictures come as these are read.
    Raises LogError if names of pictures do not fit, or without names their counts.
    """
    found, notes = list_pictures(source), list[str]()
    rows, paths = list(range(len(table.q))), found
    if table.pictures is not None:
        by_name = {name: path for path in reversed(found) for name in (path.stem, path.name)}
        rows = [row for row, name in enumerate(table.pictures) if name in by_name]
        paths = [by_name[table.pictures[row]] for row in rows]
        left = len(table.pictures) - len(rows), len(found) - len(rows)
        kinds = "rows of joints, without a picture", "pictures, without joints"
        notes = [f"{n} {what}, are left out" for n, what in zip(left, kinds, strict=True) if n]
    if not rows or len(set(paths)) != len(rows) or (table.pictures is None and table.dropped):
        named = f", which name {listed(table.pictures, 3)}" if table.pictures else ""
        raise LogError(
            f"{len(found)} pictures and {len(table.q) + table.dropped} rows of joints in "
            f"{table.label} ({table.dropped} with a missing value){named}: expected one row for "
            "each picture, in the order of names or by a column 'picture'"
        )
    return rows, read_series(paths, notes), notes
