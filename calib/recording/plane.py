"""From pixels to metres: the camera's pose over a plane, and rays cut with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import exponential
from ..common.arrays import Array
from ..errors import LogError
from .lens import Lens
from .opencv import opencv

_LEAST_NOISE = 0.01  # [px]; corners are credited with no less


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
        turn, (x, y, z) = self.covariance[:3, :3], self.shift
        # a turn of the frame by w moves the camera in it by shift x w
        A = np.c_[[[0, -z, y], [z, 0, -x], [-y, x, 0]], np.eye(3)]
        place = A @ self.covariance[:6, :6] @ A.T
        return float(np.sqrt(np.trace(turn))), float(np.sqrt(np.trace(place)))


def find_pose(lens: Lens, points: Array, pixels: Array) -> Pose:
    """Fit the pose of a flat frame to points of it and their pixels, outliers weighed down.

    points : (n, 3) array [m]; points of the plane z = 0, four or more.
    pixels : (n, 2) array [px]; where they appear.
    """
    from scipy.optimize import least_squares

    cv2 = opencv()
    flat = lens.undistort(pixels)
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        points, flat.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        raise LogError("the reference's points lie on a line or in one place: no pose fits them")

    def miss(p: Array, start: Array) -> Array:
        seen = points @ (exponential(p[:3]) @ start).T + p[3:]
        return np.asarray((lens.distort(seen[:, :2] / seen[:, 2:]) - pixels).ravel())

    fits = []
    for turn, shift in zip(turns, shifts, strict=True):
        start = exponential(np.ravel(turn))
        fit = least_squares(
            miss, np.r_[np.zeros(3), np.ravel(shift)], args=(start,), loss="soft_l1", f_scale=0.5
        )
        fits.append((fit, start))
    # a plane seen from afar fits two poses almost alike: the better one counts
    fit, start = min(fits, key=lambda each: float(each[0].cost))
    residual = fit.fun.reshape(-1, 2)
    rms = float(np.sqrt((residual**2).sum(1).mean()))
    variance = float((residual**2).sum()) / max(residual.size - 6, 1)
    slopes = np.asarray(fit.jac)
    spread = np.linalg.pinv(slopes.T @ slopes) * max(variance, _LEAST_NOISE**2)
    # where the lens is not as it was taken to be, the pose follows it
    camera = points @ (exponential(fit.x[:3]) @ start).T + fit.x[3:]
    flat = camera[:, :2] / camera[:, 2:]
    steps = np.diag(np.maximum(1e-6 * np.abs(lens.parameters), 1e-7))
    now = lens.distort(flat)
    slope = [(lens.moved(d).distort(flat) - now).ravel() / d.max() for d in steps]
    bent = np.stack(slope, axis=1)
    follow_tag = np.vstack([-np.linalg.lstsq(slopes, bent, rcond=None)[0], np.eye(9)])
    covariance = follow_tag @ lens.covariance @ follow_tag.T
    covariance[:6, :6] += spread
    return Pose(exponential(fit.x[:3]) @ start, fit.x[3:].copy(), covariance, rms)


def cut_plane(lens: Lens, pose: Pose, pixels: ArrayLike, height: float = 0.0) -> Array:
    """Cut the rays of pixels (n, 2) with the plane `z = height` of a frame.

    Returns (n, 2) array [m]; x and y in the frame; NaN where the ray does not meet the plane ahead.
    """
    flat = lens.undistort(pixels)
    rays = np.c_[flat, np.ones(len(flat))] @ pose.rotation
    camera = pose.camera
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (height - camera[2]) / rays[:, 2]
        x = camera[:2] + far[:, None] * rays[:, :2]
    x[~(far > 0.0)] = np.nan
    return np.asarray(x)


def cut_noise(lens: Lens, pose: Pose, pixels: Array, height: float = 0.0) -> Array:
    """Tell how far positions are off because pose and lens are known to their covariance.

    Returns (n,) array [m]; standard deviation along each axis; all positions of a recording share
        it.
    """
    base = cut_plane(lens, pose, pixels, height)
    variance = np.zeros(len(base))
    values, vectors = np.linalg.eigh(pose.covariance)
    for value, vector in zip(values, vectors.T, strict=True):
        d = vector * np.sqrt(max(float(value), 0.0))
        if d.any():
            moved = cut_plane(lens.moved(d[6:]), pose.moved(d[:6]), pixels, height)
            variance += ((moved - base) ** 2).sum(1) / 2.0
    return np.asarray(np.sqrt(variance))


def square_pose(lens: Lens, corners: Array, size: float) -> Pose:
    """Fit the pose of a printed square of a side [m] to its corners (4, 2) [px].

    Its frame: origin in the middle, x to the right, y up, z out of the paper.
    """
    half = size / 2.0
    points = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    return find_pose(lens, points, corners)


def homography(pixels: Array, points: Array) -> Array:
    """Fit the plane-to-plane map (3, 3) from pixels (n, 2) to points (n, 2), n >= 4.

    Normalised direct linear transform (Hartley and Zisserman, section 4.4).  OpenCV's
    `findHomography` rounds to single precision and answers for points on a line too.
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
    return np.asarray(np.linalg.inv(maps[1]) @ vectors[8].reshape(3, 3) @ maps[0])


def apply_homography(matrix: Array, pixels: ArrayLike) -> Array:
    """Map pixels (n, 2) by a homography (3, 3)."""
    p = np.asarray(pixels, float)
    mapped = np.c_[p, np.ones(len(p))] @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])
