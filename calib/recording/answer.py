"""Answer: the fit of all pictures as places with intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.rotations import cross_matrix, quaternion_of
from ..body.belief import Body
from ..body.corners import held_of
from ..body.sensor_pose import SensorPose
from ..common.arrays import Array, Mask
from ..samples.samples import Samples
from .agreement import agreed, held_out
from .bundle import Layout, bending, rms_by_motion
from .fit import Fit
from .joint_motions import JointMotions
from .lens import Lens
from .notes import limit_of, notes_of
from .pictures import opencv
from .problem import Setting
from .rig import CameraPlace, HandEye, LensFacts, Photo, Place, Square
from .rigid import inverse


def answer(setting: Setting, frames: tuple[str, str]) -> HandEye:
    """Fit the pictures, and tell where all is; `frames` are the names of base and flange.

    Raises LogError where too few pictures agree.
    """
    problem = setting.problem
    fit, agreeing = agreed(problem)
    solved = Solved(setting, fit, agreeing)
    cameras = problem.bundle.cameras
    pixels = held_out(problem, fit, agreeing)
    misses = rms_by_motion(cameras, pixels)
    off = np.concatenate(
        [
            np.linalg.norm(camera.pixels - predicted, axis=1)[
                agreeing[camera.motion]
            ]
            for camera, predicted in zip(
                cameras, problem.predict(fit), strict=True
            )
        ]
    )
    names = setting.names
    hand, base = solved.both_places()
    first = setting.views[0]
    rig = HandEye(
        eye="hand" if first.in_hand else "base",
        pictures=first.shots.count,
        used=int(agreeing.sum()),
        hand=hand,
        base=base,
        reprojection={"mean": float(off.mean()), "max": float(off.max())},
        lens=solved.lens_facts(0),
        limited_by="",
        notes=(),
        repeatability={"position": fit.noise.shift, "rotation": fit.noise.turn},
        square=solved.square(),
        board={
            "text": first.shots.board.text,
            "points": solved.board_points().tolist(),
        },
        held_out={
            "rms": float(np.sqrt(np.mean(misses[agreeing] ** 2))),
            "median": float(np.median(misses[agreeing])),
        },
        left_out=tuple(names[k] for k in np.flatnonzero(~agreeing)),
        cameras=tuple(map(solved.camera_place, range(len(cameras)))),
        convention=None
        if setting.choice is None
        else setting.choice.convention,
        frames=frames,
        names=tuple(names),
        flange=solved.flange,
        misses=misses,
        covariance=solved.both_covariance(),
        photo=solved.photo(pixels[0]),
        body=solved.body(0),
    )
    rig = replace(rig, limited_by=limit_of(setting, rig, agreeing))
    rig = replace(rig, notes=notes_of(setting, fit, rig, agreeing))
    return replace(rig, poses=solved.log(rig.document()))


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit of pictures, and what it says of each camera and board."""

    setting: Setting
    fit: Fit
    agreeing: Mask  # (n,), motions that the fit rests on

    @property
    def layout(self) -> Layout:
        """Where the unknowns stand."""
        return self.setting.problem.bundle.layout

    @property
    def flange(self) -> Array:
        """The flange in the base at each motion (n, 4, 4) [m]."""
        arm = self.fit.unknowns.values[self.layout.arm_values]
        return self.setting.problem.bundle.motions.poses(arm)

    @cached_property
    def half_width(self) -> float:
        """How many sd a 95 % interval is to each side."""
        from scipy.special import stdtrit

        motions = self.setting.problem.bundle.motions
        if (
            isinstance(motions, JointMotions)
            and self.fit.freedom < motions.count
        ):
            return 1.96  # the joints are as good as exact
        return float(stdtrit(max(self.fit.freedom, 3.0), 0.975))

    def body(self, camera: int) -> Body | None:
        """What joints and one camera tell, as a belief; None of flange poses."""
        motions = self.setting.problem.bundle.motions
        if not isinstance(motions, JointMotions):
            return None
        in_hand = self.setting.views[camera].in_hand
        return motions.body(self.fit, self.layout, camera, in_hand)

    def carried_and_standing(self) -> tuple[int, int]:
        """Numbers of the frames of what is in the hand and what stands still."""
        in_hand = self.setting.views[0].in_hand
        board = self.layout.cameras + self.layout.board_of(in_hand)
        return (0, board) if in_hand else (board, 0)

    def both_covariance(self) -> Array:
        """Covariance (12, 12) of turn and shift of the hand's and the base's frame."""
        places = np.concatenate(
            [
                self.layout.frame(number)
                for number in self.carried_and_standing()
            ]
        )
        return np.asarray(self.fit.covariance[np.ix_(places, places)])

    def both_places(self) -> tuple[Place, Place]:
        """What is in the hand and what stands still, of the first camera."""
        body = self.body(0)
        if body is not None:
            return self._gauged(held_of(body)), self._gauged(
                SensorPose.of(body)
            )
        carried, standing = self.carried_and_standing()
        return self.place(carried), self.place(standing)

    def camera_place(self, number: int) -> CameraPlace:
        """One camera."""
        views = self.setting.views
        view = views[number]
        body = self.body(number)
        if body is None:
            place = self.place(number)
        else:
            place = self._gauged(
                held_of(body) if view.in_hand else SensorPose.of(body)
            )
        first = [other.in_hand for other in views].index(view.in_hand)
        return CameraPlace(
            name=view.name,
            eye="hand" if view.in_hand else "base",
            place=place,
            lens=self.lens_facts(number),
            from_first=None if first == number else self.between(first, number),
        )

    def place(self, number: int) -> Place:
        """A frame with its intervals, along the axes of its parent."""
        pose = self.fit.unknowns.frames[number]
        places = self.layout.frame(number)
        turn = np.eye(6)
        turn[:3, :3] = pose[:3, :3]
        covariance = turn @ self.fit.covariance[np.ix_(places, places)] @ turn.T
        return self._place(pose, covariance)

    def between(self, first: int, second: int) -> Place:
        """A camera in the frame of another."""
        one = self.fit.unknowns.frames[first]
        pose = inverse(one) @ self.fit.unknowns.frames[second]
        back = one[:3, :3].T
        slope = np.zeros((6, 12))  # by turn and shift of both
        slope[:3, :3] = -np.eye(3)
        slope[:3, 6:9] = pose[:3, :3]
        slope[3:, :3] = cross_matrix(pose[:3, 3])
        slope[3:, 3:6] = -back
        slope[3:, 9:] = back
        places = np.concatenate(
            [self.layout.frame(first), self.layout.frame(second)]
        )
        covariance = (
            slope @ self.fit.covariance[np.ix_(places, places)] @ slope.T
        )
        return self._place(pose, covariance)

    def _place(self, pose: Array, covariance: Array) -> Place:
        halves = self.half_width * np.sqrt(np.maximum(np.diag(covariance), 0.0))
        rotation, position = np.split(halves, 2)
        quaternion = quaternion_of(pose[None, :3, :3])[0]
        return _document(pose[:3, 3], quaternion, position, rotation)

    def _gauged(self, place: SensorPose | None) -> Place:
        """A place that joints tell but for what no picture tells of the first and last axis."""
        assert place is not None  # noqa: S101 - the arm has a drawing
        sizes = (
            place.position_sd,
            place.turn_sd,
            place.told_sd,
            place.told_turn_sd,
        )
        halves = [self.half_width * sd for sd in sizes]
        return _document(place.position, place.quaternion, *halves)

    def lens(self, number: int) -> Lens:
        """The lens of a camera."""
        places = self.layout.lens(number)
        values = self.fit.unknowns.values[places]
        return Lens(
            self.setting.views[number].shots.size,
            values[:2].copy(),
            values[2:4].copy(),
            values[4:].copy(),
            rms=float(np.sqrt(2.0) * self.fit.noise.corner[number]),
            covariance=self.fit.covariance[np.ix_(places, places)],
        )

    def lens_facts(self, number: int) -> LensFacts:
        """The lens as JSON, with half-widths of 95 % intervals."""
        lens = self.lens(number)
        halves = self.half_width * np.sqrt(
            np.maximum(np.diag(lens.covariance), 0.0)
        )
        return {
            "focal": float(lens.focal.mean()),
            "centre": lens.centre.tolist(),
            "k1": float(lens.distortion[0]),
            "focal_95": float(halves[:2].mean()),
            "known": self.setting.views[number].given is not None,
            "matrix": lens.matrix.tolist(),
            "distortion": lens.distortion.tolist(),
            "parameters_95": halves.tolist(),
            "size": list(lens.size),
        }

    def square(self) -> Square:
        """The side of a square, or a tag, of the first camera's board."""
        view = self.setting.views[0]
        stated = view.shots.board.side
        place = self.layout.shape(self.layout.board_of(view.in_hand))[-1]
        measured = stated * float(np.exp(self.fit.unknowns.values[place]))
        sd = measured * float(np.sqrt(self.fit.covariance[place, place]))
        half = self.half_width * sd
        interval = [measured - half, measured + half]
        return {"said": stated, "measured": measured, "interval": interval}

    def board_points(self) -> Array:
        """The first camera's board: corners (n, 3) as fitted, in its frame [m]."""
        view = self.setting.views[0]
        points = view.shots.board.points()
        places = self.layout.shape(self.layout.board_of(view.in_hand))
        shape = self.fit.unknowns.values[places]
        bent = points + bending(points, points) @ shape[:-1]
        return np.asarray(np.exp(shape[-1]) * bent)

    def photo(self, predicted: Array) -> Photo | None:
        """The first camera's picture with most corners; `predicted` (N, 2) are held out."""
        view = self.setting.views[0]
        if view.shots.largest is None:
            return None
        number, grey = view.shots.largest
        corners = self.setting.problem.bundle.cameras[0]
        rows = corners.motion == np.searchsorted(
            self.setting.rows, view.rows[number]
        )
        jpeg = opencv().imencode(".jpg", grey)[1].tobytes()
        name = view.shots.names[number]
        return Photo(name, 0, jpeg, corners.pixels[rows], predicted[rows])

    def log(self, rig: dict[str, Any]) -> Samples | None:
        """The first camera's pictures as a log of poses that knows the rig; None without joints."""
        arm = self.setting.arm
        if arm is None:
            return None
        view = self.setting.views[0]
        agreeing = self.agreeing[np.searchsorted(self.setting.rows, view.rows)]
        log = view.shots.log(self.lens(0), view.in_hand).take(agreeing)
        return replace(
            log,
            lower=np.minimum(arm.lower, log.lower),
            upper=np.maximum(arm.upper, log.upper),
            revolute=arm.revolute,
            arm=arm,
            notes=(),
            source={**log.source, "rig": rig},
        )


def _document(
    position: Array,
    quaternion: Array,
    position_95: Array,
    rotation_95: Array,
    position_95_up_to_gauge: Array | None = None,
    rotation_95_up_to_gauge: Array | None = None,
) -> Place:
    """A place as JSON; without a gauge its intervals hold as they are."""
    if position_95_up_to_gauge is None or rotation_95_up_to_gauge is None:
        position_95_up_to_gauge = position_95
        rotation_95_up_to_gauge = rotation_95
    return {
        "position": position.tolist(),
        "quaternion": quaternion.tolist(),
        "position_95": position_95.tolist(),
        "rotation_95": rotation_95.tolist(),
        "position_95_up_to_gauge": position_95_up_to_gauge.tolist(),
        "rotation_95_up_to_gauge": rotation_95_up_to_gauge.tolist(),
    }
