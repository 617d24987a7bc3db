"""Setup: what is around an arm and what it carries: camera, board, sensor frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arm.rigid import rigid
from ..body.sensor_pose import SensorPose
from ..body.views import is_camera
from ..common.arrays import Array
from ..model.model import Model
from ..recording.rig import HandEye, frame_of, rig_of_model
from .workspace import extent

SENSOR = "sensor frame"
"""Name of the frame of positions."""

_FRUSTUM = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
_OUTLINE = ((0, 1), (1, 2), (2, 3), (3, 0))
_AXES = ((0, 1), (0, 2), (0, 3))
_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


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

    @property
    def kind(self) -> str:
        """What it is: the first word of its name."""
        return self.name.partition(" ")[0]

    def at_tip(self, tip: Array) -> Array:
        """Points (n, 3) in the root link's frame, with the tip at a transform (4, 4)."""
        frame = tip @ self.frame if self.carried else self.frame
        return self.points @ frame[:3, :3].T + frame[:3, 3]


def things_of(model: Model) -> list[Thing]:
    """Return what a model knows of its setup, as its first sensor sees the arm."""
    rig = rig_of_model(model)
    if rig is not None:
        return things_of_rig(rig)
    body = model.body
    sensor = SensorPose.of(body)
    if body is None or sensor is None:
        return []
    frame = rigid(sensor.rotation, sensor.position)
    structure = body.structure
    name = model.about.sensor
    if is_camera(structure.view):
        focal = float(body.beta[structure.groups["lens"]][0])
        picture = model.about.picture or (1280, 720)
        depth = 0.3 * float(np.linalg.norm(sensor.position))
        return [
            camera_thing(f"camera {name}".strip(), picture, focal, depth, frame)
        ]
    if structure.view == "base":
        return []
    axes = np.vstack([np.zeros(3), 0.1 * extent(model) * np.eye(3)])
    return [Thing(f"{SENSOR} {name}".strip(), axes, _AXES, frame)]


def things_of_rig(rig: HandEye) -> list[Thing]:
    """Cameras and the board of a rig; what is carried is in the frame of the flange."""
    depth = 0.3 * float(np.ptp(rig.flange[:, :3, 3], axis=0).max())
    things = []
    for camera in rig.cameras:
        lens = camera["lens"]
        eye = camera["eye"]
        frame = frame_of(camera[eye])
        name = "camera"
        if len(rig.cameras) > 1:
            name = f"camera {camera['name']}"
        carried = eye == "hand"
        things.append(
            camera_thing(
                name, lens["size"], lens["focal"], depth, frame, carried=carried
            )
        )
    in_hand = rig.eye == "hand"
    corners = np.array(rig.board["points"])
    low = corners.min(axis=0)
    sides = np.column_stack([_SQUARE, np.zeros(4)])
    outline = low + sides * (corners.max(axis=0) - low)
    frame = frame_of(rig.base if in_hand else rig.hand)
    return [*things, Thing("board", outline, _OUTLINE, frame, not in_hand)]


def camera_thing(
    name: str,
    picture: Sequence[float],
    focal: float,
    depth: float,
    frame: Array,
    *,
    carried: bool = False,
) -> Thing:
    """A camera as a frustum with the lens's angle, so deep [m]."""
    corners = (_SQUARE - 0.5) * np.array(picture) * depth / focal
    points = np.vstack(
        [np.zeros(3), np.column_stack([corners, np.full(4, depth)])]
    )
    return Thing(name, points, _FRUSTUM, frame, carried)
