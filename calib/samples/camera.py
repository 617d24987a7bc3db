"""Camera: what is known, before anything is fitted, of the camera that pixels come from.

A pinhole's centre and focal length are guessed from the size of its pictures; a lens that was
calibrated before replaces the guess. The model is ``pixel = f n (1 + k1 |n|^2) + centre`` for a
direction n = (x/z, y/z).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array, Document
from ..errors import LogError
from .lens import Lens

# widths and heights [px] that a camera's pictures usually have
_SIZES = (
    (640, 480),
    (800, 600),
    (1280, 720),
    (1280, 960),
    (1920, 1080),
    (3840, 2160),
)
# a lens that nobody calibrated: mean and sd of the focal length, sd of the centre [widths], of k1
FOCAL = 0.7
FOCAL_SD = 0.24
CENTRE_SD = 0.04
K1_SD = 0.3
# a calibrated lens that differs from one of k1 alone by more than this [px] is fitted again
_BENT = 0.3


@dataclass(frozen=True)
class Camera:
    """The camera of a log of pixels."""

    size: tuple[int, int]  # [px], width and height of its pictures
    # focal length, centre u, v [px] and k1, and how sure each is; all 0 for a lens that is known
    lens: tuple[float, float, float, float]
    lens_sd: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    note: str = ""  # what was assumed


def camera_of(about: Document, pixels: ArrayLike) -> Camera:
    """Return the camera of pixels (n, 2), as their log describes it or by their extent.

    about : may hold "lens", as `calib.samples.lens.Lens.to_json` writes it, or "size" of pictures
    Raises LogError if the lens is impossible, or pixels lie outside of its pictures.
    """
    pixels = np.asarray(pixels, float)
    low = pixels.min(axis=0)
    high = pixels.max(axis=0)
    if "lens" not in about:
        return _usual_camera(about.get("size"), high)
    camera = _camera_with_lens(about["lens"])
    size = np.array(camera.size)
    if (low < -0.5 * size).any() or (high > 1.5 * size).any():
        raise LogError(
            f"pixels reach from {low.round().tolist()} to {high.round().tolist()}, the camera's "
            f"pictures are {camera.size[0]}x{camera.size[1]}: the lens is of another camera or "
            "size of pictures",
            parameter="lens",
        )
    return camera


def _usual_camera(size: object, furthest: Array) -> Camera:
    """A camera whose pictures have a size, or one that holds the furthest pixel (2,)."""
    note = ""
    if isinstance(size, list) and len(size) == 2:
        width, height = map(int, size)
    else:
        width, height = np.maximum(furthest.astype(int) + 2, 1).tolist()
        for usual in reversed(_SIZES):
            if (furthest < usual).all():
                width, height = usual
        note = f"the camera's pictures are taken to be {width}x{height} px; a known lens says more"
    sd = (FOCAL_SD * width, CENTRE_SD * width, CENTRE_SD * width, K1_SD)
    return Camera(
        (width, height), (FOCAL * width, width / 2, height / 2, 0.0), sd, note
    )


def _camera_with_lens(document: Document) -> Camera:
    """A camera with a calibrated lens; a prior where k1 alone, or one focal length, is wrong."""
    try:
        lens = Lens.from_json(document)
    except (KeyError, TypeError, ValueError):
        raise LogError(
            "the lens has impossible values: expected size, focal, centre and distortion of a "
            "calibration"
        ) from None
    corners = np.meshgrid([0, 0.25, 0.5, 0.75, 1], [0, 0.5, 1])
    grid = np.stack(corners, axis=-1).reshape(-1, 2)
    n = 0.9 * (grid * lens.size - lens.centre) / lens.focal
    f = float(lens.focal.mean())
    k1 = float(lens.distortion[0])
    u, v = lens.centre.tolist()
    pinhole = Lens.of(lens.size, np.array([f, f, u, v, k1, 0, 0, 0, 0]))
    miss = float(np.abs(pinhole.distort(n) - lens.distort(n)).max())
    of_k1 = (f, u, v, k1)
    if miss <= _BENT:
        return Camera(lens.size, of_k1)
    note = f"the lens bends by up to {miss:.2g} px otherwise than k1 says: it is fitted again"
    relative = miss / lens.size[0]
    sd = (2 * relative * f, miss, miss, 4 * relative)
    return Camera(lens.size, of_k1, sd, note)
