"""LeRobot data sets: still frames of a camera, and the joints of those moments.

Their layout is that of huggingface/lerobot, src/lerobot/datasets: `meta/info.json` names the
features and where their files are.  Version 2.1 has a table and a video for each episode, version 3
several episodes in one file.  Frames are taken where the arm rests: a blurred or late one tells
less.  `calibration.json` has for each motor the ends of its range in ticks and its homing offset
(src/lerobot/motors/motors_bus.py): ticks become degrees from the middle of that range, or shares of
it from -100 to 100.
"""

from __future__ import annotations

import json
import math
import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import thinned
from ..common.wording import listed
from ..errors import LogError
from .joint_table import JointTable
from .pictures import Picture, Video

TICKS = 4096
"""Ticks of a Feetech motor in a turn."""

WHOLE_SHARE = 100.0  # what LeRobot calls either end of a motor's range

_STATE = "observation.state"
_GRIPPER = "gripper"  # always a share of its range, and no joint of the arm
_MOST_RADIANS = 2 * np.pi + 0.1  # values beyond it are no radians


@dataclass(frozen=True)
class Rests:
    """When an arm counts as resting.  Slower than 0.05 rad/s blur stays below a pixel."""

    window: float = 0.2  # of which the slowest frame is taken [s]
    speed: float = 0.05  # [rad/s]
    apart: float = float(
        np.radians(1.0)
    )  # two rests of one place tell no more than one [rad]
    most: int = 80  # frames that are taken
    least: int = 12  # frames that are needed, although the arm moves


RESTS = Rests()


@dataclass(frozen=True)
class Dataset:
    """What `meta/info.json` says of a data set."""

    root: Path
    version: str
    columns: Mapping[str, int]  # place of each joint in `observation.state`
    cameras: tuple[str, ...]  # that have videos
    rate: float  # [frames/s]
    video_path: str  # of a video below the root, with names in braces
    chunk: int  # episodes in a folder, of version 2
    robot: str  # its kind, such as so101_follower

    @classmethod
    def read(cls, source: str | os.PathLike[str]) -> Dataset:
        """Read it.  Raises LogError in one line if it is none that is known."""
        root = Path(source)
        try:
            text = (root / "meta" / "info.json").read_text(encoding="utf-8")
            info = json.loads(text)
            features = info["features"]
            names = features[_STATE]["names"]
            if isinstance(names, dict):
                # older ones have a list of names by kind
                names = next(iter(names.values()))
            joints = [str(name).removesuffix(".pos") for name in names]
            dataset = cls(
                root=root,
                version=str(info["codebase_version"]),
                columns={name: k for k, name in enumerate(joints)},
                cameras=tuple(
                    name
                    for name, feature in features.items()
                    if feature["dtype"] == "video"
                ),
                rate=float(info["fps"]),
                video_path=str(info["video_path"]),
                chunk=int(info.get("chunks_size", 1000)),
                robot=str(info.get("robot_type") or ""),
            )
        except (
            OSError,
            ValueError,
            LookupError,
            TypeError,
            AttributeError,
        ) as error:
            raise LogError(
                f"{root}: meta/info.json is not a LeRobotDataset's: {error!r}"
            ) from None
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
            f"{self.root} has the videos {listed(self.cameras)}: expected one, of several by its "
            f"name as `camera`, not {name!r}"
        )

    def joints(self, names: Sequence[str] | None) -> tuple[str, ...]:
        """Return these joints, or all but the gripper.  Raises LogError if one is not there."""
        chosen = tuple(
            names or (name for name in self.columns if name != _GRIPPER)
        )
        missing = [name for name in chosen if name not in self.columns]
        if missing:
            raise LogError(
                f"{self.root} has the joints {listed(self.columns)}: expected {listed(missing)} too"
            )
        return chosen

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


def is_dataset(path: object) -> bool:
    """Whether this is the folder of a LeRobotDataset."""
    return (
        isinstance(path, (str, os.PathLike))
        and (Path(path) / "meta" / "info.json").is_file()
    )


def read_dataset(
    source: str | os.PathLike[str],
    joints: Sequence[str] | None = None,
    camera: str | None = None,
    motors: Motors | None = None,
) -> tuple[JointTable, list[Picture], list[str]]:
    """Read still frames of a data set, and their joints; notes say what was taken.

    joints : their names; all but the gripper where not given
    camera : the feature or the end of its name, such as ``"wrist"``; by default the only one
    motors : the arm's `calibration.json`, which turns shares of the motors' ranges into angles
    Raises LogError in one line if the data set is none that is known, or its videos cannot be read.
    """
    import polars as pl

    dataset = Dataset.read(source)
    chosen = dataset.camera(camera)
    names = dataset.joints(joints)
    wanted = [_STATE, "timestamp", "episode_index"]
    rows = pl.read_parquet(
        dataset.root / "data" / "**" / "*.parquet", columns=wanted
    )
    state = np.array(rows[_STATE].to_list(), float)[
        :, [dataset.columns[name] for name in names]
    ]
    time = rows["timestamp"].to_numpy()
    episode = rows["episode_index"].to_numpy()
    q, unit = _radians(state, names, motors)
    resting, is_moving = _resting(q, time, episode)
    wanted_frames = defaultdict[Path, list[tuple[float, int]]](list)
    places = dataset.videos(chosen, episode)
    for row in resting.tolist():
        path, begin = places[int(episode[row])]
        wanted_frames[path].append((begin + float(time[row]), row))
    frames: list[tuple[int, Picture]] = []
    for path, instants in wanted_frames.items():
        frames += _frames(path, instants, 0.5 / dataset.rate)
    notes = [
        f"joints of {dataset.root} are read as {unit}",
        f"{len(frames)} of {len(rows)} frames of {chosen}, where the arm is slowest",
    ]
    if is_moving:
        notes.append("the arm hardly stands still: let it rest at each picture")
    places_of_rest = [row for row, _ in frames]
    table = JointTable(
        str(dataset.root),
        names,
        q[places_of_rest],
        time=None,
        pictures=tuple(
            f"episode {episode[row]} at {time[row]:.3f} s"
            for row in places_of_rest
        ),
        episodes=episode[places_of_rest].astype(np.intp),
    )
    return table, [picture for _, picture in frames], notes


def _radians(
    state: Array, names: tuple[str, ...], motors: Motors | None
) -> tuple[Array, str]:
    """Return joint values [rad], and what they were: the data set does not say."""
    most = float(np.abs(state).max())
    if most <= _MOST_RADIANS:
        return state, "radians"
    if abs(most - WHOLE_SHARE) > 1e-3:
        return np.radians(state), "degrees"
    if motors is None:
        raise LogError(
            "the joints are shares of each motor's range, -100 to 100, and no angles",
            hint="give the arm's `calibration.json`, or record with `--robot.use_degrees=true`",
        )
    return motors.angles(names, state), "shares of the motors' ranges"


def _resting(q: Array, time: Array, episode: Array) -> tuple[Index, bool]:
    """Return frames (k,) in which the arm rests, and whether it moves in most of them."""
    speed = _speed(q, time)
    # the slowest frame of each window
    window = np.floor(time / RESTS.window) + 1e6 * episode
    order = np.lexsort((speed, window))
    _, first = np.unique(window[order], return_index=True)
    slowest = order[first]
    enough = min(RESTS.least, len(slowest))
    is_moving = np.count_nonzero(speed[slowest] < RESTS.speed) < enough
    limit = RESTS.speed
    if is_moving:
        limit = np.sort(speed[slowest])[: RESTS.most][-1]
    resting: list[int] = []
    for frame in slowest[speed[slowest] <= limit].tolist():
        if not resting or np.abs(q[frame] - q[resting[-1]]).max() > RESTS.apart:
            resting.append(frame)
    some = thinned(len(resting), RESTS.most)
    return np.array(resting)[some], bool(is_moving)


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
    """Return rows and grey frames of a video that stand within `near` [s] of instants.

    instants : times [s] in the video, and the row that each is of
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
class Motor:
    """One motor of `calibration.json`."""

    # [ticks], what the motor takes off its encoder's position
    homing_offset: int
    range_min: int  # [ticks], lower end of its range
    range_max: int  # [ticks]
    drive_mode: int = 0  # 1 turns the sign of shares, not that of degrees

    def angle(self, share: Array) -> Array:
        """Return angles [rad] from the middle of the range for shares of it, -100 to 100."""
        ticks = share / (2 * WHOLE_SHARE) * (self.range_max - self.range_min)
        if self.drive_mode:
            ticks = -ticks
        angle: Array = ticks * math.tau / (TICKS - 1)
        return angle


@dataclass(frozen=True)
class Motors:
    """The motors of an arm, by name, and the document that they stand in."""

    motors: Mapping[str, Motor]
    document: Mapping[str, Mapping[str, object]]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Motors:
        """Read a `calibration.json`.  Raises LogError in one line if the file is none."""
        label = os.fspath(path)
        try:
            document = json.loads(Path(path).read_text(encoding="utf-8"))
            motors = {
                str(name): _motor(entry) for name, entry in document.items()
            }
        except OSError as error:
            raise LogError(f"cannot read {label!r}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
            raise LogError(
                f"{label} is no calibration of LeRobot: expected motors with `homing_offset`, "
                "`range_min` and `range_max`"
            ) from None
        return cls(motors, document)

    def angles(self, names: tuple[str, ...], shares: Array) -> Array:
        """Return joint values (n, k) [rad] for shares (n, k) of these motors' ranges."""
        missing = [name for name in names if name not in self.motors]
        if missing:
            raise LogError(
                f"the calibration has the motors {', '.join(self.motors)}, not {missing[0]}"
            )
        angles = shares.copy()
        for column, name in enumerate(names):
            angles[:, column] = self.motors[name].angle(shares[:, column])
        return angles


def _motor(entry: Mapping[str, int]) -> Motor:
    numbers = {
        key: int(entry[key])
        for key in ("homing_offset", "range_min", "range_max")
    }
    return Motor(**numbers, drive_mode=int(entry.get("drive_mode", 0)))
