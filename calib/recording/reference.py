"""Reference: marks at known places of a desk, and the frame of positions in metres.

Each recording determines the frame before the camera (`find_reference`); then rays of pixels are
intersected with a plane of it (`PlaneReference`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arm.rigid import inverse, rigid, shift_of, turn_of
from ..arm.rotations import cross_matrix, exponential, similarity
from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.rows import row_lengths
from ..errors import LogError
from ..samples.lens import Lens
from ..samples.tables import open_source
from .pictures import opencv


@dataclass(frozen=True)
class ReferenceSettings:
    """When a reference has not moved."""

    noise: float = 0.01  # least one of a corner [px]
    moved: float = 0.7  # distance beyond which marks are elsewhere [px]
    stretch: float = 1.5e-3  # growth of the marks that shows a new focus
    # share of the pictures in which the marks may be elsewhere
    elsewhere: float = 0.3


REFERENCE = ReferenceSettings()

Marks = Mapping[int, Array]
"""Places (2,) by number, in a picture [px] or a layout [m]: of corners, or of tags' centres."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is before a camera."""

    frame: Array  # (4, 4), in the camera's (x right, y down, z ahead) [m]
    # (15, 15), of a small turn [rad] about the camera's axes, of the shift [m], and of the lens's
    # parameters
    covariance: Array


def frames_of(poses: Sequence[Pose]) -> Array:
    """Frames (n, 4, 4) [m] of some poses."""
    return np.array([pose.frame for pose in poses])


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
    # an error of the lens changes the pose
    by_lens = slopes[:, 6:15]
    pose_by_lens = -np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
    follows = np.vstack([pose_by_lens, np.eye(9)])
    covariance = follows @ lens.covariance @ follows.T
    freedom = max(len(by_pose) - 6, 1)
    square = float((residuals**2).sum())
    variance = max(square / freedom, REFERENCE.noise**2)
    covariance[:6, :6] += np.linalg.pinv(by_pose.T @ by_pose) * variance
    return Pose(rigid(rotation, shift.ravel()), covariance)


@dataclass(frozen=True, eq=False)
class PlaneReference:
    """A flat frame before a calibrated camera, whose rays meet the plane of the tip's tag."""

    lens: Lens
    pose: Pose
    height: float = 0.0  # z of the tag's plane in the frame [m]

    @property
    def camera(self) -> Array:
        """The camera's place in the frame (3,) [m]."""
        return shift_of(inverse(self.pose.frame))

    def positions(self, pixels: ArrayLike) -> Array:
        """Return x and y (n, 2) [m] where rays of pixels (n, 2) meet the plane, else NaN."""
        flat = self.lens.undistort(pixels)
        camera = self.camera
        rays = np.c_[flat, np.ones(len(flat))] @ turn_of(self.pose.frame)
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = (self.height - camera[2]) / rays[:, 2:]
            places = camera[:2] + lengths * rays[:, :2]
        return np.where(lengths > 0.0, places, np.nan)

    def noise(self, pixels: Array) -> tuple[Array, Array]:
        """Noise of positions at pixels (n, 2), along one axis of the plane.

        Returns the size of a pixel (n,) [m/px], and the sd (n,) [m] that the errors of pose and
        lens, which all rows share, make there.
        """
        places = self.positions(pixels)

        # a pixel: half a step along each axis of the picture
        half_steps = np.eye(2) / 2
        moves = [self.positions(pixels + step) - places for step in half_steps]
        scale = np.sqrt(2.0 * np.square(moves).sum(axis=(0, 2)))

        # pose and lens: a step of one sd along each axis of their covariance
        variance = np.zeros(len(pixels))
        values, vectors = np.linalg.eigh(self.pose.covariance)
        sds = np.sqrt(np.maximum(values, 0.0))
        for step in (vectors * sds).T:
            move = self._after(step).positions(pixels) - places
            variance += (move**2).sum(axis=1) / 2.0
        return scale, np.sqrt(variance)

    def _after(self, step: Array) -> PlaneReference:
        """The reference after a step (15,) of the pose's turn and shift, and of the lens."""
        turn, shift, parameters = np.split(step, [3, 6])
        frame = self.pose.frame
        turned = exponential(turn) @ turn_of(frame)
        pose = replace(self.pose, frame=rigid(turned, shift_of(frame) + shift))
        return replace(self, lens=self.lens.plus(parameters), pose=pose)

    def to_json(self) -> dict[str, object]:
        """Return the camera's pose over the frame, as plain values."""
        return {
            "kind": "plane",
            "rotation": turn_of(self.pose.frame).tolist(),
            "camera": self.camera.tolist(),
            "height": self.height,
        }


@dataclass(frozen=True, eq=False)
class MarkLayout:
    """Marks at known places of a flat frame: a board's corners, or tags on a desk."""

    what: str  # what messages call it
    points: Marks  # places by number (2,) [m]
    least: int  # marks that must be seen

    @staticmethod
    def read(path: FilePath) -> MarkLayout:
        """Read tags at known places: a table with the columns `tag`, `x`, `y` [m].

        Raises LogError if there are fewer than four, or a tag has two places.
        """
        source = open_source(path)
        rows = source.numbers(["tag", "x", "y"])
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


def find_reference(
    layout: MarkLayout,
    sightings: Mapping[int, Marks],
    lens: Lens,
    height: float = 0.0,
) -> tuple[PlaneReference, frozenset[int]]:
    """The reference of a recording, and the numbers of pictures in which it is elsewhere.

    sightings : the marks [px] that pictures show, by the pictures' numbers
    height : of the tag's plane over the layout's [m]
    Raises LogError if the reference is not there, or elsewhere in many pictures.
    """
    # a hand in the picture hides some marks
    complete = {
        number: marks
        for number, marks in sightings.items()
        if len(marks) >= layout.least
    }
    if not complete:
        most = max(map(len, sightings.values()), default=0)
        raise LogError(
            f"{layout.what} is too small, hidden or not there: at most {most} found in a picture, "
            f"{layout.least} expected"
        )
    usual = _median_marks([*complete.values()])
    elsewhere = frozenset(
        number
        for number, marks in complete.items()
        if _is_elsewhere(usual, marks)
    )
    if len(elsewhere) > REFERENCE.elsewhere * len(complete):
        raise LogError(
            f"{layout.what} is elsewhere, or of another size, in {len(elsewhere)} of "
            f"{len(complete)} pictures: was the camera bumped, is it loose, or does it refocus? "
            "fix it and switch its autofocus off, or make a log of each part"
        )

    # the pose of the frame, by the median of each mark
    steady = complete.keys() - elsewhere
    marks = _median_marks([complete[number] for number in steady])
    points = np.array([[*layout.points[number], 0.0] for number in marks])
    pixels = np.array([*marks.values()])
    pose = find_pose(lens, points, pixels)
    return PlaneReference(lens, pose, height), elsewhere


def _median_marks(group: Sequence[Marks]) -> dict[int, Array]:
    """The median place of each mark."""
    numbers = sorted({number for marks in group for number in marks})
    return {
        number: np.median([m[number] for m in group if number in m], axis=0)
        for number in numbers
    }


def _is_elsewhere(usual: Marks, marks: Marks) -> bool:
    """Whether marks moved, by their median, or grew by a new focus, which no pose explains."""
    usual_places = np.array([usual[number] for number in marks])
    places = np.array([*marks.values()])
    moved = row_lengths(places - usual_places)
    growth = similarity(usual_places, places)[2] - 1.0
    is_refocused = (
        abs(growth) > REFERENCE.stretch and moved.max() > REFERENCE.moved
    )
    return bool(np.median(moved) > REFERENCE.moved or is_refocused)
