"""Lens: nine numbers of a camera that map directions to its pictures."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..common.atomic import atomic_write
from ..common.inputs import numbers


@dataclass(frozen=True, eq=False)
class Lens:
    """A pinhole with radial and tangential distortion (Brown's model, as in OpenCV)."""

    size: tuple[int, int]  # width and height of the pictures it holds for [px]
    focal: Array  # focal lengths along x and y (2,) [px]
    centre: Array  # principal point (2,) [px]
    distortion: Array  # k1, k2, p1, p2, k3 (5,)
    # distance of the calibration's corners from their places [px]
    rms: float = 0.0
    # of `parameters`; zero where a lens is taken for exact (9, 9)
    covariance: Array = field(default_factory=lambda: np.zeros((9, 9)))

    @staticmethod
    def of(size: tuple[int, int], parameters: Array, rms: float = 0.0) -> Lens:
        """The lens of parameters (9,)."""
        focal, centre, distortion = np.split(parameters, [2, 4])
        return Lens(size, focal, centre, distortion, rms)

    @property
    def parameters(self) -> Array:
        """Focal lengths, principal point and distortion (9,), as `covariance` has them."""
        return np.concatenate([self.focal, self.centre, self.distortion])

    def plus(self, change: Array) -> Lens:
        """The lens with a change (9,) of its parameters."""
        return Lens.of(self.size, self.parameters + change, self.rms)

    @property
    def matrix(self) -> Array:
        """The camera matrix (3, 3)."""
        matrix = np.diag([*self.focal, 1.0])
        matrix[:2, 2] = self.centre
        return matrix

    def distort(self, points: ArrayLike) -> Array:
        """Pixels (.., 2) of points (.., 2) of the plane at distance one."""
        n = np.asarray(points, float)
        k1, k2, p1, p2, k3 = self.distortion
        x = n[..., 0]
        y = n[..., 1]
        r2 = x**2 + y**2
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        tangential = [
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2),
            p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y,
        ]
        bent = n * radial[..., None] + np.stack(tangential, axis=-1)
        return np.asarray(self.centre + self.focal * bent)

    def undistort(self, pixels: ArrayLike) -> Array:
        """Points (n, 2) of the plane at distance one that appear at pixels (n, 2)."""
        # not OpenCV's undistortPoints: it stops at five steps, 4.11 and 5 differ in how to ask more
        target = np.asarray(pixels, float)
        n = (target - self.centre) / self.focal
        for _ in range(60):
            step = (target - self.distort(n)) / self.focal
            n = n + step
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        return n

    def to_json(self) -> dict[str, object]:
        """The lens as plain values."""
        values = {key: np.asarray(v).tolist() for key, v in vars(self).items()}
        return {"kind": "calib lens", **values}

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> Lens:
        """The lens of a `to_json`.

        Raises KeyError, TypeError, ValueError if it is none.
        """
        width, height = map(int, numbers("size", document["size"], 2))
        focal = numbers("focal", document["focal"], 2)
        if not min(width, height, *focal) > 0:
            raise ValueError(f"size {width}x{height}, focal lengths {focal}")
        parameters = [
            *focal,
            *numbers("centre", document["centre"], 2),
            *numbers("distortion", document["distortion"], 5),
        ]
        rms = float(document.get("rms", 0.0))
        lens = Lens.of((width, height), np.array(parameters), rms)
        covariance = document.get("covariance", lens.covariance)
        return replace(
            lens, covariance=np.array(covariance, float).reshape(9, 9)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as JSON."""
        atomic_write(
            path, (json.dumps(self.to_json(), indent=2) + "\n").encode()
        )
