"""Canvas: layers of a drawing as a recording of meshcat commands, packed for its viewer.

No server takes part. Objects get numbers for names, so that the same scene gives the same
bytes. Colours are bytes and lines share their nodes, which makes a scene of a 70x70 map
five times smaller than the float colours and separate pieces of meshcat's own classes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arm.rotations import quaternion_of
from ...common.arrays import Array
from .placement import FIELD_OF_VIEW

POINT = 1.0 / math.tan(math.radians(FIELD_OF_VIEW) / 2)
"""Size of a dot in three.js, which forgets the field of view, over its true size."""

_KINDS = {
    "uint8": ("Uint8Array", 0x12),
    "uint16": ("Uint16Array", 0x14),
    "uint32": ("Uint32Array", 0x16),
    "float32": ("Float32Array", 0x17),
}


class Canvas:
    """Layers in the order of the legend, and meshcat commands in the order of drawing."""

    def __init__(self) -> None:
        self.layers: list[dict[str, Any]] = []
        self._commands: list[dict[str, Any]] = []
        self._count = 0

    def layer(self, name: str, colour: str, text: str, *, shown: bool = True) -> str:
        """Begin a layer of the legend: what is drawn on paths below its name, which is returned."""
        self.layers.append({"name": name, "colour": colour, "text": text, "shown": shown})
        if not shown:
            self.set(name, "visible", False)
        return name

    def lines(
        self,
        path: str,
        points: ArrayLike,
        pairs: ArrayLike,
        colour: NDArray[np.uint8] | str,
        opacity: float = 1.0,
    ) -> None:
        """Straight lines between pairs (m, 2) of points (n, 3), coloured by their points."""
        geometry = self._geometry(points, colour, pairs)
        self._object(path, "LineSegments", geometry, self._material("Line", colour, opacity))

    def points(
        self, path: str, points: ArrayLike, colour: NDArray[np.uint8] | str, size: float
    ) -> None:
        """Dots at points (n, 3), `size` [m] wide."""
        material = {"type": "PointsMaterial", "size": float(size) * POINT}
        material |= self._colour(colour)
        self._object(path, "Points", self._geometry(points, colour), material)

    def mesh(
        self, path: str, vertices: ArrayLike, faces: ArrayLike, colour: str, opacity: float = 1.0
    ) -> None:
        """Triangles (m, 3) of vertices (n, 3)."""
        material = self._material("MeshPhong", colour, opacity)
        self._object(path, "Mesh", self._geometry(vertices, colour, faces), material)

    def image(self, path: str, corners: ArrayLike, address: str) -> None:
        """A picture (a data: address) between its lower left, lower right, ... corners (4, 3)."""
        geometry = self._geometry(corners, "#ffffff", [[0, 1, 2], [0, 2, 3]])
        uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
        geometry["data"]["attributes"]["uv"] = _attribute(uv, 2)
        material = self._material("MeshBasic", "#ffffff", 0.999)  # the maps are drawn after it
        scene = self._object(path, "Mesh", geometry, material, order=-1)
        scene["materials"][0]["map"] = texture = f"texture-{self._count}"
        scene["images"] = [{"uuid": f"image-{self._count}", "url": address}]
        scene["textures"] = [
            # 1001 is three.js's ClampToEdgeWrapping: its default repeats the picture
            {"uuid": texture, "image": f"image-{self._count}", "wrap": [1001, 1001]}
        ]

    def solid(
        self, path: str, kind: str, size: Sequence[float], colour: str, opacity: float = 1.0
    ) -> None:
        """A "box", "sphere" or "cylinder", sized [m] as in a URDF; cylinders stand along y."""
        material = self._material("MeshPhong", colour, opacity)
        self._object(path, "Mesh", _solid(kind, size), material)

    def marker(
        self, path: str, radius: float, colour: str, opacity: float = 1.0, order: int = 1
    ) -> None:
        """A ball that nothing hides, flat in any light; one of a higher `order` is on top."""
        material = self._material("MeshBasic", colour, opacity)
        material |= {"transparent": True, "depthTest": False, "depthWrite": False}
        self._object(path, "Mesh", _solid("sphere", [radius]), material, order)

    def place(self, path: str, transform: ArrayLike) -> None:
        """Put everything below a path where a transform (4, 4) says."""
        # three.js stores matrices by columns
        matrix = np.asarray(transform, dtype=float).T.ravel().tolist()
        self._commands.append({"type": "set_transform", "path": path, "matrix": matrix})

    def set(self, path: str, name: str, value: Any) -> None:
        """Set a property of what is at a path, such as ``visible``."""
        self._commands.append(
            {"type": "set_property", "path": path, "property": name, "value": value}
        )

    def animate(self, tracks: Mapping[str, Array], fps: float, repetitions: int) -> None:
        """Move what is at each path through transforms (frames, 4, 4)."""
        clips = []
        for path, transforms in tracks.items():
            values = [
                _track(".position", "vector3", transforms[:, :3, 3]),
                _track(".quaternion", "quaternion", quaternions(transforms[:, :3, :3])),
            ]
            clip = {"fps": fps, "name": "default", "tracks": values}
            clips.append({"path": path, "clip": clip})
        options = {"play": True, "repetitions": repetitions}
        self._commands.append(
            {"type": "set_animation", "path": "", "animations": clips, "options": options}
        )

    def packed(self) -> list[bytes]:
        """Return the commands as meshcat's viewer reads them."""
        import umsgpack

        return [umsgpack.packb(command) for command in self._commands]

    def _object(
        self,
        path: str,
        kind: str,
        geometry: dict[str, Any],
        material: dict[str, Any],
        order: int = 0,
    ) -> dict[str, Any]:
        self._count += 1
        names = {part: f"{part}-{self._count}" for part in ("object", "geometry", "material")}
        scene: dict[str, Any] = {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": names["geometry"], **geometry}],
            "materials": [{"uuid": names["material"], **material}],
            "object": {
                "uuid": names["object"],
                "type": kind,
                "renderOrder": order,
                "geometry": names["geometry"],
                "material": names["material"],
                "matrix": np.eye(4).ravel().tolist(),
            },
        }
        self._commands.append({"type": "set_object", "path": path, "object": scene})
        return scene

    def _geometry(
        self, points: ArrayLike, colour: NDArray[np.uint8] | str, index: ArrayLike | None = None
    ) -> dict[str, Any]:
        points = np.asarray(points, dtype=np.float32).reshape(-1, 3)
        attributes = {"position": _attribute(points, 3)}
        if not isinstance(colour, str):
            attributes["color"] = _attribute(colour, 3)
        data: dict[str, Any] = {"attributes": attributes}
        if index is not None:
            small = len(points) <= 1 << 16
            data["index"] = _attribute(
                np.asarray(index, dtype=np.uint16 if small else np.uint32).ravel(), 1
            )
        return {"type": "BufferGeometry", "data": data}

    def _material(
        self, kind: str, colour: NDArray[np.uint8] | str, opacity: float
    ) -> dict[str, Any]:
        name = "LineBasicMaterial" if kind == "Line" else f"{kind}Material"
        return {
            "type": name,
            # both sides: nobody guarantees how a URDF's triangles are wound
            "side": 2,
            "transparent": opacity < 1.0,
            "opacity": float(opacity),
            # what is seen through must not hide what is drawn after it
            "depthWrite": opacity >= 1.0,
            **self._colour(colour),
        }

    @staticmethod
    def _colour(colour: NDArray[np.uint8] | str) -> dict[str, Any]:
        if isinstance(colour, str):
            return {"color": int(colour[1:], 16)}
        # 2 as meshcat's own classes write it: the constant VertexColors of older three.js
        return {"color": 0xFFFFFF, "vertexColors": 2}


def _track(name: str, kind: str, rows: Array) -> dict[str, Any]:
    keys = [{"time": float(k), "value": row} for k, row in enumerate(rows.tolist())]
    return {"name": name, "type": kind, "keys": keys}


def quaternions(rotations: Array) -> Array:
    """Quaternions x, y, z, w (n, 4) of rotations (n, 3, 3), neighbours on one side."""
    q = quaternion_of(rotations)
    flips = np.sign(np.sum(q[1:] * q[:-1], axis=1))
    # q and -q are one rotation; between opposite signs three.js would turn the long way
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips < 0, -1.0, 1.0))])
    return np.asarray(q * signs[:, None])


def _solid(kind: str, size: Sequence[float]) -> dict[str, Any]:
    if kind == "box":
        keys: tuple[str, ...] = ("width", "height", "depth")
        shape: dict[str, Any] = {"type": "BoxGeometry"}
    elif kind == "sphere":
        keys, shape = (
            ("radius",),
            {"type": "SphereGeometry", "widthSegments": 24, "heightSegments": 16},
        )
    else:
        size, keys = [size[0], *size], ("radiusTop", "radiusBottom", "height")
        shape = {"type": "CylinderGeometry", "radialSegments": 28}
    return shape | dict(zip(keys, map(float, size), strict=True))


def _attribute(array: NDArray[Any], width: int) -> dict[str, Any]:
    import umsgpack

    kind, code = _KINDS[array.dtype.name]
    return {
        "itemSize": width,
        "type": kind,
        "array": umsgpack.Ext(code, np.ascontiguousarray(array).tobytes()),
        "normalized": kind == "Uint8Array",
    }
