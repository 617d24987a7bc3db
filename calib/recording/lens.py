"""A camera's lens: calibrated once from a few pictures of a board, kept in a JSON file.

Millimetres need it: without it a picture's border is off by several pixels.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..common.atomic import atomic_write
from ..errors import LogError
from ..samples.camera import bent
from .board import LEAST_CORNERS, Board
from .opencv import opencv

_LEAST_PICTURES = 4  # of a board that a calibration needs
_DOUBT = 0.03  # share of the focal length that its sd may be
_TANGENTIAL = 10  # pictures from which a lens that sits askew can be told


@dataclass(frozen=True, eq=False)
class Lens:
    """A pinhole with radial and tangential distortion (Brown's model, as in OpenCV)."""

    size: tuple[int, int]  # width and height of the pictures it holds for [px]
    focal: Array  # focal lengths along x and y (2,) [px]
    centre: Array  # principal point (2,) [px]
    distortion: Array  # k1, k2, p1, p2, k3 (5,)
    rms: float = 0.0  # distance of the calibration's corners from their places [px]
    pictures: int = 0  # in how many
    # of `parameters`; zero where a lens is taken for exact (9, 9)
    covariance: Array = field(default_factory=lambda: np.zeros((9, 9)))

    @property
    def parameters(self) -> Array:
        """Focal lengths, principal point and distortion (9,), as `covariance` has them."""
        return np.concatenate([self.focal, self.centre, self.distortion])

    def moved(self, change: Array) -> Lens:
        """Return the lens with a change (9,) of its parameters."""
        p = self.parameters + change
        return replace(self, focal=p[:2], centre=p[2:4], distortion=p[4:])

    @property
    def matrix(self) -> Array:
        """The camera matrix (3, 3)."""
        (fx, fy), (u, v) = self.focal, self.centre
        return np.array([[fx, 0.0, u], [0.0, fy, v], [0.0, 0.0, 1.0]])

    def distort(self, points: ArrayLike) -> Array:
        """Return pixels (n, 2) of points (n, 2) of the plane at distance one."""
        return np.asarray(self.centre + self.focal * bent(points, self.distortion))

    def undistort(self, pixels: ArrayLike) -> Array:
        """Return points (n, 2) of the plane at distance one that appear at pixels (n, 2)."""
        # not OpenCV's undistortPoints: it stops at five steps, 4.11 and 5 differ in how to ask more
        target = np.asarray(pixels, float)
        n = (target - self.centre) / self.focal
        for _ in range(60):
            step = (target - self.distort(n)) / self.focal
            n = n + step
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        return n

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        fields = {name: np.asarray(value).tolist() for name, value in vars(self).items()}
        return {"kind": "calib lens", **fields}

    @classmethod
    def from_json(cls, told: Mapping[str, Any]) -> Lens:
        """Return the lens that `to_json` told.

        Raises KeyError, TypeError, ValueError if it is none.
        """
        width, height = (int(side) for side in told["size"])
        focal, centre, distortion = (
            np.array(told[name], float).reshape(count)
            for name, count in (("focal", 2), ("centre", 2), ("distortion", 5))
        )
        rms, pictures = float(told.get("rms", 0.0)), int(told.get("pictures", 0))
        covariance = np.array(told.get("covariance", np.zeros((9, 9))), float).reshape(9, 9)
        lens = cls((width, height), focal, centre, distortion, rms, pictures, covariance)
        known = np.isfinite(lens.parameters).all() and np.isfinite(lens.covariance).all()
        if not known or (lens.focal <= 0).any() or min(lens.size) <= 0:
            raise ValueError("the lens has impossible values")
        return lens

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as JSON."""
        atomic_write(path, (json.dumps(self.to_json(), indent=2) + "\n").encode())


def read_lens(path: str | os.PathLike[str]) -> Lens:
    """Read a lens that `Lens.save` wrote.

    Raises LogError if the file is none.
    """
    try:
        return Lens.from_json(json.loads(Path(path).read_text(encoding="utf-8")))
    except OSError as error:
        raise LogError(f"cannot read {str(path)!r}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise LogError(
            f"{path} is no lens: expected the lens.json of an earlier run, or a folder of "
            "pictures of the board"
        ) from None


def calibrate_lens(
    corners: Sequence[Mapping[int, Array]], board: Board, size: tuple[int, int]
) -> tuple[Lens, tuple[str, ...]]:
    """Fit a lens to pictures of a board held at different angles; notes say what makes it doubtful.

    corners : places (2,) [px] by number that each picture shows, as of `BoardFinder.find`
    size : width and height of the pictures [px]
    Raises LogError if too few pictures show the board, or it was never tilted.
    """
    cv2 = opencv()
    usable = [c for c in corners if len(c) >= LEAST_CORNERS]
    if len(usable) < _LEAST_PICTURES:
        most = max(map(len, corners), default=0)
        raise LogError(
            f"the board is in {len(usable)} of {len(corners)} pictures of the lens (at most "
            f"{most} corners found, {LEAST_CORNERS} expected in each): take {_LEAST_PICTURES} or "
            "more, 10 are better, near and tilted, and check the board's numbers"
        )
    world = board.corners().astype(np.float32)
    objects = [world[sorted(c)] for c in usable]
    images = [np.array([c[k] for k in sorted(c)], np.float32).reshape(-1, 1, 2) for c in usable]
    lens, doubt = None, np.inf
    with suppress(cv2.error):
        lens, doubt = _fit(objects, images, size)
    if lens is None or not doubt <= _DOUBT or not lens.focal.max() <= 50 * max(size):
        raise LogError(
            f"the pictures of the board determine the focal length to {100 * doubt:.2g} % only, "
            "3 % expected: tilt the board this way and that between them"
        )
    if lens.rms <= 1.0:
        return lens, ()
    return lens, (
        f"lens: the corners miss their places by {lens.rms:.2g} px rms; check that the board is "
        "flat and printed at its true size, and that the pictures are sharp",
    )


def _fit(
    objects: Sequence[Any], images: Sequence[Any], size: tuple[int, int]
) -> tuple[Lens, float]:
    """Fit lenses of one, two and four terms; the best, and the sd of its focal length, a share.

    Terms that the pictures do not need are free near the border, where no board was: a further term
    must lower Schwarz's criterion.
    """
    cv2 = opencv()
    one = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2
    choices = [(one, 1), (one & ~cv2.CALIB_FIX_K2, 2), (cv2.CALIB_FIX_K3, 4)]
    count = 2 * sum(map(len, images))
    fits = []
    for flags, terms in choices[: 3 if len(images) >= _TANGENTIAL else 2]:
        fit = cv2.calibrateCameraExtended(objects, images, size, None, None, flags=flags)
        # below 0.001 px the misfit is rounding, and its logarithm would decide
        score = count * np.log(max(fit[0], 1e-3) ** 2) + terms * np.log(count)
        fits.append((float(score), terms, fit))
    _, terms, (rms, matrix, distortion, turns, shifts, spread, *_) = min(fits, key=lambda f: f[0])
    bent = np.zeros(5)
    bent[: min(np.size(distortion), 5)] = np.ravel(distortion)[:5]
    # of each picture's normal equations what remains once its pose is eliminated
    free, precision = 4 + terms, np.zeros((4 + terms, 4 + terms))
    for points, turn, shift in zip(objects, turns, shifts, strict=True):
        J = cv2.projectPoints(points, turn, shift, matrix, bent)[1]
        pose, lens = J[:, :6], J[:, 6 : 6 + free]
        precision += lens.T @ (lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0])
    # rms is of distances: half of its square along each axis
    variance = 0.5 * rms**2 * count / max(count - 6 * len(objects) - free, 1)
    covariance = np.zeros((9, 9))
    covariance[:free, :free] = np.linalg.pinv(precision) * variance
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    made = Lens(size, focal, matrix[:2, 2].copy(), bent, float(rms), len(objects), covariance)
    return made, float(np.ravel(spread)[0] / focal[0])
