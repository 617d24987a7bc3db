"""A LeRobotDataset v3 folder: frames in which the arm stands nearly still, with their joints.

Layout (huggingface/lerobot, src/lerobot/datasets): `meta/info.json` names features and files,
`data/*.parquet` hold a row for each frame, `meta/episodes/*.parquet` say where each episode begins
in the videos, which hold several.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.wording import listed
from ..errors import LogError
from .opencv import opencv
from .pictures import Video

JOINTS = "joints.csv"
_STATE = "observation.state"
_SHARE = "gripper"  # always a share of its range, and no joint of the arm
_WINDOW = 0.2  # s, of which the slowest frame is taken
_STILL = 0.05  # rad/s; blur and a late frame stay below a pixel
_APART = np.radians(1.0)  # of two rests
_MOST, _LEAST = 80, 12  # frames that are taken, and that are needed although the arm moves
_TURN = 2 * np.pi + 0.1  # values beyond it are no radians
_BOUND = 100.0  # of normalised values, which LeRobot clips there


def is_dataset(path: str | os.PathLike[str]) -> bool:
    """Whether a folder is a LeRobotDataset."""
    return (Path(path) / "meta" / "info.json").is_file()


def unpack(
    source: str | os.PathLike[str], folder: str | os.PathLike[str], camera: str | None = None
) -> list[str]:
    """Write still frames of a dataset as pictures, and their joints as `joints.csv` [rad].

    camera : the feature or the end of its name, such as ``"wrist"``; by default the only one
    Returns notes: what was taken, and in which unit the joints were.
    Raises LogError in one line if the dataset is of another version, or its videos cannot be read.
    """
    import polars as pl

    root = Path(source)
    try:
        info = json.loads((root / "meta" / "info.json").read_text(encoding="utf-8"))
        version, features = str(info["codebase_version"]), info["features"]
        named = features[_STATE]["names"]  # a list, or in older datasets the only one of a mapping
        named = next(iter(named.values())) if isinstance(named, dict) else named
        names = [str(name).removesuffix(".pos") for name in named]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(
            f"{root}: meta/info.json is not that of a LeRobotDataset: {error!r}"
        ) from None
    if not version.startswith("v3"):
        raise LogError(f"{root} is a LeRobotDataset {version}, expected v3.0")
    cameras = [name for name, each in features.items() if each.get("dtype") == "video"]
    found = [name for name in cameras if camera is None or name.endswith(camera)]
    if len(found) != 1:
        raise LogError(f"the dataset has the videos {listed(cameras)}: name one with `camera`")
    key = found[0]
    columns = [_STATE, "timestamp", "episode_index"]
    rows = pl.read_parquet(root / "data" / "**" / "*.parquet", columns=columns)
    state = np.array(rows[_STATE].to_list(), float)
    time, episode = (rows[name].to_numpy() for name in columns[1:])
    arm = [k for k, name in enumerate(names) if name != _SHARE]
    names = [names[k] for k in arm]
    q, unit = _radians(state[:, arm])
    taken, moving = _still(q, time, episode)
    notes = [f"joints of {root} are read as {unit}"]
    notes += ["the arm hardly stands still: let it rest at each picture"] * moving
    episodes = pl.read_parquet(root / "meta" / "episodes" / "**" / "*.parquet")
    wanted: dict[str, list[tuple[float, int]]] = defaultdict(list)
    for one in episodes.iter_rows(named=True):
        place = {part: one[f"videos/{key}/{part}"] for part in ("chunk_index", "file_index")}
        name = info["video_path"].format(video_key=key, **place)
        begin = float(one[f"videos/{key}/from_timestamp"])
        own = taken[episode[taken] == one["episode_index"]]
        wanted[name] += [(begin + float(time[k]), int(k)) for k in own]
    lines = [",".join([*names, "picture", "episode"])]
    for name, frames in wanted.items():
        for row, grey in _frames(root / name, frames, 0.5 / float(info["fps"])):
            picture = f"episode{episode[row]:04d}_{time[row]:08.3f}s.png"
            opencv().imwrite(str(Path(folder) / picture), grey)
            lines.append(",".join([*map(repr, q[row].tolist()), picture, str(episode[row])]))
    if len(lines) == 1:
        codec = features[key].get("info", {}).get("video.codec", "unknown")
        raise LogError(
            f"OpenCV reads no frame of {root}'s videos (codec {codec}): convert them, such as by "
            "`ffmpeg -i file-000.mp4 -c:v mpeg4 -q:v 2 new.mp4`"
        )
    (Path(folder) / JOINTS).write_text("\n".join(lines) + "\n", encoding="utf-8")
    notes.append(f"{len(lines) - 1} of {len(rows)} frames of {key}, where the arm is slowest")
    return notes


def _radians(state: Array) -> tuple[Array, str]:
    """Joint values [rad], and what they were: the dataset does not say.

    LeRobot records degrees (`use_degrees`), or shares of each motor's own range, -100 to 100,
    which its calibration alone turns into angles.
    """
    values = np.abs(state)
    if values.max() <= _TURN:
        return state, "radians"
    if values.max() <= _BOUND + 1e-3 and (values >= _BOUND - 1e-3).any():
        raise LogError(
            "the joints are shares of each motor's range, -100 to 100, and no angles: record with "
            "`--robot.use_degrees=true`"
        )
    return np.radians(state), "degrees (were they shares of each motor's range, nothing would fit)"


def _still(q: Array, time: Array, episode: Array) -> tuple[Array, bool]:
    """Frames (k,) in which the arm is slowest, and whether it moves in most of them."""
    step = np.maximum(np.diff(time, prepend=-np.inf), 1e-3)
    speed = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1) / step
    # a frame is as fast as the way to it and the way from it
    speed = np.maximum(speed, np.append(speed[1:], speed[-1]))
    window = np.floor(time / _WINDOW) + 1e6 * episode
    order = np.lexsort((speed, window))
    slowest = order[np.unique(window[order], return_index=True)[1]]
    still = slowest[speed[slowest] < _STILL]
    moving = len(still) < min(_LEAST, len(slowest))
    if moving:
        still = slowest[np.argsort(speed[slowest])[:_MOST]]
    still = np.sort(still)
    # rests of one place tell no more than one of them
    kept = [still[0]]
    for k in still[1:]:
        if np.abs(q[k] - q[kept[-1]]).max() > _APART:
            kept.append(k)
    every = np.linspace(0, len(kept) - 1, min(len(kept), _MOST)).round().astype(int)
    return np.array(kept)[every], moving


def _frames(path: Path, wanted: list[tuple[float, int]], near: float) -> Any:
    """Yield the rows and grey frames that stand within `near` [s] of the wanted times."""
    left = sorted(wanted)
    if not left:
        return
    try:
        frames = Video(path).frames()
        for stamp, grey in frames:
            while left and stamp > left[0][0] + near:
                left.pop(0)
            if not left:
                return
            if abs(stamp - left[0][0]) <= near:
                yield left.pop(0)[1], grey
    except LogError:
        return
