"""Setup: what stands around an arm and what it carries: camera, board, sockets, sensor frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.rotations import matrix_of
from ..body.sensor_pose import SensorPose
from ..body.spatial import SpatialStructure
from ..body.views import is_camera
from ..common.arrays import Array
from ..errors import CalibError
from ..model.model import Model
from ..recording.board import parse_board
from ..recording.rig import HandEye, Place

SENSOR = "sensor frame"
"""Name of the frame that positions are told in."""

_CAMERA = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
_CAMERA_SIDES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1))
_BOARD = ((0, 1), (1, 2), (2, 3), (3, 0))
_BOARD_SIDES = ((0, 1, 2), (0, 2, 3))
_CROSS = ((0, 3), (1, 4), (2, 5))
_AXES = ((0, 1), (0, 2), (0, 3))


@dataclass(frozen=True, eq=False)
class Thing:
    """Something to draw as lines: points in its own frame, and the frame.

    The frame is that of the root link; of what is carried it is that of the tip.
    """

    name: str
    points: Array  # (n, 3) [m]
    pairs: Sequence[tuple[int, int]]
    frame: Array  # (4, 4)
    carried: bool = False
    faces: Sequence[tuple[int, int, int]] = ()

    @property
    def kind(self) -> str:
        """What it is: the first word of its name."""
        return self.name.partition(" ")[0]

    def placed(self, tip: Array) -> Array:
        """Points (n, 3) in the root link's frame, with the tip at a transform (4, 4)."""
        frame = tip @ self.frame if self.carried else self.frame
        return np.asarray(self.points @ frame[:3, :3].T + frame[:3, 3])


def things_of(model: Model) -> list[Thing]:
    """Return what a model knows of its setup, as its first sensor sees the arm."""
    body = model.body
    sensor = SensorPose.of(body)
    if body is None or sensor is None:
        return []
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - it has a sensor's pose
    size = 0.15 * float(structure.chain.reach)
    frame = transform(sensor.rotation, sensor.position)
    pictures = model.about.options.get("board")
    if isinstance(pictures, Mapping) and "eye" in pictures:
        return _hand_eye(model, structure, pictures, frame, size)
    name = model.about.sensor
    if is_camera(structure.view):
        focal = float(body.beta[structure.groups["lens"]][0])
        picture = model.about.picture or (1280, 720)
        return [
            camera_thing(f"camera {name}".strip(), picture, focal, size, frame)
        ]
    if structure.view == "base":
        return _sockets(model, 0.15 * size)
    axes = np.vstack([np.zeros(3), 0.6 * size * np.eye(3)])
    return [Thing(f"{SENSOR} {name}".strip(), axes, _AXES, frame)]


def _hand_eye(
    model: Model,
    structure: SpatialStructure,
    pictures: Mapping[str, Any],
    frame: Array,
    size: float,
) -> list[Thing]:
    """Camera and board: the one stands still, the other is carried."""
    assert model.body is not None  # noqa: S101 - the caller has looked
    beta = model.body.beta
    bare = beta.copy()
    bare[structure.groups["tool"]] = 0.0
    bare[structure.groups["tool.rotation"]] = 0.0
    base = structure.with_view("base", unit="m", metre=1.0)
    q = np.zeros((1, structure.dof))
    (tool,), (turn,) = base.pose(q, beta)
    (tip,), (flange,) = base.pose(q, bare)
    point = tool - turn @ np.array(pictures["point"])
    carried = transform(flange.T @ turn, flange.T @ (point - tip))
    in_hand = pictures["eye"] == "hand"
    camera_frame, board_frame = (
        (carried, frame) if in_hand else (frame, carried)
    )
    lens = pictures["lens"]
    focal = float(np.mean(lens["focal"]))
    things = [
        camera_thing(
            "camera", lens["size"], focal, size, camera_frame, carried=in_hand
        )
    ]
    try:
        board = parse_board(str(pictures["board"])).points()
    except CalibError:  # tags need OpenCV
        return things
    return [*things, board_thing(board, board_frame, carried=not in_hand)]


def things_of_rig(rig: HandEye) -> list[Thing]:
    """Cameras and the board of a rig; what is carried is in the frame of the flange."""
    reach = float(np.ptp(rig.flange[:, :3, 3], axis=0).max())
    things = []
    for camera in rig.cameras:
        lens = camera.lens
        carried = camera.eye == "hand"
        frame = _frame_of(camera.place)
        name = f"camera {camera.name}" if len(rig.cameras) > 1 else "camera"
        size = lens["size"]
        things.append(
            camera_thing(
                name, size, lens["focal"], 0.3 * reach, frame, carried=carried
            )
        )
    in_hand = rig.eye == "hand"
    frame = _frame_of(rig.base if in_hand else rig.hand)
    board = np.array(rig.board["points"])
    return [*things, board_thing(board, frame, carried=not in_hand)]


def _frame_of(place: Place) -> Array:
    return transform(
        matrix_of(place["quaternion"]), np.array(place["position"])
    )


def camera_thing(
    name: str,
    picture: Sequence[float],
    focal: float,
    size: float,
    frame: Array,
    *,
    carried: bool = False,
) -> Thing:
    """A camera as a frustum with the lens's angle, `size` [m] deep."""
    width, height = (0.5 * size * side / focal for side in picture)
    corners = [
        [-width, -height],
        [width, -height],
        [width, height],
        [-width, height],
    ]
    points = np.vstack([np.zeros(3), [[*corner, size] for corner in corners]])
    return Thing(name, points, _CAMERA, frame, carried, _CAMERA_SIDES)


def board_thing(
    corners: Array, frame: Array, *, carried: bool = False
) -> Thing:
    """A board as the outline of its corners (n, 3) [m]."""
    low = corners.min(axis=0)
    high = corners.max(axis=0)
    sides = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    points = low + sides * (high - low)
    return Thing("board", points, _BOARD, frame, carried, _BOARD_SIDES)


def _sockets(model: Model, size: float, least: int = 3) -> list[Thing]:
    """Sockets with at least so many touches each, as crosses; none where rows are positions."""
    if model.rows is None:
        return []
    places = np.unique(model.rows.x, axis=0)
    if least * len(places) > len(model.rows.x):
        return []
    cross = size * np.vstack([np.eye(3), -np.eye(3)])
    return [
        Thing(f"socket {k + 1}", cross, _CROSS, transform(np.eye(3), place))
        for k, place in enumerate(places)
    ]


def transform(rotation: Array, position: Array) -> Array:
    """Transform (4, 4) of a rotation and a position."""
    frame = np.eye(4)
    frame[:3, :3] = rotation
    frame[:3, 3] = position
    return frame
