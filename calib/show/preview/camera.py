"""Camera: from where the preview is seen, and where a point comes to be on the screen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FIELD_OF_VIEW = 35.0  # degrees, from bottom to top
_TILT = math.radians(24.0)  # off the plane's normal, so that depth can be seen
_MARGIN = 1.05
_UPRIGHT = 0.75  # cosine of normal and vertical; planes above it are seen from above


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera that shows a box of the scene whatever the window's shape."""

    target: Array  # (3,), middle of the picture
    direction: Array  # (3,), unit vector from there to the camera
    half: Array  # (3,), half the extent of what is shown, along right, up and depth

    @staticmethod
    def onto(points: Array, frame: Array) -> Camera:
        """Camera that shows points (n, 3) and looks onto a plane of axes `frame` (3, 3)."""
        normal, up = frame[2], np.array([0.0, 0.0, 1.0])
        if abs(normal @ up) > _UPRIGHT:
            # from above, y leading up the screen
            normal = normal * math.copysign(1.0, normal @ up)
            direction = math.cos(_TILT) * normal - math.sin(_TILT) * frame[1]
        else:
            direction = math.cos(_TILT) * normal + math.sin(_TILT) * up
        direction = direction / np.linalg.norm(direction)
        axes = _axes(direction)
        seen = points @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        return Camera((low + high) / 2 @ axes, direction, (high - low) / 2)

    def distance(self, aspect: float) -> float:
        """Distance from target to camera for a window of this width over height."""
        slope = math.tan(math.radians(FIELD_OF_VIEW) / 2)
        # the nearest of the box, half a depth in front of its middle, must fit as well
        reach = max(self.half[1], self.half[0] / aspect) / slope
        return float(_MARGIN * reach + self.half[2])

    def project(self, points: ArrayLike, width: int, height: int, panel: int = 0) -> Array:
        """Pixels (n, 2), from the left and from the top, of points (n, 3).

        `panel` pixels at the left are covered by the legend; the picture is centred in
        what is left of the window.
        """
        axes = _axes(self.direction)
        away = (np.atleast_2d(np.asarray(points, dtype=float)) - self.target) @ axes.T
        depth = self.distance((width - panel) / height) - away[:, 2]
        slope = math.tan(math.radians(FIELD_OF_VIEW) / 2)
        pixels = away[:, :2] / (depth * slope)[:, None] * (height / 2)
        return np.stack([(width + panel) / 2 + pixels[:, 0], height / 2 - pixels[:, 1]], axis=1)

    def to_json(self) -> dict[str, Any]:
        """Plain data for the page, which computes the same."""
        return {
            "target": self.target.tolist(),
            "direction": self.direction.tolist(),
            "half": self.half.tolist(),
            "fov": FIELD_OF_VIEW,
            "margin": _MARGIN,
        }


def _axes(direction: Array) -> Array:
    """Rows right, up and towards the camera (3, 3); the scene's z leads upwards."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
