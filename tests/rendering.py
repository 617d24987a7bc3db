"""A camera over a desk with an arm on it: pictures whose truth is known, for the tests.

The arm is planar: capsules at one height over a textured desk, a printed tag on its tip. The
camera is a pinhole with a radial lens; pictures have shadows, blur, noise and JPEG's marks.
Nothing here is shared with `calib.recording`: projection and printing are written anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
FINE = 4
"""Samples of a printed pattern along each side of a pixel."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole with the lens `1 + k1 r^2 + k2 r^4`; pixel centres have whole coordinates."""

    size: tuple[int, int] = (1280, 720)
    focal: float = 1100.0
    k1: float = -0.15
    k2: float = 0.0
    position: tuple[float, float, float] = (0.2, -0.25, 0.9)
    target: tuple[float, float, float] = (0.2, 0.08, 0.0)
    roll: float = 0.02
    shift: tuple[float, float] = (4.0, -7.0)
    turned: Array | None = None  # its rotation, in place of target and roll

    @property
    def centre(self) -> Array:
        return np.array(self.size) / 2.0 - 0.5 + self.shift

    @cached_property
    def rotation(self) -> Array:
        """World to camera: x right, y down, z ahead."""
        if self.turned is not None:
            return self.turned
        ahead = np.subtract(self.target, self.position)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0] if abs(ahead[2]) < 0.999 else [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        down = np.cross(ahead, right)
        c, s = np.cos(self.roll), np.sin(self.roll)
        return np.stack([c * right + s * down, c * down - s * right, ahead])

    def project(self, points: ArrayLike) -> Array:
        """Return pixels (..., 2) of points (..., 3) [m]."""
        local = (np.asarray(points, float) - self.position) @ self.rotation.T
        n = local[..., :2] / local[..., 2:]
        r2 = (n**2).sum(-1, keepdims=True)
        return self.centre + self.focal * n * (1.0 + self.k1 * r2 + self.k2 * r2**2)

    def rays(self, pixels: Array) -> Array:
        """Return directions in the world (..., 3) of pixels (..., 2)."""
        seen = (pixels - self.centre) / self.focal
        r = np.linspace(0.0, 1.2, 4001)
        bent = r * (1.0 + self.k1 * r**2 + self.k2 * r**4)
        inverse = np.divide(r, bent, out=np.ones_like(r), where=r > 0)
        # steps of 3e-4: linear between them is exact to 1e-8
        n = seen * np.interp((seen**2).sum(-1), bent**2, inverse)[..., None]
        return n @ self.rotation[:2] + self.rotation[2]


@dataclass(frozen=True, eq=False)
class Sticker:
    """A printed pattern somewhere: `cells` (rows, columns) of grey, the first row on top.

    `place` holds x, y, z of its middle [m] and its angle; `normal` may tilt it (rotation
    vector applied after the angle); `border` is a white margin in cells.
    """

    cells: Array
    cell: float
    place: tuple[float, float, float, float]
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    border: float = 1.0

    @property
    def frame(self) -> tuple[Array, Array]:
        x, y, z, angle = self.place
        turn = cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0]
        return cv2.Rodrigues(np.array(self.tilt))[0] @ turn, np.array([x, y, z])

    @property
    def half(self) -> Array:
        rows, columns = self.cells.shape
        return 0.5 * self.cell * np.array([columns, rows])

    def outline(self) -> Array:
        w, h = self.half + self.border * self.cell
        turn, at = self.frame
        t = np.linspace(-1, 1, 9)
        one = np.ones_like(t)
        side = np.concatenate([np.c_[t, -one], np.c_[one, t], np.c_[-t, one], np.c_[-one, -t]])
        return np.c_[side * [w, h], np.zeros(len(side))] @ turn.T + at


def tag(number: int, size: float, place: Sequence[float], **more: object) -> Sticker:
    """Return a sticker of an AprilTag 36h11 whose black square has the side `size` [m]."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = cv2.aruco.generateImageMarker(known, number, known.markerSize + 2) / 255.0
    return Sticker(cells, size / len(cells), tuple(place), **more)  # type: ignore[arg-type]


def board(columns: int, rows: int, square: float, marker: float, place, **more: object) -> Sticker:
    """Return a ChArUco board (5x5_100) as OpenCV draws it; x, y of `place` is its middle."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    made = cv2.aruco.CharucoBoard((columns, rows), square, marker, known)
    per = 56  # a multiple of the seven cells of a marker at 3:4
    cells = made.generateImage((columns * per, rows * per), marginSize=0, borderBits=1)
    return Sticker(cells / 255.0, square / per, tuple(place), **{"border": 0.3 * per, **more})  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Desk:
    """All that a picture shows, and what spoils it.

    `lengths` [m] of the links from the base at the origin; `height` of the arm's plane, the tag
    lies on it. On the tip is tag 7 of 40 mm; `tip_tilt` is a rotation vector by which it leans.
    """

    camera: Camera = field(default_factory=Camera)
    lengths: tuple[float, ...] = (0.18, 0.14, 0.09)
    offsets: tuple[float, ...] = (0.0, 0.0, 0.0)
    height: float = 0.0
    width: float = 0.028
    tip_tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    still: tuple[Sticker, ...] = ()
    blur: float = 0.7
    noise: float = 2.0
    shadow: float = 0.35
    seed: int = 0

    def joints(self, q: ArrayLike) -> Array:
        """Return places (links + 1, 2) of the joints and the tip for one posture."""
        phi = np.cumsum(np.asarray(q, float) + self.offsets[: len(self.lengths)])
        steps = np.array(self.lengths)[:, None] * np.c_[np.cos(phi), np.sin(phi)]
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, 0)])

    def tip(self, q: ArrayLike) -> Array:
        """Return tips (n, 2) [m] of postures (n, joints)."""
        return np.array([self.joints(row)[-1] for row in np.atleast_2d(q)])

    def tip_pixels(self, q: ArrayLike) -> Array:
        """Return where the tag's centre appears, (n, 2) [px]."""
        tip = self.tip(q)
        return self.camera.project(np.c_[tip, np.full(len(tip), self.height)])

    def postures(self, n: int, rng: np.random.Generator, margin: float = 40.0) -> Array:
        """Draw postures (n, 3) whose tag is within the picture, so far from its border [px]."""
        q = rng.uniform([-0.2, 0.0, -1.2], [1.3, 1.4, 1.2], (100 * n, 3))
        pixels = self.tip_pixels(q)
        inside = (pixels > margin) & (pixels < np.array(self.camera.size) - margin)
        return q[inside.all(axis=1)][:n]

    def picture(self, q: ArrayLike, rng: np.random.Generator, *, arm: bool = True) -> Image:
        """Render one posture as a grey picture (height, width)."""
        scene = self._background.copy()
        if arm:
            self._paint_arm(scene, np.asarray(q, float))
        grey = scene * self._light
        grey = cv2.GaussianBlur(grey, (0, 0), self.blur) if self.blur else grey
        grey = grey + rng.normal(0.0, 1.0, grey.shape).astype(np.float32) * self.noise
        picture = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
        return cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)

    @cached_property
    def _light(self) -> NDArray[np.float32]:
        w, h = self.camera.size
        x, y = np.meshgrid(np.linspace(-1, 1, w), np.linspace(-1, 1, h))
        return (0.92 + 0.1 * x - 0.06 * y - 0.1 * (x**2 + y**2)).astype(np.float32)

    @cached_property
    def _rays(self) -> Array:
        w, h = self.camera.size
        return self.camera.rays(np.stack(np.meshgrid(np.arange(w), np.arange(h)), -1))

    @cached_property
    def _background(self) -> NDArray[np.float32]:
        w, h = self.camera.size
        far = self.camera.position[2] / np.maximum(-self._rays[..., 2], 1e-3)
        x, y = (self.camera.position[k] + far * self._rays[..., k] for k in (0, 1))
        coarse = np.random.default_rng(self.seed).normal(0, 1, (h // 6, w // 6))
        grain = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
        wood = 12 * np.sin(60 * y + 3 * np.sin(7 * x)) + 5 * np.sin(400 * y + 9 * np.sin(11 * x))
        scene = (150 + wood + 6 * grain).astype(np.float32)
        for sticker in self.still:
            self._paint_sticker(scene, sticker)
        return scene

    def _paint_sticker(self, scene: NDArray[np.float32], sticker: Sticker) -> None:
        outline = self.camera.project(sticker.outline())
        low = np.maximum(np.floor(outline.min(0)).astype(int) - 1, 0)
        high = np.minimum(np.ceil(outline.max(0)).astype(int) + 2, self.camera.size)
        if (low >= high).any():
            return
        (x0, y0), (x1, y1) = low, high
        turn, at = sticker.frame
        rays = self._rays[y0:y1, x0:x1] @ turn
        start = (np.array(self.camera.position) - at) @ turn
        p = start[:2] - start[2] / rays[..., 2:] * rays[..., :2]
        places = ((p * (1.0, -1.0) + sticker.half) / sticker.cell - 0.5).astype(np.float32)
        # between pixels places on the paper are linear to a thousandth of a pixel
        places = cv2.resize(places, None, fx=FINE, fy=FINE)  # columns and rows of cells
        cells = sticker.cells.astype(np.float32)
        shade = cv2.remap(cells, places, None, cv2.INTER_NEAREST, borderValue=1.0)
        margin = sticker.border + 0.5
        paper = cv2.inRange(places, -margin * np.ones(2), cells.shape[::-1] + np.array(margin - 1))
        paper = (paper > 0).astype(np.float32)
        size = (x1 - x0, y1 - y0)
        colour = cv2.resize((22.0 + 206.0 * shade) * paper, size, interpolation=cv2.INTER_AREA)
        cover = cv2.resize(paper, size, interpolation=cv2.INTER_AREA)
        part = scene[y0:y1, x0:x1]
        part[:] = part * (1 - cover) + colour

    def _paint_arm(self, scene: NDArray[np.float32], q: Array) -> None:
        places = self.joints(q)
        if self.shadow:
            dark, shift = np.zeros(scene.shape, np.uint8), np.array([0.012, -0.018])
            for a, b in pairwise(places):
                self._capsule(dark, a + shift, b + shift, self.width, 0.0, 255)
            scene *= 1.0 - self.shadow * cv2.blur(dark, (15, 15)).astype(np.float32) / 255.0
        for k, (a, b) in enumerate(pairwise(places)):
            self._capsule(scene, a, b, self.width * (1.0 - 0.12 * k), self.height, 60 + 30 * k)
            self._capsule(scene, a, a, 0.4 * self.width, self.height, 200)
        angle = float(np.sum(q)) + float(np.sum(self.offsets[: len(self.lengths)]))
        tip = tag(7, 0.04, (*places[-1], self.height, angle), tilt=self.tip_tilt)
        self._paint_sticker(scene, tip)

    def _capsule(self, scene: np.ndarray, a: Array, b: Array, width, z, grey) -> None:
        ahead = np.arctan2(*(b - a)[::-1])
        t = np.linspace(-np.pi / 2, np.pi / 2, 13) + ahead
        ends = [c + 0.5 * width * np.c_[np.cos(s), np.sin(s)] for c, s in ((b, t), (a, t + np.pi))]
        outline = np.concatenate(ends)
        pixels = self.camera.project(np.c_[outline, np.full(len(outline), z)])
        cv2.fillPoly(scene, [np.round(pixels * 16).astype(np.int32)], grey, cv2.LINE_AA, 4)


def board_shots(desk: Desk, made: Sticker, count: int, rng: np.random.Generator) -> list[Image]:
    """Return pictures of the board held near the camera, tilted this way and that."""
    pictures = []
    camera = desk.camera
    for _ in range(count):
        pixel = camera.size * rng.uniform([0.32, 0.35], [0.68, 0.65])
        place = camera.position + rng.uniform(0.35, 0.6) * camera.rays(pixel)
        tilt = (*rng.uniform(-0.55, 0.55, 2), 0.0)
        held = replace(made, place=(*place, rng.uniform(-0.6, 0.6)), tilt=tilt)
        seen = Desk(camera, still=(held,), blur=desk.blur, noise=desk.noise, seed=desk.seed)
        pictures.append(seen.picture([0.0] * len(desk.lengths), rng, arm=False))
    return pictures


def write_video(path: str, frames: Sequence[Image], rate: float) -> None:
    """Write grey frames as a video with a constant rate [1/s]."""
    size = frames[0].shape[::-1]
    writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
