"""Canvas: what is drawn, in layers, as plain data from which the page makes meshcat's objects.

meshcat's own classes repeat the points of lines and colour them with floats: a 70x70 map would take
five times the room, more than the 3 MB that a page may have.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...common.arrays import Array
from ..error_scale import STOPS, ErrorScale

Colour = NDArray[np.uint8] | str
"""``#rrggbb``, or one for each point, (n, 3)."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """Layers in the order of the legend, and what is drawn in them."""

    size: float  # [m], of what is drawn: balls and dots are shares of it
    layers: list[dict[str, object]] = field(default_factory=list)
    objects: list[dict[str, object]] = field(default_factory=list)
    labels: list[dict[str, object]] = field(default_factory=list)
    # transforms, and those of the animation, by path
    places: dict[str, list[float]] = field(default_factory=dict)
    tracks: dict[str, str] = field(default_factory=dict)

    def layer(
        self, name: str, colour: str, text: str, *, shown: bool = True
    ) -> None:
        """Begin a layer of the legend: what is drawn on paths below its name."""
        layer = {"name": name, "colour": colour, "text": text, "shown": shown}
        self.layers.append(layer)

    def label(self, layer: str, text: str, at: Array) -> None:
        """Write words at a point (3,), shown with a layer."""
        self.labels.append({"layer": layer, "text": text, "at": at.tolist()})

    def add(
        self,
        path: str,
        kind: str,
        colour: Colour,
        points: ArrayLike | None = None,
        index: ArrayLike | None = None,
        *,
        size: float | Sequence[float] = (),
        opacity: float = 1.0,
        order: int = 0,
    ) -> dict[str, object]:
        """Draw something at a path, and return it as the page will read it.

        kind : "lines" between pairs (m, 2) of points, "points", an "image"; a "sphere", a
            "cylinder" along y, or a "marker", a ball that nothing hides
        points : (n, 3)
        size : share of the canvas, width of points, radius of a ball; radius and length
        """
        drawn: dict[str, object] = {
            "path": path,
            "kind": kind,
            "opacity": opacity,
            "size": (self.size * np.asarray(size)).tolist(),
            "order": order,
        }
        if isinstance(colour, str):
            drawn["colour"] = colour
        else:
            drawn["tints"] = packed(colour, np.uint8)
        if points is not None:
            drawn["points"] = packed(points, np.float32)
        if index is not None:
            drawn["index"] = packed(index, np.uint32)
        self.objects.append(drawn)
        return drawn

    def place(self, path: str, transforms: Array) -> None:
        """Place what is below a path by a transform (4, 4), or move it through many."""
        first = transforms if transforms.ndim == 2 else transforms[0]
        self.places[path] = first.T.ravel().tolist()
        if transforms.ndim == 3 and np.ptp(transforms, axis=0).max() > 1e-9:
            self.tracks[path] = packed(transforms.mT, np.float32)

    def data(
        self,
        scale: ErrorScale,
        camera: dict[str, object],
        **words: object,
    ) -> dict[str, object]:
        """Plain data for the page."""
        self.place("Axes", np.diag([*[0.25 * self.size] * 3, 1.0]))
        return {
            **vars(self),
            "ticks": scale.ticks(),
            "stops": STOPS,
            "camera": camera,
            "step": 15,  # frames of the page from one row to the next
            **words,
        }


def packed(values: ArrayLike, kind: type[np.generic]) -> str:
    """Return an array as the page reads it: base64 of its bytes, the lowest first."""
    array = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(array.tobytes()).decode("ascii")
