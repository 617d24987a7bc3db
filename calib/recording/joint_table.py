"""Joint values beside pictures or a video: one row for a picture, or one for a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Index
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import Source, open_source, read_columns

_TIMES = ("time", "timestamp", "stamp", "t", "seconds", "time_s")
_PICTURES = ("picture", "image", "file", "filename", "photo")
_EPISODES = ("episode", "episode_index")
_OTHERS = {"x", "y", "z", "qx", "qy", "qz", "qw", "frame", "index", *_EPISODES}
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
    stamps, time = _column(source, _TIMES)
    _, series = _column(source, _EPISODES)
    picture = _named(source, _PICTURES)
    taken = {stamps, picture}
    others = (n for n in source.header if n not in taken and n.lower() not in _OTHERS)
    names = tuple(others if joints is None else joints)
    values = read_columns(source, names)
    if joints is None:
        numbers = np.flatnonzero(np.isfinite(values).any(axis=0))
        names, values = tuple(names[k] for k in numbers), values[:, numbers]
    if not names:
        raise LogError(
            f"{source.label} has no column of numbers that could be a joint; columns: "
            f"{listed(source.header)}"
        )
    good = np.isfinite(values).all(axis=1) & (True if time is None else np.isfinite(time))
    q, keep = values[good], np.flatnonzero(good)
    if not len(q):
        raise LogError(f"{source.label} has no row with all of {listed(names)}")
    turning = [k for k, name in enumerate(names) if name not in prismatic]
    if degrees:
        q[:, turning] = np.deg2rad(q[:, turning])
    for k in turning:
        most = float(np.abs(q[:, k]).max())
        if not degrees and most > _TURNS:
            told = f"{source.label}: {names[k]} goes to {most:.4g} rad, more than two turns"
            raise LogError(f"{told}: are these degrees? expected rad, or `degrees=True`")
    pictures = None
    if picture:  # one may stand with its folder, of this system or another
        cells = source.read([picture])[picture].to_list()
        named = [str(cell or "").strip().replace("\\", "/") for cell in cells]
        pictures = tuple(named[k].rpartition("/")[2] for k in keep)
    return JointTable(
        source.label,
        names,
        q,
        None if time is None else time[good],
        pictures,
        len(values) - len(q),
        None if series is None else series[good].astype(np.intp),
    )


def _named(source: Source, names: Sequence[str]) -> str | None:
    known = {name.lower(): name for name in reversed(source.header)}
    return next((known[name] for name in names if name in known), None)


def _column(source: Source, names: Sequence[str]) -> tuple[str | None, Array | None]:
    """The first of some columns that is there, and its numbers (n,)."""
    name = _named(source, names)
    return name, None if name is None else read_columns(source, [name])[:, 0]


def match_rows(
    table: JointTable, pictures: Sequence[Path]
) -> tuple[list[tuple[int, Path]], list[str]]:
    """Pair rows of the joints with their pictures, in the rows' order; notes say what is left.

    Raises LogError if their names do not fit, or without names their counts.
    """
    if table.pictures is None:
        rows = len(table.q) + table.dropped
        if rows != len(pictures) or table.dropped:
            why = f", {table.dropped} of them with a missing value" if table.dropped else ""
            raise LogError(
                f"{len(pictures)} pictures and {rows} rows of joints in {table.label}{why}: "
                "expected one row for each picture in the order of names, or a column 'picture'"
            )
        return list(enumerate(pictures)), []
    by_name = {path.stem: path for path in reversed(pictures)}
    by_name |= {path.name: path for path in pictures}
    pairs = [(row, by_name[n]) for row, n in enumerate(table.pictures) if n in by_name]
    twice = [path.name for path, rows in Counter(path for _, path in pairs).items() if rows > 1]
    if twice or not pairs:
        names = f"more than one row for {listed(twice, 3)}" if twice else "none of the pictures"
        raise LogError(
            f"{table.label} names {names}: it has {listed(table.pictures, 3)}, there are "
            f"{listed((p.name for p in pictures), 3)}; expected one row for each picture"
        )
    notes = []
    if missing := len(table.pictures) - len(pairs):
        notes.append(f"{missing} rows of joints left out: their pictures are not there")
    if more := len(pictures) - len(pairs):
        notes.append(f"{more} pictures left out: no row of joints names them")
    return pairs, notes
