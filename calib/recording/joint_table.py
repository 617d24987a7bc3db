"""Joint values beside pictures or a video, of a table or of a LeRobotDataset v3 folder.

Its layout is that of huggingface/lerobot, src/lerobot/datasets.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import thinned
from ..common.wording import listed
from ..errors import LogError
from ..samples.tables import open_source
from .pictures import Frame, Picture, Video, list_pictures, read_series

_OTHERS = {"time", "timestamp", "picture", "episode", "x", "y", "z", "qx", "qy", "qz", "qw"}
_TURNS = 4.0 * np.pi  # [rad]; joints that go beyond two turns are taken for degrees
_STATE = "observation.state"
_SHARE = "gripper"  # always a share of its range, and no joint of the arm
_WINDOW = 0.2  # s, of which the slowest frame is taken
_STILL = 0.05  # rad/s; blur and a late frame stay below a pixel
_APART = np.radians(1.0)  # of two rests: those of one place tell no more than one of them
_MOST, _LEAST = 80, 12  # frames that are taken, and that are needed although the arm moves
_TURN = 2 * np.pi + 0.1  # values beyond it are no radians
_BOUND = 100.0  # of normalised values, which LeRobot clips there


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
    told = [name for name in ("time", "episode") if name in source.header]
    others = [name for name in source.header if name.lower() not in _OTHERS]
    names = list(others if joints is None else joints)
    values = source.numbers([*names, *told])[0]
    about, values = dict(zip(told, values[:, len(names) :].T, strict=True)), values[:, : len(names)]
    if joints is None:
        numbers = np.isfinite(values).any(axis=0)
        names, values = [names[k] for k in np.flatnonzero(numbers)], values[:, numbers]
    good = np.isfinite(np.column_stack([values, *about.values()])).all(axis=1)
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
        raise LogError(
            f"{source.label}: a joint goes to {most:.4g} rad, more than two turns: are these "
            "degrees? expected rad, or `degrees=True`"
        )
    pictures = None
    if "picture" in source.header:  # one may stand with its folder, of this system or another
        cells = np.array(source.read(["picture"])["picture"].to_list(), object)[good]
        named = (str(cell or "").strip().replace("\\", "/") for cell in cells)
        pictures = tuple(name.rpartition("/")[2] for name in named)
    about = {name: column[good] for name, column in about.items()}
    episodes = about["episode"].astype(np.intp) if "episode" in about else None
    dropped, time = int((~good).sum()), about.get("time")
    return JointTable(source.label, tuple(names), q, time, pictures, dropped, episodes)


class Table(Protocol):
    """What was recorded beside pictures, one row for each."""

    @property
    def label(self) -> str: ...  # noqa: D102
    @property
    def q(self) -> Array: ...  # noqa: D102
    @property
    def pictures(self) -> tuple[str, ...] | None: ...  # noqa: D102
    @property
    def dropped(self) -> int: ...  # noqa: D102


def read_shots(
    table: Table, source: str | os.PathLike[str] | Sequence[str]
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


def is_dataset(path: object) -> bool:
    """Whether this is the folder of a LeRobotDataset."""
    return isinstance(path, (str, os.PathLike)) and (Path(path) / "meta" / "info.json").is_file()


def read_dataset(
    source: str | os.PathLike[str], joints: Sequence[str] | None = None, camera: str | None = None
) -> tuple[JointTable, list[Picture], list[str]]:
    """Read still frames of a dataset, and their joints; notes say what was taken, in which unit.

    joints : their names; all but the gripper where not given
    camera : the feature or the end of its name, such as ``"wrist"``; by default the only one
    Raises LogError in one line if the dataset is of another version, or its videos cannot be read.
    """
    import polars as pl

    root = Path(source)
    try:
        info = json.loads((root / "meta" / "info.json").read_text(encoding="utf-8"))
        version, features = str(info["codebase_version"]), info["features"]
        named = features[_STATE]["names"]  # a list, or in older datasets the only one of a mapping
        named = next(iter(named.values())) if isinstance(named, dict) else named
        columns = {str(name).removesuffix(".pos"): k for k, name in enumerate(named)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{root}: meta/info.json is not a LeRobotDataset's: {error!r}") from None
    cameras = [name for name, each in features.items() if each.get("dtype") == "video"]
    found = [name for name in cameras if name.endswith(camera or "")]
    names = tuple(joints or (name for name in columns if name != _SHARE))
    if not version.startswith("v3") or len(found) != 1 or set(names) - set(columns):
        raise LogError(
            f"{root} is a LeRobotDataset {version} of the joints {listed(columns)} and the videos "
            f"{listed(cameras)}: expected v3.0, the joints {listed(names)}, and one video, of "
            "several by its name as `camera`"
        )
    wanted = [_STATE, "timestamp", "episode_index"]
    rows = pl.read_parquet(root / "data" / "**" / "*.parquet", columns=wanted)
    state = np.array(rows[_STATE].to_list(), float)[:, [columns[name] for name in names]]
    time, episode = (rows[name].to_numpy() for name in wanted[1:])
    q, unit = _radians(state)
    taken, moving = _still(q, time, episode)
    frames = defaultdict[Path, list[tuple[float, int]]](list)
    key = f"videos/{found[0]}"
    for one in pl.read_parquet(root / "meta/episodes" / "**" / "*.parquet").iter_rows(named=True):
        place = {part: one[f"{key}/{part}"] for part in ("chunk_index", "file_index")}
        path = root / info["video_path"].format(video_key=found[0], **place)
        begin = float(one[f"{key}/from_timestamp"])
        own = taken[episode[taken] == one["episode_index"]]
        frames[path] += [(begin + float(time[k]), int(k)) for k in own]
    near = 0.5 / float(info["fps"])
    seen = [each for path, asked in frames.items() for each in _frames(path, asked, near)]
    if not seen:
        codec = features[found[0]].get("info", {}).get("video.codec", "unknown")
        raise LogError(
            f"OpenCV reads no frame of {root}'s videos (codec {codec}): convert them, such as by "
            "`ffmpeg -i file-000.mp4 -c:v mpeg4 -q:v 2 new.mp4`"
        )
    notes = [f"joints of {root} are read as {unit}"]
    notes += ["the arm hardly stands still: let it rest at each picture"] * moving
    notes.append(f"{len(seen)} of {len(rows)} frames of {found[0]}, where the arm is slowest")
    kept = [row for row, _ in seen]
    pictures = tuple(f"episode {episode[k]} at {time[k]:.3f} s" for k in kept)
    episodes = episode[kept].astype(np.intp)
    table = JointTable(str(root), names, q[kept], None, pictures, episodes=episodes)
    return table, [grey for _, grey in seen], notes


def _radians(state: Array) -> tuple[Array, str]:
    """Joint values [rad], and what they were: the dataset does not say."""
    most = float(np.abs(state).max())
    if most <= _TURN:
        return state, "radians"
    if _BOUND - 1e-3 <= most <= _BOUND + 1e-3:
        raise LogError(
            "the joints are shares of each motor's range, -100 to 100, and no angles: record with "
            "`--robot.use_degrees=true`"
        )
    return np.radians(state), "degrees (were they shares of each motor's range, nothing would fit)"


def _still(q: Array, time: Array, episode: Array) -> tuple[Index, bool]:
    """Frames (k,) in which the arm is slowest, and whether it moves in most of them."""
    step = np.maximum(np.diff(time, prepend=-np.inf), 1e-3)
    speed = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1) / step
    # a frame is as fast as the way to it and the way from it
    speed = np.maximum(speed, np.append(speed[1:], speed[-1]))
    window = np.floor(time / _WINDOW) + 1e6 * episode
    order = np.lexsort((speed, window))
    slowest = order[np.unique(window[order], return_index=True)[1]]
    moving = bool(np.count_nonzero(speed[slowest] < _STILL) < min(_LEAST, len(slowest)))
    limit = np.sort(speed[slowest])[:_MOST][-1] if moving else _STILL
    kept = list[int]()
    for k in slowest[speed[slowest] <= limit].tolist():
        if not kept or np.abs(q[k] - q[kept[-1]]).max() > _APART:
            kept.append(k)
    return np.array(kept)[thinned(len(kept), _MOST)], moving


def _frames(path: Path, wanted: list[tuple[float, int]], near: float) -> list[tuple[int, Picture]]:
    """Rows and grey frames that stand within `near` [s] of the wanted times; none of no video."""
    left, found = sorted(wanted), []
    with suppress(LogError):
        for stamp, grey in Video(path).frames():
            while left and stamp > left[0][0] + near:
                left.pop(0)
            if not left:
                break
            if abs(stamp - left[0][0]) <= near:
                found.append((left.pop(0)[1], grey))
    return found
