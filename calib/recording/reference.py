"""What positions are told in: pixels, or metres in a frame on the desk, whose pose is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import cross_matrix, exponential, logarithm
from ..common.arrays import Array
from ..errors import LogError
from .lens import Lens
from .opencv import opencv

_LEAST_NOISE = 0.01  # [px]; corners are credited with no less
_STEPS, _SOFT = 40, 0.5  # of a pose; [px], misses beyond it count by their size, not its square
_HALF = np.array([[0.5, 0.0], [0.0, 0.5]])  # [px], steps of a finite difference


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is in the camera's: `seen = rotation @ point + shift` [m]."""

    rotation: Array  # frame to camera (x right, y down, z ahead) (3, 3)
    shift: Array  # the frame's origin in the camera's (3,) [m]
    # of a small turn [rad] in the camera's axes, of the shift [m], and of the lens's parameters,
    # which the pose was found with (15, 15)
    covariance: Array
    rms: float  # rms distance of the points from where the pose puts them [px]

    @property
    def camera(self) -> Array:
        """The camera's place in the frame [m]."""
        return -self.rotation.T @ self.shift

    def moved(self, change: Array) -> Pose:
        """Return the pose after a small turn and shift (6,)."""
        turned = exponential(change[:3]) @ self.rotation
        return replace(self, rotation=turned, shift=self.shift + change[3:])

    @property
    def doubt(self) -> tuple[float, float]:
        """Standard deviations of the turn [rad] and of the camera's place [m], all axes."""
        # a turn of the frame by w moves the camera in it by shift x w
        A = np.c_[cross_matrix(self.shift), np.eye(3)]
        place = A @ self.covariance[:6, :6] @ A.T
        return float(np.sqrt(np.trace(self.covariance[:3, :3]))), float(np.sqrt(np.trace(place)))


def find_pose(lens: Lens, points: Array, pixels: Array) -> Pose:
    """Fit the pose of a flat frame to points (n, 3) [m] of it and their pixels (n, 2), n >= 4.

    Of the two poses of a plane seen from afar the better one; outliers are weighed down.
    """
    cv2 = opencv()
    flat = lens.undistort(pixels)
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        points, flat.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        raise LogError("the reference's points lie on a line or in one place: no pose fits them")

    def refined(turn: Array, shift: Array) -> tuple[float, Array, Array, Array, Array, Array]:
        """Cost, rotation, shift, miss (n, 2), derivatives by the pose and by the lens."""
        rotation = exponential(np.ravel(turn))
        shift = np.ravel(shift)
        for _ in range(_STEPS):
            seen, slopes = cv2.projectPoints(
                points, logarithm(rotation), shift, lens.matrix, lens.distortion
            )
            miss = pixels - seen.reshape(-1, 2)
            by = slopes[:, 3:6].reshape(-1, 2, 3)
            own = np.concatenate([-by @ cross_matrix(points @ rotation.T), by], axis=2)
            square = (miss / _SOFT) ** 2
            root = (1.0 + square.ravel()) ** -0.25  # of soft L1's weights
            J = own.reshape(-1, 6)
            step = np.linalg.lstsq(J * root[:, None], miss.ravel() * root, rcond=None)[0]
            rotation, shift = exponential(step[:3]) @ rotation, shift + step[3:]
            if np.abs(step).max() < 1e-8:
                break
        cost = float((np.sqrt(1.0 + square) - 1.0).sum())
        return cost, rotation, shift, miss, J * root[:, None], slopes[:, 6:15] * root[:, None]

    fits = [refined(turn, shift) for turn, shift in zip(turns, shifts, strict=True)]
    _, rotation, shift, miss, slopes, bent = min(fits, key=lambda fit: fit[0])
    rms = float(np.sqrt((miss**2).sum(1).mean()))
    variance = float((miss**2).sum()) / max(miss.size - 6, 1)
    # where the lens is not as it was taken to be, the pose follows it
    jacobian = np.vstack([-np.linalg.lstsq(slopes, bent, rcond=None)[0], np.eye(9)])
    covariance = jacobian @ lens.covariance @ jacobian.T
    spread = np.linalg.pinv(slopes.T @ slopes) * max(variance, _LEAST_NOISE**2)
    covariance[:6, :6] += spread
    return Pose(rotation, shift, covariance, rms)


def square_pose(lens: Lens, corners: Array, size: float) -> Pose:
    """Fit the pose of a printed square of a side [m] to its corners (4, 2) [px].

    Its frame: origin in the middle, x to the right, y up, z out of the paper.
    """
    signs = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    return find_pose(lens, 0.5 * size * signs, corners)


@dataclass(frozen=True, eq=False)
class PlaneReference:
    """A flat frame seen by a calibrated camera: rays are cut with the tag's plane."""

    lens: Lens
    pose: Pose
    height: float = 0.0  # z of the tag's plane in the frame [m]
    unit: str = "m"

    def positions(self, pixels: ArrayLike) -> Array:
        """Return x and y (n, 2) [m] where rays of pixels (n, 2) meet the plane, else NaN."""
        flat = self.lens.undistort(pixels)
        rays = np.c_[flat, np.ones(len(flat))] @ self.pose.rotation
        camera = self.pose.camera
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (self.height - camera[2]) / rays[:, 2]
            x = camera[:2] + far[:, None] * rays[:, :2]
        x[~(far > 0.0)] = np.nan
        return np.asarray(x)

    def pixels(self, positions: Array) -> Array:
        """Return where points (n, 2) [m] of the plane appear."""
        points = np.c_[positions, np.full(len(positions), self.height)]
        seen = points @ self.pose.rotation.T + self.pose.shift
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return self.lens.distort(seen[:, :2] / seen[:, 2:])

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel (n,), and the sd (n,) [m] that pose and lens make for all."""
        base = self.positions(pixels)
        variance = np.zeros(len(base))
        values, vectors = np.linalg.eigh(self.pose.covariance)
        for d in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
            if d.any():
                moved = replace(self, lens=self.lens.moved(d[6:]), pose=self.pose.moved(d[:6]))
                variance += ((moved.positions(pixels) - base) ** 2).sum(1) / 2.0
        return _scale(self, pixels), np.asarray(np.sqrt(variance))

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

    def positions(self, pixels: ArrayLike) -> Array:
        """Map pixels (n, 2) to the plane (n, 2)."""
        return _mapped(self.matrix, pixels)

    def pixels(self, positions: Array) -> Array:
        """Map the plane (n, 2) to pixels (n, 2)."""
        return _mapped(np.linalg.inv(self.matrix), positions)

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel, and the tags' own misfit."""
        return _scale(self, pixels), np.full(len(pixels), self.residual)

    def told(self) -> dict[str, Any]:
        """Return what a later recording compares itself with, as plain values."""
        if self.unit == "px":
            return {"kind": "pixels"}
        return {"kind": "flat", "matrix": self.matrix.tolist()}


def _mapped(matrix: ArrayLike, places: ArrayLike) -> Array:
    """Map places (n, 2) by a homography (3, 3)."""
    p = np.asarray(places, float)
    mapped = np.c_[p, np.ones(len(p))] @ np.asarray(matrix, float).T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


PICTURE = FlatReference(np.eye(3), 0.0, "px")
"""Pixels of the picture as they are: x to the right, y down."""

PositionReference = PlaneReference | FlatReference
"""Turns pixels into positions and back, and says how well it is known."""


def _scale(reference: PositionReference, pixels: Array) -> Array:
    """Return the standard deviation (n,) along each axis that one pixel's makes."""
    x, y = (reference.positions(pixels + d) - reference.positions(pixels) for d in _HALF)
    return np.asarray(2.0 * np.sqrt((x**2 + y**2).sum(1) / 2.0))


def fit_flat(pixels: Array, points: Array) -> FlatReference:
    """Fit the plane-to-plane map from pixels (n, 2) to points (n, 2) [m], n >= 4.

    Normalised direct linear transform (Hartley and Zisserman, section 4.4).  OpenCV's
    `findHomography` answers for points on a line too.
    """
    maps = []
    for values in (pixels, points):
        middle, spread = values.mean(0), float(np.sqrt(2.0) / max(values.std(), 1e-12))
        maps.append(np.vstack([np.c_[spread * np.eye(2), -spread * middle], [0.0, 0.0, 1.0]]))
    one = np.ones(len(pixels))
    p, (x, y, _) = np.c_[pixels, one] @ maps[0].T, maps[1] @ np.stack([*points.T, one])
    none = np.zeros_like(p)
    rows = np.block([[p, none, -x[:, None] * p], [none, p, -y[:, None] * p]])
    values, vectors = np.linalg.svd(rows)[1:]
    if values[7] < 1e-9 * values[0]:
        raise LogError("three of the reference's tags lie on a line: spread them as a rectangle")
    matrix = np.asarray(np.linalg.inv(maps[1]) @ vectors[8].reshape(3, 3) @ maps[0])
    miss = _mapped(matrix, pixels) - points
    return FlatReference(matrix, float(np.sqrt((miss**2).sum() / max(miss.size - 8, 1))))


def read_reference(about: Mapping[str, Any]) -> PositionReference:
    """Return the reference that a log tells of itself; see `PositionReference.told`.

    Raises LogError if it tells none.
    """
    try:
        told = about["reference"]
        if told["kind"] == "pixels":
            return PICTURE
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
