"""Rig: where cameras and boards are, with intervals, as JSON, lines for people, and files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from ..arm.rigid import rigid
from ..arm.rotations import logarithm, matrix_of
from ..body.sensor_pose import SensorPose, hand_pose
from ..body.structure import OfStructure
from ..common.arrays import Array
from ..common.atomic import FilePath, atomic_write
from ..common.choices import Eye
from ..common.wording import by_name, two_digits
from ..errors import ModelError
from ..model.model import Model
from ..model_file.container import check_sum, pack, unpack
from ..samples.samples import Samples
from .readings import Convention

KIND = "rig"
UNWRITTEN = ("poses", "body")
ARRAYS = ("flange", "misses", "covariance")
FILED = (*ARRAYS, "names", "frames")
"""Fields that are in files, but not in the JSON for people."""

Place = dict[str, list[float]]
"""A place as JSON: position [m], quaternion, and half-widths of 95 % intervals [m, rad]."""


class LensFacts(TypedDict):
    """A lens as JSON, with half-widths of 95 % intervals."""

    focal: float  # [px]
    centre: list[float]
    focal_95: float
    known: bool
    matrix: list[list[float]]
    distortion: list[float]  # k1, k2, p1, p2, k3
    size: list[int]


class Square(TypedDict):
    """The side of a square, or a tag, as stated and as measured [m]."""

    said: float  # stated by the user
    measured: float
    interval: list[float]


class CameraPlace(TypedDict, total=False):
    """One of several cameras as JSON: its place under "hand" or "base", by its eye."""

    name: str
    eye: Eye
    hand: Place
    base: Place
    lens: LensFacts
    from_first: Place  # in the frame of the first camera of its eye


@dataclass(frozen=True, eq=False)
class HandEye:
    """A rig: the poses of cameras and a board.

    Places are of the camera's optical frame (x right, y down, z ahead) or the board's: position
    [m], quaternion (qx, qy, qz, qw) and half-widths of their 95 % intervals, (3,) [m] and
    (3,) [rad], with and without the part that no picture determines (`up_to_gauge`).
    """

    eye: str  # "hand": the first camera is in the hand and the board is at rest; or "base"
    pictures: int
    used: int  # of the first camera's, those that the fit rests on
    hand: Place  # what is in the hand, in the tip's or the flange's frame
    base: Place  # what is at rest, in the base's
    # mean and largest distance of corners [px]
    reprojection: dict[str, float]
    lens: LensFacts  # of the first camera
    limited_by: str  # what limits the accuracy, and what would help most
    notes: tuple[str, ...]
    # sd of the arm's poses: position [m], rotation [rad]
    repeatability: dict[str, float]
    square: Square
    # its text, and its corners as fitted, in its frame [m]
    board: dict[str, object]
    # rms of pictures predicted by others [px]
    held_out: dict[str, float]
    left_out: tuple[str, ...]  # names of pictures
    cameras: tuple[CameraPlace, ...]
    convention: Convention | None  # what the poses mean
    frames: tuple[str, str]  # names of the arm's base and of what carries
    names: tuple[str, ...]  # (n,), of the motions' pictures
    flange: Array  # (n, 4, 4), what carries in the base at each motion [m]
    misses: Array  # (n,) [px], rms error of the corners at each motion by a fit without it
    # (12, 12), of turn and shift of the hand's and the base's frame
    covariance: Array
    # of joints: the pictures as `calib log --eye` writes
    poses: Samples | None = None
    body: OfStructure | None = None

    def __repr__(self) -> str:
        """Summarise in two lines how good the calibration is, and what limits it."""
        return (
            f"HandEye of {self.used} of {self.pictures} pictures, {self.hand_item} in the hand, "
            f"corners {self.reprojection['mean']:.3g} px off on average\n  {self.limited_by}"
        )

    @property
    def hand_item(self) -> str:
        """What is in the hand."""
        return "camera" if self.eye == "hand" else "board"

    @property
    def base_item(self) -> str:
        """What is at rest."""
        return "board" if self.eye == "hand" else "camera"

    @property
    def eye_is_doubtful(self) -> bool:
        """Whether only inverse poses fit, and then with the hand's distance above the base's."""
        is_inverse = self.convention is not None and self.convention["inverse"]
        hand, base = self.distances
        return is_inverse and hand > base

    @property
    def distances(self) -> tuple[float, float]:
        """Distance [m] of what is in the hand from the flange, then of the other from the base."""
        hand = math.hypot(*self.hand["position"])
        return hand, math.hypot(*self.base["position"])

    @property
    def eye_doubt(self) -> str:
        """Why the eye is doubtful, for people."""
        hand, base = map(two_digits, self.distances)
        return (
            f"`eye={self.eye!r}` is doubtful: with it the {self.hand_item} is {hand} m from the "
            f"flange, and the {self.base_item} {base} m from the base; poses alone fit both eyes: "
            "try the other"
        )

    @property
    def repeats(self) -> str:
        """The arm's repeatability for people."""
        shift = 1e3 * self.repeatability["position"]
        turn = np.degrees(self.repeatability["rotation"])
        words = "less than 0.001"
        if turn > 1e-3:
            words = two_digits(turn)
        return f"{two_digits(shift)} mm and {words} deg"

    def document(self) -> dict[str, object]:
        """All fields but the log and the body, as plain values."""
        document = vars(self) | {
            name: getattr(self, name).tolist() for name in ARRAYS
        }
        for name in UNWRITTEN:
            del document[name]
        return document

    def to_json(self) -> dict[str, object]:
        """What `calib handeye --json` prints."""
        document = self.document()
        for name in FILED:
            del document[name]
        if self.convention is None:
            del document["convention"]
        return document

    def save(self, path: FilePath) -> None:
        """Write all but the log into one file: the same rig gives the same bytes."""
        header = {"kind": KIND, "format": 1, KIND: self.document()}
        atomic_write(path, pack(header, {}))

    def places(self) -> dict[str, tuple[str, Place]]:
        """Cameras and board by their names, each with its parent frame."""
        base, tip = self.frames
        places = {
            self.hand_item: (tip, self.hand),
            self.base_item: (base, self.base),
        }
        if len(self.cameras) == 1:
            return places
        del places["camera"]
        for camera in self.cameras:
            eye = camera["eye"]
            parent = tip if eye == "hand" else base
            places[camera["name"]] = (parent, camera[eye])
        return places

    def lines(self) -> list[str]:
        """The answer for people."""
        lines = [
            _line(f"{name} in the frame of {parent}", place)
            for name, (parent, place) in self.places().items()
        ]
        for camera in self.cameras:
            if "from_first" in camera:
                words = f"{camera['name']} in the first camera's frame"
                lines.append(_line(words, camera["from_first"]))
        mean, largest = map(two_digits, self.reprojection.values())
        return [
            *lines,
            "pictures that the fit did not see are predicted to "
            f"{two_digits(self.held_out['rms'])} px; corners to {mean} px (largest {largest}); "
            f"{self.used} of {self.pictures} pictures",
            f"this arm repeats to {self.repeats}",
            f"lens: focal length {self.lens['focal']:.1f} ± {two_digits(self.lens['focal_95'])} px",
            f"limited by {self.limited_by}",
        ]


def frame_of(place: Place) -> Array:
    """A place as a matrix (4, 4)."""
    return rigid(matrix_of(place["quaternion"]), place["position"])


def _line(what: str, place: Place) -> str:
    """A place for people."""
    halves = place["position_95_up_to_gauge"]
    pairs = zip(place["position"], halves, strict=True)
    at = ", ".join(
        f"{1e3 * value:.2f} ± {two_digits(1e3 * half)}" for value, half in pairs
    )
    quaternion = ", ".join(f"{value:.5f}" for value in place["quaternion"])
    turn = np.degrees(max(place["rotation_95_up_to_gauge"]))
    return (
        f"{what}: ({at}) mm, quaternion ({quaternion}) ± {two_digits(turn)} deg"
    )


def rig_of(document: Mapping[str, Any]) -> HandEye:
    """The rig of a `HandEye.document`.

    Raises KeyError, TypeError, ValueError if it is none.
    """
    values = dict(document)
    for name in ARRAYS:
        values[name] = np.array(document[name], float)
    for name in ("notes", "left_out", "names", "frames", "cameras"):
        values[name] = tuple(document[name])
    return HandEye(**values)


def is_rig(path: FilePath) -> bool:
    """Whether a file is a rig."""
    try:
        header, _ = unpack(Path(path).read_bytes(), str(path))
    except (OSError, ModelError):
        return False
    return header.get("kind") == KIND


def load_rig(path: FilePath) -> HandEye:
    """Read a rig from its file.

    Raises ModelError if the file is missing, damaged, edited or no rig.
    """
    name = str(path)
    try:
        header, tensors = unpack(Path(path).read_bytes(), name)
        check_sum(header, tensors, name)
        document: Any = header[KIND]
        return rig_of(document)
    except (OSError, LookupError, TypeError, ValueError) as error:
        raise ModelError(
            f"{name}: no rig: expected what calib handeye -o writes ({error})"
        ) from error


def rig_of_model(model: Model) -> HandEye | None:
    """The rig that a model was learned from; None of others."""
    board: Any = model.about.board
    try:
        return rig_of(board[KIND])
    except (LookupError, TypeError, ValueError):
        return None


def frames_of_model(model: Model) -> Array | None:
    """Frames (2, 4, 4) [m] of a model of pictures of a board; None of others.

    The first is what is in the hand, in the tip's frame; the second what is at rest, in the base's.
    """
    body = model.body
    board: Any = model.about.board
    sensor = SensorPose.of(body)
    if not board or body is None or sensor is None:
        return None
    # the body's tool is the point of the hand that logs measure
    mount = hand_pose(body)
    shift = mount.position - mount.rotation @ board["point"]
    return rigid(
        np.stack([mount.rotation, sensor.rotation]),
        np.stack([shift, sensor.position]),
    )


def transform_files(rig: HandEye, path: FilePath) -> dict[Path, str]:
    """The text of each file: transforms in JSON, and lines and matrices for people."""
    transforms = []
    lines: list[str] = []
    for name, (parent, place) in rig.places().items():
        child = f"{name}_frame"
        numbers = (place["position"], place["quaternion"])
        transforms.append(stamped(parent, child, *numbers))
        lines += _lines(parent, child, place)
    return {
        Path(path): json.dumps(transforms, indent=2) + "\n",
        Path(path).with_suffix(".txt"): "\n".join(lines) + "\n",
    }


def stamped(
    parent: str, child: str, position: list[float], quaternion: list[float]
) -> dict[str, object]:
    """A frame in its parent as a geometry_msgs/TransformStamped."""
    return {
        "header": {"frame_id": parent},
        "child_frame_id": child,
        "transform": {
            "translation": by_name("xyz", position),
            "rotation": by_name("xyzw", quaternion),
        },
    }


def _lines(parent: str, child: str, place: Place) -> list[str]:
    frame = frame_of(place)
    numbers = zip(
        ("x", "y", "z", "qx", "qy", "qz", "qw"),
        place["position"] + place["quaternion"],
        strict=True,
    )
    options = " ".join(f"--{name} {value!r}" for name, value in numbers)
    return [
        f"# {child} in {parent}",
        f"ros2 run tf2_ros static_transform_publisher {options} --frame-id {parent} "
        f"--child-frame-id {child}",
        *(" ".join(f"{cell: .9f}" for cell in row) for row in frame),
        f"rvec {logarithm(frame[:3, :3]).tolist()}",
        f"tvec {place['position']}",
        "",
    ]
