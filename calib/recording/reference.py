"""What positions are told in: pixels, or metres in a frame that lies on the desk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .lens import Lens
from .plane import Pose, apply_homography, cut_noise, cut_plane

_HALF = np.array([[0.5, 0.0], [0.0, 0.5]])  # [px], steps of a finite difference


@dataclass(frozen=True, eq=False)
class PlaneReference:
    """A flat frame seen by a calibrated camera: rays are cut with the tag's plane."""

    lens: Lens
    pose: Pose
    height: float = 0.0
    unit: str = "m"

    def positions(self, pixels: Array) -> Array:
        """Return where the rays meet the plane."""
        return cut_plane(self.lens, self.pose, pixels, self.height)

    def pixels(self, positions: Array) -> Array:
        """Return where points of the plane appear."""
        points = np.c_[positions, np.full(len(positions), self.height)]
        seen = points @ self.pose.rotation.T + self.pose.shift
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self.lens.distort(seen[:, :2] / seen[:, 2:])

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel, and what pose and lens leave open."""
        return _scale(self, pixels), cut_noise(self.lens, self.pose, pixels, self.height)

    def told(self) -> dict[str, Any]:
        """Return the camera's pose over the frame."""
        return {
            "kind": "plane",
            "rotation": self.pose.rotation.tolist(),
            "camera": self.pose.camera.tolist(),
            "doubt": list(self.pose.doubt),
            "height": self.height,
        }


@dataclass(frozen=True, eq=False)
class FlatReference:
    """A flat frame seen by an unknown camera: a homography between tags around the arm."""

    matrix: Array  # pixels to positions (3, 3)
    residual: float  # of the tags that it was fitted to (standard deviation) [unit]
    unit: str = "m"

    def positions(self, pixels: Array) -> Array:
        """Map pixels to the plane."""
        return apply_homography(self.matrix, pixels)

    def pixels(self, positions: Array) -> Array:
        """Map the plane to pixels."""
        return apply_homography(np.asarray(np.linalg.inv(self.matrix), float), positions)

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel, and the tags' own misfit."""
        return _scale(self, pixels), np.full(len(pixels), self.residual)

    def told(self) -> dict[str, Any]:
        """Return what a later recording compares itself with, as plain values."""
        if self.unit == "px":
            return {"kind": "pixels"}
        return {"kind": "flat", "matrix": self.matrix.tolist()}


PIXELS = FlatReference(np.eye(3), 0.0, "px")
"""Pixels of the picture as they are: x to the right, y down."""

PositionReference = PlaneReference | FlatReference
"""Turns pixels into positions and back, and says how well it is known."""


def _scale(reference: PositionReference, pixels: Array) -> Array:
    """Return the standard deviation (n,) along each axis that one pixel's makes."""
    x, y = (reference.positions(pixels + d) - reference.positions(pixels) for d in _HALF)
    return np.asarray(2.0 * np.sqrt((x**2 + y**2).sum(1) / 2.0))


def read_reference(about: Mapping[str, Any]) -> PositionReference:
    """Return the reference that a log tells of itself; see `PositionReference.told`.

    Raises LogError if it tells none.
    """
    try:
        told = about["reference"]
        if told["kind"] == "pixels":
            return PIXELS
        if told["kind"] == "flat":
            flat = FlatReference(np.array(told["matrix"], float).reshape(3, 3), 0.0)
            flat.pixels(np.zeros((1, 2)))  # it has an inverse
            return flat
        rotation = np.array(told["rotation"], float).reshape(3, 3)
        shift = -rotation @ np.array(told["camera"], float).reshape(3)
        turn, place = (float(sd) for sd in told.get("doubt", (0.0, 0.0)))
        covariance = np.zeros((15, 15))
        covariance[:3, :3], covariance[3:6, 3:6] = turn**2 / 3 * np.eye(3), place**2 / 3 * np.eye(3)
        pose = Pose(rotation, shift, covariance, 0.0)
        return PlaneReference(Lens.from_json(about["lens"]), pose, float(told["height"]))
    except (KeyError, TypeError, ValueError):
        raise LogError(
            "the log does not say where its camera was: expected one that calib log made"
        ) from None
