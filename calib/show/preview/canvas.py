"""Canvas: what is drawn, in layers, as plain data from which the page makes meshcat's objects.

meshcat's own classes repeat the points of lines and colour them with floats: a 70x70 map would take
five times the room, more than the 3 MB that a page may have.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...common.arrays import Array


class Canvas:
    """Layers in the order of the legend, and what is drawn in them."""

    def __init__(self) -> None:
        self.layers: list[dict[str, Any]] = []
        self.objects: list[dict[str, Any]] = []
        self.places: dict[str, list[float]] = {}  # transforms by columns, by path
        self.tracks: dict[str, str] = {}  # transforms of the animation, by path

    def layer(self, name: str, colour: str, text: str, *, shown: bool = True) -> str:
        """Begin a layer of the legend: what is drawn on paths below its name, which is returned."""
        self.layers.append({"name": name, "colour": colour, "text": text, "shown": shown})
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
        opacity: float = 1.0,
        **more: Any,
    ) -> None:
        """Draw something at a path.

        kind : "lines" between pairs (m, 2) of points, "points", a "mesh" of triangles (m, 3), an
            "image" between its corners (4, 3), its lower left first; or a "box", "sphere" or
            "cylinder", sized as in a URDF, the last along y; or a "marker", a ball that nothing
            hides
        colour : ``#rrggbb``, or one for each point, (n, 3)
        points : (n, 3)
        size : [m], width of points, radius of a marker; sides of a box, radius and length
        """
        drawn = {"path": path, "kind": kind, "opacity": opacity, "size": size, **more}
        drawn["colour" if isinstance(colour, str) else "tints"] = (
            colour if isinstance(colour, str) else packed(colour, np.uint8)
        )
        if points is not None:
            drawn["points"] = packed(points, np.float32)
        if index is not None:
            drawn["index"] = packed(index, np.uint32)
        self.objects.append(drawn)

    def place(self, path: str, transform: Array) -> None:
        """Put everything below a path where a transform (4, 4) says."""
        self.places[path] = transform.T.ravel().tolist()

    def animate(self, tracks: Mapping[str, Array]) -> None:
        """Move what is at each path through transforms (frames, 4, 4)."""
        self.tracks = {p: packed(t.swapaxes(1, 2), np.float32) for p, t in tracks.items()}

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page."""
        names = ("layers", "objects", "places", "tracks")
        return {name: getattr(self, name) for name in names}


def packed(values: ArrayLike, kind: type[np.generic]) -> str:
    """Return an array as the page reads it: base64 of its bytes, the lowest first."""
    array = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(array.tobytes()).decode("ascii")
