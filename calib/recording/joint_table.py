"""Joint values beside pictures or a video: one row for a picture, or one for a time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import Source, open_source, read_columns

_TIME_COLUMNS = ("time", "timestamp", "stamp", "t", "seconds", "time_s")
_PICTURE_COLUMNS = ("picture", "image", "file", "filename", "photo")
_EPISODE_COLUMNS = ("episode", "episode_index")
_OTHERS = ("x", "y", "z", "qx", "qy", "qz", "qw", "frame", "index", *_EPISODE_COLUMNS)

_TURNS = 4.0 * np.pi  # [rad]; joints that go beyond two turns are taken for degrees


@dataclass(frozen=True, eq=False)
class JointTable:
    """Joints as they were recorded."""

    label: str
    names: tuple[str, ...]
    # their values; rows with a missing one are left out, and counted in `dropped` (n, joints) [rad
    # or m]
    q: Array
    time: Array | None  # times of the rows, by the joints' clock (n,) [s]
    pictures: tuple[str, ...] | None  # names of the rows' pictures
    dropped: int = 0
    episodes: NDArray[np.intp] | None = None  # (n,), the series that each row is of


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
    time_column, picture_column = _named(source, _TIME_COLUMNS), _named(source, _PICTURE_COLUMNS)
    taken = {time_column, picture_column}
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
    time = read_columns(source, [time_column])[:, 0] if time_column else None
    pictures = None
    if picture_column:  # one may stand with its folder, of this system or another
        cells = source.read([picture_column])[picture_column].to_list()
        named = (str(cell or "").strip().replace("\\", "/") for cell in cells)
        pictures = [name.rpartition("/")[2] for name in named]
    episode_column = _named(source, _EPISODE_COLUMNS)
    episodes = read_columns(source, [episode_column])[:, 0] if episode_column else None
    good = np.isfinite(values).all(axis=1)
    if time is not None:
        good &= np.isfinite(time)
    turning = [k for k, name in enumerate(names) if name not in prismatic]
    q = values[good]
    if not len(q):
        raise LogError(f"{source.label} has no row with all of {listed(names)}")
    if degrees:
        q[:, turning] = np.deg2rad(q[:, turning])
    elif turning and np.abs(q[:, turning]).max() > _TURNS:
        k = turning[int(np.argmax(np.abs(q[:, turning]).max(axis=0)))]
        raise LogError(
            f"{source.label}: {names[k]} goes to {q[np.abs(q[:, k]).argmax(), k]:.4g} rad, more "
            "than two turns: are these degrees? expected rad, or `degrees=True`"
        )
    keep = np.flatnonzero(good)
    return JointTable(
        label=source.label,
        names=names,
        q=q,
        time=time[good] if time is not None else None,
        pictures=tuple(pictures[k] for k in keep) if pictures is not None else None,
        dropped=int((~good).sum()),
        episodes=episodes[good].astype(np.intp) if episodes is not None else None,
    )


def _named(source: Source, names: Sequence[str]) -> str | None:
    known = {name.lower(): name for name in reversed(source.header)}
    return next((known[name] for name in names if name in known), None)
