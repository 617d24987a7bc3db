"""Setup: what stands around an arm and what it carries: camera, board, sockets, sensor frame."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.sensor_pose import SensorPose
from ..body.views import is_camera
from ..common.arrays import Array
from ..model.model import Model

SENSOR = "sensor frame"
"""Name of the frame that positions are told in."""

_BOARD = re.compile(r"(\d+)x(\d+):([\d.]+)(mm|cm|m)\b")
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_FEW_SOCKETS = 3  # rows for each place, at least: then the places are sockets
_CAMERA = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
_RING = ((0, 1), (1, 2), (2, 3), (3, 0))
_SIDES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1))
_FACE = ((0, 1, 2), (0, 2, 3))
_FRAME = ((0, 1), (0, 2), (0, 3))


@dataclass(frozen=True, eq=False)
class Thing:
    """Something to draw as lines: points in its own frame, and the frame.

    The frame is that of the root link; of what is carried it is that of the tip.
    """

    name: str
    points: Array  # (n, 3) [m]
    pairs: tuple[tuple[int, int], ...]
    frame: Array  # (4, 4)
    carried: bool = False
    faces: tuple[tuple[int, int, int], ...] = ()


def things_of(model: Model) -> list[Thing]:
    """Return what a model knows of its setup."""
    sensor = SensorPose.of(model.body)
    if model.body is None or sensor is None:
        return []
    structure: Any = model.body.structure
    size = 0.15 * float(structure.chain.reach)
    frame = _frame(sensor.rotation, sensor.position)
    source = model.about.options.get("board")
    if isinstance(source, Mapping) and "eye" in source:
        return _hand_eye(model, source, frame, size)
    if is_camera(structure.view):
        focal = float(model.body.beta[structure.groups["lens"]][0])
        picture = model.about.picture or (1280, 720)
        return [_camera("camera", picture, focal, size, frame)]
    if structure.view == "base":
        return _sockets(model, 0.15 * size)
    axes = np.vstack([np.zeros(3), 0.6 * size * np.eye(3)])
    return [Thing(SENSOR, axes, _FRAME, frame)]


def _hand_eye(
    model: Model, source: Mapping[str, Any], frame: Array, size: float
) -> list[Thing]:
    """Camera and board: the one stands still, the other is carried."""
    body: Any = model.body
    structure = body.structure
    bare = body.beta.copy()
    bare[structure.groups["tool"]] = 0.0
    bare[structure.groups["tool.rotation"]] = 0.0
    base = structure.with_view("base", unit="m", metre=1.0)
    q = np.zeros((1, structure.dof))
    (tool,), (turn,) = base.pose(q, body.beta)
    (tip,), (flange,) = base.pose(q, bare)
    carried = _frame(
        flange.T @ turn, flange.T @ (tool - turn @ np.array(source["point"]) - tip)
    )
    in_hand = source["eye"] == "hand"
    lens = source["lens"]
    camera_frame = carried if in_hand else frame
    focal = float(np.mean(lens["focal"]))
    camera = _camera("camera", lens["size"], focal, size, camera_frame, carried=in_hand)
    board = _board(
        str(source["board"]), frame if in_hand else carried, carried=not in_hand
    )
    return [camera] if board is None else [camera, board]


def _camera(
    name: str,
    picture: Any,
    focal: float,
    size: float,
    frame: Array,
    *,
    carried: bool = False,
) -> Thing:
    """A camera as a frustum with the lens's angle, `size` [m] deep."""
    width, height = (0.5 * size * float(side) / focal for side in picture)
    corners = [[-width, -height, size], [width, -height, size], [width, height, size]]
    points = np.array([[0.0, 0.0, 0.0], *corners, [-width, height, size]])
    return Thing(name, points, _CAMERA, frame, carried, _SIDES)


def _board(words: str, frame: Array, *, carried: bool) -> Thing | None:
    """A board such as "7x5:24mm:..." as its outline."""
    match = _BOARD.match(words)
    if match is None:
        return None
    square = float(match[3]) * _UNITS[match[4]]
    width = int(match[1]) * square
    height = int(match[2]) * square
    points = np.array(
        [[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]], dtype=float
    )
    return Thing("board", points, _RING, frame, carried, _FACE)


def _sockets(model: Model, size: float) -> list[Thing]:
    """Sockets that were touched, as crosses; none where rows are positions."""
    if model.rows is None:
        return []
    places = np.unique(model.rows.x, axis=0)
    if _FEW_SOCKETS * len(places) > len(model.rows.x):
        return []
    cross = size * np.vstack([np.eye(3), -np.eye(3)])
    pairs = ((0, 3), (1, 4), (2, 5))
    turn = np.eye(3)
    return [
        Thing(f"socket {k + 1}", cross, pairs, _frame(turn, place))
        for k, place in enumerate(places)
    ]


def _frame(rotation: Array, position: Array) -> Array:
    """Transform (4, 4) of a rotation and a position."""
    frame = np.eye(4)
    frame[:3, :3] = rotation
    frame[:3, 3] = position
    return frame
