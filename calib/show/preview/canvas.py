"""Canvas: what is drawn, in layers, as plain data from which the page makes meshcat's objects.

meshcat's own classes repeat the points of lines and colour them with floats: a 70x70 map would take
five times the room, more than the 3 MB that a page may have.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...common.arrays import Array
from ..robot import Robot

LAYER = "Arm"
_BONE = "#e0853c"
_JOINT = "#59636e"


@dataclass(frozen=True, eq=False)
class Canvas:
    """Layers in the order of the legend, and what is drawn in them."""

    layers: list[dict[str, Any]] = field(default_factory=list)
    objects: list[dict[str, Any]] = field(default_factory=list)
    places: dict[str, list[float]] = field(
        default_factory=dict
    )  # transforms by columns, by path
    tracks: dict[str, str] = field(
        default_factory=dict
    )  # transforms of the animation, by path

    def layer(self, name: str, colour: str, text: str, *, shown: bool = True) -> str:
        """Begin a layer of the legend: what is drawn on paths below its name, which is returned."""
        self.layers.append(
            {"name": name, "colour": colour, "text": text, "shown": shown}
        )
        return name

    def add(
        self,
        path: str,
        kind: str,
        colour: NDArray[np.uint8] | str,
        points: ArrayLike | None = None,
        index: ArrayLike | None = None,
        *,
        size: float | Sequence[float] = (),
        **more: Any,
    ) -> None:
        """Draw something at a path.

        kind : "lines" between pairs (m, 2) of points, "points", an "image" between its corners
            (4, 3), its lower left first; a "surface" of triangles; a "sphere", a "cylinder"
            along y, or a "marker", a ball that nothing hides
        colour : ``#rrggbb``, or one for each point, (n, 3)
        points : (n, 3)
        size : [m], width of points, radius of a ball; radius and length
        """
        drawn = {"path": path, "kind": kind, "opacity": 1.0, "size": size, **more}
        named = isinstance(colour, str)
        drawn["colour" if named else "tints"] = (
            colour if named else packed(colour, np.uint8)
        )
        if points is not None:
            drawn["points"] = packed(points, np.float32)
        if index is not None:
            drawn["index"] = packed(index, np.uint32)
        self.objects.append(drawn)

    def place(self, path: str, transforms: Array) -> None:
        """Put what is below a path where a transform (4, 4) says, or move it through many."""
        first = transforms if transforms.ndim == 2 else transforms[0]
        self.places[path] = first.T.ravel().tolist()
        if transforms.ndim == 3 and np.ptp(transforms, axis=0).max() > 1e-9:
            self.tracks[path] = packed(transforms.swapaxes(1, 2), np.float32)


def packed(values: ArrayLike, kind: type[np.generic]) -> str:
    """Return an array as the page reads it: base64 of its bytes, the lowest first."""
    array = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(array.tobytes()).decode("ascii")


def draw_robot(
    canvas: Canvas, robot: Robot, poses: Mapping[str, Array], size: float
) -> None:
    """Draw links as capsules from joint to joint, moving through poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    radius = 0.02 * size
    for link, following in pairwise(robot.links):
        # in the frame of the link that carries it, so that it moves along
        end = (np.linalg.inv(poses[link][0]) @ poses[following][0])[:3, 3]
        length = float(np.linalg.norm(end))
        canvas.add(f"{LAYER}/{link}/joint", "sphere", _JOINT, size=[1.25 * radius])
        if length > 1e-3 * size:
            bone = np.eye(4)
            bone[:3, :3] = Rotation.align_vectors([end], [[0.0, 1.0, 0.0]])[
                0
            ].as_matrix()
            bone[:3, 3] = end / 2
            path = f"{LAYER}/{link}/bone"
            canvas.add(path, "cylinder", _BONE, size=[radius, length])
            canvas.place(path, bone)
    canvas.add(
        f"{LAYER}/{robot.links[-1]}/joint", "sphere", _JOINT, size=[1.25 * radius]
    )
    for link in robot.links:
        canvas.place(f"{LAYER}/{link}", poses[link])
