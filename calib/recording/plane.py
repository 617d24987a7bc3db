"""The pose of a flat frame in the camera's, fitted to points of it and their pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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


def square_pose(lens: Lens, corners: Array, size: float) -> Pose:
    """Fit the pose of a printed square of a side [m] to its corners (4, 2) [px].

    Its frame: origin in the middle, x to the right, y up, z out of the paper.
    """
    half = size / 2.0
    points = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    return find_pose(lens, points, corners)
