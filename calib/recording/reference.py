"""What positions are told in: metres in a frame on the desk, whose pose a recording tells anew."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rotations import cross_matrix, exponential, similarity
from ..common.arrays import Array
from ..errors import LogError
from ..samples.tables import open_source
from .board import LEAST_CORNERS, Board
from .lens import Lens
from .pictures import opencv
from .rigid import rigid


@dataclass(frozen=True)
class Settings:
    """When a reference is where it was."""

    noise: float = 0.01  # [px]; corners are credited with no less
    moved: float = 0.7  # [px]; marks further off than this are elsewhere
    stretch: float = 1.5e-3  # growth of the marks that a new focus is told by
    # share of the pictures in which the marks may be elsewhere
    elsewhere: float = 0.3


SETTINGS = Settings()

Marks = Mapping[int, Array]
"""Places (2,) by number: of corners, or of tags' centres."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is in the camera's: `seen = rotation @ point + shift` [m]."""

    rotation: Array  # frame to camera (x right, y down, z ahead) (3, 3)
    shift: Array  # the frame's origin in the camera's (3,) [m]
    # of a small turn [rad] in the camera's axes, of the shift [m], and of the lens's parameters,
    # which the pose was found with (15, 15)
    covariance: Array

    @property
    def camera(self) -> Array:
        """The camera's place in the frame [m]."""
        return -self.rotation.T @ self.shift


def matrices(poses: Sequence[Pose]) -> Array:
    """Poses as matrices (n, 4, 4)."""
    turns = np.array([pose.rotation for pose in poses])
    return rigid(turns, np.array([pose.shift for pose in poses]))


def find_pose(lens: Lens, points: Array, pixels: Array) -> Pose:
    """Fit the pose of a flat frame to points (n, 3) [m] of it and their pixels (n, 2), n >= 4.

    Raises LogError if none fits.
    """
    cv2 = opencv()
    camera = (lens.matrix, lens.distortion)
    # of the two poses of a plane seen from afar the one that fits better
    is_solved, *start = cv2.solvePnP(
        points, pixels, *camera, flags=cv2.SOLVEPNP_IPPE
    )
    if not is_solved:
        raise LogError(
            "the reference's points lie on a line or in one place: no pose fits them"
        )
    turn, shift = cv2.solvePnPRefineLM(points, pixels, *camera, *start)
    projected, slopes = cv2.projectPoints(points, turn, shift, *camera)
    residuals = pixels - projected.reshape(-1, 2)
    rotation = exponential(turn.ravel())
    by = slopes[:, 3:6].reshape(-1, 2, 3)
    by_turn = -by @ cross_matrix(points @ rotation.T)
    by_pose = np.concatenate([by_turn, by], axis=2).reshape(-1, 6)
    # where the lens is not as it was taken to be, the pose follows it
    by_lens = slopes[:, 6:15]
    pose_by_lens = -np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
    follows = np.vstack([pose_by_lens, np.eye(9)])
    covariance = follows @ lens.covariance @ follows.T
    freedom = max(len(by_pose) - 6, 1)
    square = float((residuals**2).sum())
    variance = max(square / freedom, SETTINGS.noise**2)
    covariance[:6, :6] += np.linalg.pinv(by_pose.T @ by_pose) * variance
    return Pose(rotation, shift.ravel(), covariance)


@dataclass(frozen=True, eq=False)
class PlaneReference:
    """A flat frame seen by a calibrated camera: rays are cut with the tag's plane."""

    lens: Lens
    pose: Pose
    height: float = 0.0  # z of the tag's plane in the frame [m]

    def positions(self, pixels: ArrayLike) -> Array:
        """Return x and y (n, 2) [m] where rays of pixels (n, 2) meet the plane, else NaN."""
        flat = self.lens.undistort(pixels)
        camera = self.pose.camera
        rays = np.c_[flat, np.ones(len(flat))] @ self.pose.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (self.height - camera[2]) / rays[:, 2:]
            places = camera[:2] + far * rays[:, :2]
        return np.asarray(np.where(far > 0.0, places, np.nan))

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Return the scale of a pixel (n,), and the sd (n,) that pose and lens make for all [m]."""
        base = self.positions(pixels)
        variance = np.zeros(len(pixels))
        half = [self.positions(pixels + step) - base for step in np.eye(2) / 2]
        values, vectors = np.linalg.eigh(self.pose.covariance)
        for d in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
            pose = replace(
                self.pose,
                rotation=exponential(d[:3]) @ self.pose.rotation,
                shift=self.pose.shift + d[3:6],
            )
            other = replace(self, lens=self.lens.plus(d[6:]), pose=pose)
            moved = other.positions(pixels) - base
            variance += (moved**2).sum(axis=1) / 2.0
        scale = np.sqrt(2.0 * np.square(half).sum(axis=(0, 2)))
        return scale, np.sqrt(variance)

    def to_json(self) -> dict[str, object]:
        """Return the camera's pose over the frame, as plain values."""
        rotation = self.pose.rotation.tolist()
        camera = self.pose.camera.tolist()
        return {
            "kind": "plane",
            "rotation": rotation,
            "camera": camera,
            "height": self.height,
        }


@dataclass(frozen=True, eq=False)
class MarkLayout:
    """Marks at known places of a flat frame: a board's corners, or tags on a desk."""

    what: str  # what messages call it
    points: Marks  # places by number (2,) [m]
    least: int  # marks that must be seen

    @staticmethod
    def of_board(board: Board) -> MarkLayout:
        """The corners of a board."""
        return MarkLayout(
            "the board", dict(enumerate(board.corners()[:, :2])), LEAST_CORNERS
        )

    @staticmethod
    def read(path: str | os.PathLike[str]) -> MarkLayout:
        """Read tags at known places: a table with the columns `tag`, `x`, `y` [m].

        Raises LogError if there are fewer than four, or a tag has two places.
        """
        source = open_source(path)
        rows = source.numbers(["tag", "x", "y"])[0]
        is_number = rows[:, 0] % 1 == 0
        is_near = (np.abs(rows[:, 1:]) < 20.0).all(axis=1)
        good = rows[is_number & is_near]
        points = {int(row[0]): row[1:] for row in good}
        if len(rows) < 4 or len(points) < len(rows):
            raise LogError(
                f"{source.label} has {len(rows)} rows, {len(points)} tags: expected four or more "
                "around the workspace, each once, its id under 'tag' and metres under 'x' and 'y'"
            )
        return MarkLayout("the frame of tags", points, 4)


def watch(
    layout: MarkLayout,
    sightings: Mapping[int, Marks],
    lens: Lens,
    height: float = 0.0,
) -> tuple[PlaneReference, frozenset[int]]:
    """Find the reference in a recording, and the pictures in which it is elsewhere.

    seen : what pictures show, by their number
    height : of the tag's plane over the layout's [m]
    Raises LogError if the reference is not there, or elsewhere in many pictures.
    """
    # a hand in the picture hides some marks
    looked = {
        number: marks
        for number, marks in sightings.items()
        if len(marks) >= layout.least
    }
    if not looked:
        most = max(map(len, sightings.values()), default=0)
        raise LogError(
            f"{layout.what} is too small, hidden or not there: at most {most} found in a picture, "
            f"{layout.least} expected"
        )
    middle = _middle([*looked.values()])
    off = frozenset(
        number
        for number, marks in looked.items()
        if _is_elsewhere(middle, marks)
    )
    if len(off) > SETTINGS.elsewhere * len(looked):
        raise LogError(
            f"{layout.what} is elsewhere, or of another size, in {len(off)} of {len(looked)} "
            "pictures: was the camera bumped, is it loose, or does it refocus? fix it and switch "
            "its autofocus off, or make a log of each part"
        )
    settled = _middle([looked[number] for number in looked.keys() - off])
    points = np.array([[*layout.points[number], 0.0] for number in settled])
    pose = find_pose(lens, points, np.array([*settled.values()]))
    return PlaneReference(lens, pose, height), off


def _middle(group: Sequence[Marks]) -> dict[int, Array]:
    """The median place of each mark."""
    numbers = sorted({number for marks in group for number in marks})
    return {
        number: np.median([m[number] for m in group if number in m], axis=0)
        for number in numbers
    }


def _is_elsewhere(middle: Marks, marks: Marks) -> bool:
    """Whether marks moved, by the median of them, or grew by a new focus, as a pose cannot tell."""
    usual = np.array([middle[number] for number in marks])
    places = np.array([*marks.values()])
    moved = np.linalg.norm(places - usual, axis=1)
    growth = similarity(usual, places)[2] - 1.0
    is_refocused = (
        abs(growth) > SETTINGS.stretch and moved.max() > SETTINGS.moved
    )
    return bool(np.median(moved) > SETTINGS.moved or is_refocused)
