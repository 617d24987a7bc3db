"""Answer: the fit of all pictures as places with intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.rotations import cross_matrix, quaternion_of
from ..body.belief import Body
from ..body.sensor_pose import SensorPose, held_of
from ..common.arrays import Array, Index, Mask
from ..samples.samples import Samples
from .agreement import agreed, held_out
from .bundle import Layout, bending, follow, rms_by_motion
from .fit import Fit
from .joint_motions import JointMotions
from .lens import Lens
from .notes import limit_of, notes_of
from .pictures import opencv
from .problem import Setting
from .rig import CameraPlace, HandEye, LensFacts, Photo, Place
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
            np.linalg.norm(camera.pixels - seen, axis=1)[
                agreeing[camera.motion]
            ]
            for camera, seen in zip(cameras, problem.predict(fit), strict=True)
        ]
    )
    names = setting.names
    first = setting.views[0]
    board = first.shots.board
    carried, standing = solved.both
    hand, base = solved.places(0)
    measured, half = solved.side()
    places = np.concatenate(solved.layout.frames[[carried, standing]])
    turn, _, _, shift, *_ = fit.noise.error.tolist()
    rig = HandEye(
        eye=first.eye,
        pictures=first.shots.count,
        used=int(agreeing.sum()),
        hand=hand,
        base=base,
        reprojection={"mean": float(off.mean()), "max": float(off.max())},
        lens=solved.lens_facts(0),
        limited_by="",
        notes=(),
        repeatability={"position": shift, "rotation": turn},
        square={
            "said": board.side,
            "measured": measured,
            "interval": [measured - half, measured + half],
        },
        board={"text": board.text, "points": solved.board_points().tolist()},
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
        flange=problem.bundle.motions.poses(
            fit.unknowns.values[solved.layout.arm]
        ),
        misses=misses,
        covariance=fit.covariance[np.ix_(places, places)],
        photo=solved.photo(pixels[0]),
        body=solved.body(0),
    )
    rig = replace(rig, limited_by=limit_of(setting, rig, agreeing))
    rig = replace(rig, notes=notes_of(setting, fit, rig, agreeing))
    return replace(rig, poses=solved.log(rig))


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

    @cached_property
    def half_width(self) -> float:
        """How many sd a 95 % interval is to each side."""
        from scipy.special import stdtrit

        problem = self.setting.problem
        if self.setting.arm and self.fit.freedom < problem.count:
            return 1.96  # the joints are as good as exact
        return float(stdtrit(max(self.fit.freedom, 3.0), 0.975))

    @cached_property
    def both(self) -> tuple[int, int]:
        """Frames of what is in the hand and what stands still, of the first camera."""
        # the first camera sees the first board
        board = len(self.layout.lenses)
        return (0, board) if self.setting.views[0].in_hand else (board, 0)

    @cached_property
    def shape(self) -> Index:
        """The shape of the first camera's board."""
        return np.asarray(self.layout.shapes[0])

    def body(self, camera: int) -> Body | None:
        """What joints and one camera tell, as a belief; None of flange poses."""
        motions = self.setting.problem.bundle.motions
        if not isinstance(motions, JointMotions):
            return None
        in_hand = self.setting.views[camera].in_hand
        return motions.body(self.fit, self.layout, camera, in_hand)

    def places(self, camera: int) -> tuple[Place, Place]:
        """What is in the hand and what stands still, of a camera in joints' terms if there are."""
        body = self.body(camera)
        if body is None:
            carried, standing = self.both
            return self.place(carried), self.place(standing)
        return self._gauged(held_of(body)), self._gauged(SensorPose.of(body))

    def camera_place(self, number: int) -> CameraPlace:
        """One camera."""
        views = self.setting.views
        view = views[number]
        place = self.place(number)
        if self.setting.arm is not None:
            hand, base = self.places(number)
            place = hand if view.in_hand else base
        first = [other.in_hand for other in views].index(view.in_hand)
        return CameraPlace(
            name=view.name,
            eye=view.eye,
            place=place,
            lens=self.lens_facts(number),
            from_first=None if first == number else self.between(first, number),
        )

    def place(self, number: int) -> Place:
        """A frame with its intervals, along the axes of its parent."""
        pose = self.fit.unknowns.frames[number]
        places = self.layout.frames[number]
        turn = np.eye(6)
        turn[:3, :3] = pose[:3, :3]
        return self._place(pose, turn, places)

    def between(self, first: int, second: int) -> Place:
        """A camera in the frame of another."""
        one = self.fit.unknowns.frames[first]
        two = self.fit.unknowns.frames[second]
        pose = inverse(one) @ two
        slope = np.concatenate(
            [follow(np.eye(4), one, inverted=True), follow(inverse(one), two)],
            axis=1,
        )
        slope[3:] -= cross_matrix(pose[:3, 3]) @ slope[:3]
        return self._place(
            pose, slope, np.concatenate(self.layout.frames[[first, second]])
        )

    def _place(self, pose: Array, slope: Array, places: Index) -> Place:
        """A pose whose turn and shift follow some unknowns by a slope (6, k)."""
        covariance = (
            slope @ self.fit.covariance[np.ix_(places, places)] @ slope.T
        )
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        quaternion = quaternion_of(pose[None, :3, :3])[0]
        return self._document(
            pose[:3, 3], quaternion, sd[3:], sd[:3], sd[3:], sd[:3]
        )

    def _gauged(self, place: SensorPose | None) -> Place:
        """A place that joints tell but for what no picture tells of the first and last axis."""
        assert place is not None  # noqa: S101 - the arm has a drawing
        return self._document(
            place.position,
            place.quaternion,
            place.position_sd,
            place.turn_sd,
            place.told_sd,
            place.told_turn_sd,
        )

    def _document(
        self, position: Array, quaternion: Array, *sds: Array
    ) -> Place:
        names = ("position_95", "rotation_95")
        ends = (*names, *(f"{name}_up_to_gauge" for name in names))
        document = {
            "position": position.tolist(),
            "quaternion": quaternion.tolist(),
        }
        for name, sd in zip(ends, sds, strict=True):
            document[name] = (self.half_width * sd).tolist()
        return document

    def lens(self, number: int) -> Lens:
        """The lens of a camera."""
        places = self.layout.lenses[number]
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
            "focal_95": float(halves[:2].mean()),
            "known": self.setting.views[number].given is not None,
            "matrix": lens.matrix.tolist(),
            "distortion": lens.distortion.tolist(),
            "size": list(lens.size),
        }

    def side(self) -> tuple[float, float]:
        """The side of a square, or a tag, and half of its interval [m]."""
        place = self.shape[-1]
        size = float(np.exp(self.fit.unknowns.values[place]))
        measured = self.setting.views[0].shots.board.side * size
        sd = float(np.sqrt(self.fit.covariance[place, place]))
        return measured, self.half_width * measured * sd

    def board_points(self) -> Array:
        """The first camera's board: corners (n, 3) as fitted, in its frame [m]."""
        points = self.setting.views[0].shots.board.points()
        shape = self.fit.unknowns.values[self.shape]
        bent = points + bending(points, points) @ shape[:-1]
        return np.asarray(np.exp(shape[-1]) * bent)

    def photo(self, predicted: Array) -> Photo | None:
        """The first camera's picture with most corners; `predicted` (N, 2) are held out."""
        view = self.setting.views[0]
        if view.shots.largest is None:
            return None
        number, grey = view.shots.largest
        corners = self.setting.problem.bundle.cameras[0]
        motion = np.searchsorted(self.setting.rows, view.rows[number])
        rows = corners.motion == motion
        jpeg = opencv().imencode(".jpg", grey)[1].tobytes()
        name = view.shots.names[number]
        return Photo(name, jpeg, corners.pixels[rows], predicted[rows])

    def log(self, rig: HandEye) -> Samples | None:
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
            source={**log.source, "rig": rig.document()},
        )
