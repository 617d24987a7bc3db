"""LeRobot data sets: still frames of a camera, and the joints of those moments.

Their layout is that of huggingface/lerobot, src/lerobot/datasets: `meta/info.json` names the
features and their files.  Version 2.1 has a table and a video for each episode, version 3 several
episodes in one file.  Frames are taken where the arm rests, since blurred or late ones are less
accurate.  `calibration.json` has for each motor the ends of its range in ticks and its homing
offset (src/lerobot/motors/motors_bus.py): ticks become degrees from the middle of that range, or
shares of it from -100 to 100.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Index
from ..common.atomic import FilePath
from ..common.rows import finite_rows, spread_rows
from ..common.wording import listing
from ..errors import LogError
from .motion_tables import JointTable
from .pictures import Picture, Video

TICKS = 4096
"""Ticks of a Feetech motor in a turn."""

WHOLE_SHARE = 100.0  # LeRobot's number for either end of a motor's range

_STATE = "observation.state"
_GRIPPER = "gripper"  # always a share of its range, and no joint of the arm
_MOST_RADIANS = 2 * np.pi + 0.1  # larger values are no radians


@dataclass(frozen=True)
class LeRobotRestSettings:
    """When an arm rests."""

    window: float = 0.2  # [s], of each window the slowest frame is taken
    speed: float = 0.05  # [rad/s], below which blur is less than a pixel
    distance: float = math.radians(1.0)  # least one between two rests [rad]
    most: int = 80  # frames that are taken
    least: int = 12  # frames, below which the arm hardly rests


LEROBOT_REST = LeRobotRestSettings()


@dataclass(frozen=True)
class Dataset:
    """The contents of a data set's `meta/info.json`."""

    root: Path
    version: str
    columns: tuple[str, ...]  # joints, as `observation.state` has them
    cameras: tuple[str, ...]  # that have videos
    rate: float  # [frames/s]
    video_path: str  # of a video below the root, with names in braces
    chunk: int  # episodes in a folder, of version 2
    robot: str  # its kind, such as so101_follower

    @classmethod
    def read(cls, source: FilePath) -> Dataset:
        """Read a data set.  Raises LogError in one line if it is none of a known version."""
        root = Path(source)
        path = root / "meta" / "info.json"
        with _one_line(path):
            info = json.loads(path.read_text(encoding="utf-8"))
            features = info["features"]
            names = features[_STATE]["names"]
            if isinstance(names, dict):
                # older ones have a list of names by kind
                names = next(iter(names.values()))
            kinds = {name: each["dtype"] for name, each in features.items()}
            dataset = cls(
                root=root,
                version=str(info["codebase_version"]),
                columns=tuple(str(n).removesuffix(".pos") for n in names),
                cameras=tuple(n for n in kinds if kinds[n] == "video"),
                rate=float(info["fps"]),
                video_path=str(info["video_path"]),
                chunk=int(info.get("chunks_size", 1000)),
                robot=str(info.get("robot_type") or ""),
            )
        if not dataset.version.startswith(("v2", "v3")):
            raise LogError(
                f"{root} is a LeRobotDataset {dataset.version}: expected v2.0, v2.1 or v3.0"
            )
        return dataset

    def camera(self, name: str | None) -> str:
        """Return the only camera, or the one whose name ends so.  Raises LogError otherwise."""
        fitting = [
            camera for camera in self.cameras if camera.endswith(name or "")
        ]
        if len(fitting) == 1:
            return fitting[0]
        raise LogError(
            f"{self.root} has the videos {listing(self.cameras)}: expected one, of several by its "
            f"name as `camera`, not {name!r}"
        )

    def joints(self, names: Sequence[str] | None) -> tuple[str, ...]:
        """Return these joints, or all but the gripper.  Raises LogError if one is not there."""
        if names is None:
            names = [name for name in self.columns if name != _GRIPPER]
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise LogError(
                f"{self.root} has the joints {listing(self.columns)}: expected "
                f"{listing(missing)} too"
            )
        return tuple(names)

    def rows(self) -> tuple[Array, Array, Index]:
        """Return numbers (n, columns), times (n,) [s] and episodes (n,) of rows that have all."""
        import polars as pl

        columns = [_STATE, "timestamp", "episode_index"]
        files = self.root / "data" / "**" / "*.parquet"
        table = pl.read_parquet(files, columns=columns).drop_nulls()
        table = table.sort(columns[2], columns[1])
        state = np.array(table[_STATE].to_list(), float)
        state = state.reshape(len(table), len(self.columns))
        good = finite_rows(state)
        time = table["timestamp"].to_numpy().astype(float)
        episodes = table["episode_index"].to_numpy().astype(np.intp)
        return state[good], time[good], episodes[good]

    def videos(
        self, camera: str, episodes: Index
    ) -> dict[int, tuple[Path, float]]:
        """Return the video of each episode, and where in it the episode begins [s]."""
        import polars as pl

        places: dict[int, tuple[Path, float]] = {}
        if self.version.startswith("v2"):
            for episode in np.unique(episodes).tolist():
                path = self.video_path.format(
                    video_key=camera,
                    episode_chunk=episode // self.chunk,
                    episode_index=episode,
                )
                places[episode] = (self.root / path, 0.0)
            return places
        key = f"videos/{camera}"
        files = self.root / "meta" / "episodes" / "**" / "*.parquet"
        for row in pl.read_parquet(files).iter_rows(named=True):
            path = self.video_path.format(
                video_key=camera,
                chunk_index=row[f"{key}/chunk_index"],
                file_index=row[f"{key}/file_index"],
            )
            begin = float(row[f"{key}/from_timestamp"])
            places[int(row["episode_index"])] = (self.root / path, begin)
        return places


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn errors of files that LeRobot did not write into a LogError of one line."""
    import polars as pl

    try:
        yield
    except (
        pl.exceptions.PolarsError,
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        ZeroDivisionError,
    ) as error:
        words = repr(error).partition("\\n")[0]
        raise LogError(f"{path} is not a LeRobotDataset's: {words}") from None


def is_dataset(path: object) -> bool:
    """Whether this is the folder of a LeRobotDataset."""
    return (
        isinstance(path, (str, os.PathLike))
        and (Path(path) / "meta" / "info.json").is_file()
    )


def read_dataset(
    source: FilePath,
    joints: Sequence[str] | None = None,
    camera: str | None = None,
    motors: Motors | None = None,
) -> tuple[dict[str, JointTable], list[Picture], list[str]]:
    """Read still frames of a data set, and their joints, with notes.

    A data set does not state its units: joints are returned by each unit that they may be in.

    joints : their names; all but the gripper where not given
    camera : the feature or the end of its name, such as ``"wrist"``; by default the only one
    motors : the arm's `calibration.json`, which turns shares of the motors' ranges into angles
    Raises LogError in one line if the data set is none that is known, or its videos cannot be read.
    """
    dataset = Dataset.read(source)
    chosen = dataset.camera(camera)
    names = dataset.joints(joints)
    with _one_line(dataset.root):
        state, time, episode = dataset.rows()
        places = dataset.videos(chosen, episode)
        paths = [places[number] for number in episode.tolist()]
        near = 0.5 / dataset.rate
    state = state[:, [dataset.columns.index(name) for name in names]]
    angles = _angles(state, names, motors)
    first = next(iter(angles.values()))
    resting = _resting(first, time, episode)
    # when each video shows a row
    instants: dict[Path, list[tuple[float, int]]] = {}
    for row in resting.tolist():
        path, begin = paths[row]
        instants.setdefault(path, []).append((begin + float(time[row]), row))
    frames: list[tuple[int, Picture]] = []
    for path, rows_at in instants.items():
        frames += _frames(path, rows_at, near)
    notes = [
        f"{len(frames)} of {len(state)} frames of {chosen}, where the arm is slowest"
    ]
    if len(frames) < LEROBOT_REST.least:
        notes.append("the arm hardly stands still: let it rest at each picture")
    rows = [row for row, _ in frames]
    labels = [f"episode {episode[k]} at {time[k]:.3f} s" for k in rows]
    label = str(dataset.root)
    table = JointTable(
        label,
        names,
        first[rows],
        pictures=labels,
        episodes=episode[rows].astype(float),
    )
    tables = {unit: replace(table, q=q[rows]) for unit, q in angles.items()}
    return tables, [picture for _, picture in frames], notes


def _angles(
    state: Array, names: tuple[str, ...], motors: Motors | None
) -> dict[str, Array]:
    """Return joint values (n, k) [rad] by each unit that numbers (n, k) may be in."""
    most = float(np.abs(state).max(initial=0.0))
    if most <= _MOST_RADIANS:
        return {"radians": state}
    angles = {"degrees": np.radians(state)}
    if most > WHOLE_SHARE + 1e-3:
        return angles
    is_whole = most > WHOLE_SHARE - 1e-3
    if motors is not None:
        shares = motors.angles(names, state)
        if is_whole:
            angles.clear()
        angles["shares of the motors' ranges"] = shares
    elif is_whole:
        raise LogError(
            "the joints are shares of each motor's range, -100 to 100, and no angles",
            hint="give the arm's `calibration.json`, or record with `--robot.use_degrees=true`",
        )
    return angles


def _resting(q: Array, time: Array, episode: Index) -> Index:
    """Return frames (k,) in which the arm rests."""
    speed = _speed(q, time)
    # the slowest frame of each window
    window = np.floor(time / LEROBOT_REST.window) + 1e6 * episode
    order = np.lexsort((speed, window))
    _, first = np.unique(window[order], return_index=True)
    slowest = order[first]
    resting: list[int] = []
    for frame in slowest[speed[slowest] < LEROBOT_REST.speed].tolist():
        if (
            not resting
            or np.abs(q[frame] - q[resting[-1]]).max() > LEROBOT_REST.distance
        ):
            resting.append(frame)
    some = spread_rows(len(resting), LEROBOT_REST.most)
    return np.array(resting, np.intp)[some]


def _speed(q: Array, time: Array) -> Array:
    """Speed (n,) [rad/s] of the fastest joint on the way to each frame, or from it."""
    seconds = np.diff(time, prepend=-np.inf)
    way = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1)
    before = way / np.maximum(seconds, 1e-3)
    after = np.append(before[1:], before[-1])
    return np.asarray(np.maximum(before, after))


def _frames(
    path: Path, instants: list[tuple[float, int]], near: float
) -> list[tuple[int, Picture]]:
    """Return rows and grey frames of a video that are within `near` [s] of instants.

    instants : times [s] in the video, and the row of each
    """
    waiting = sorted(instants)
    frames: list[tuple[int, Picture]] = []
    for stamp, picture in Video(path).frames():
        while waiting and stamp > waiting[0][0] + near:
            waiting.pop(0)
        if not waiting:
            break
        if abs(stamp - waiting[0][0]) <= near:
            frames.append((waiting.pop(0)[1], picture))
    return frames


@dataclass(frozen=True)
class Motors:
    """The entries of `calibration.json` for each motor of an arm, by name."""

    document: Mapping[str, Mapping[str, int]]

    @classmethod
    def read(cls, path: FilePath) -> Motors:
        """Read a `calibration.json`.  Raises LogError in one line if the file is none."""
        label = os.fspath(path)
        try:
            motors = cls(json.loads(Path(path).read_text(encoding="utf-8")))
            # reads the ranges
            motors.angles(tuple(motors.document), np.zeros(1))
            for entry in motors.document.values():
                int(entry["homing_offset"])
        except OSError as error:
            raise LogError(f"cannot read {label!r}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            raise LogError(
                f"{label} is no calibration of LeRobot: expected motors with `homing_offset`, "
                "`range_min` and `range_max`"
            ) from None
        return motors

    def angles(self, names: tuple[str, ...], shares: Array) -> Array:
        """Return joint values (n, k) [rad] for shares (n, k) of these motors' ranges."""
        turn = math.tau / (TICKS - 1)
        scales = []
        for name in names:
            if name not in self.document:
                raise LogError(
                    f"the calibration has the motors {', '.join(self.document)}, not {name}"
                )
            entry = self.document[name]
            ticks = int(entry["range_max"]) - int(entry["range_min"])
            # 1 turns the sign of shares, not that of degrees
            sign = -1 if entry.get("drive_mode") else 1
            scales.append(sign * ticks * turn / (2 * WHOLE_SHARE))
        return shares * scales
