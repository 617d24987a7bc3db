"""Answer: the fit of all pictures as places with intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.rotations import cross_matrix, quaternion_of
from ..body.belief import Body
from ..body.sensor_pose import SensorPose, hand_pose
from ..common.arrays import Array, Index, Mask
from ..samples.samples import Samples
from .agreement import agreed, held_out
from .bundle import bending, follow
from .fit import Fit
from .joint_motions import JointMotions
from .lens import Lens
from .notes import limit_of, notes_of
from .problem import Problem
from .rig import CameraPlace, HandEye, LensFacts, Place
from .rigid import inverse, shift_of, turn_of


def answer(problem: Problem, frames: tuple[str, str]) -> HandEye:
    """Fit the pictures, and tell where all is; `frames` are the names of base and flange.

    Raises LogError where too few pictures agree.
    """
    fit, agreeing = agreed(problem)
    solved = Solved(problem, fit, agreeing)
    bundle = problem.bundle
    layout = bundle.layout
    misses = bundle.misses(held_out(problem, fit, agreeing))
    residuals = bundle.pixels - problem.predict(fit)
    used_corners = agreeing[bundle.motion]
    off = np.linalg.norm(residuals[used_corners], axis=1)
    rms = float(np.sqrt(np.mean(misses[agreeing] ** 2)))
    first = problem.views[0]
    choice = problem.choice
    carried, standing = solved.frames(0)
    hand, base = solved.places(0)
    values = fit.unknowns.values
    place = layout.shapes[0, -1]
    measured = first.board.side * float(np.exp(values[place]))
    half = solved.half_width * measured * float(solved.sd[place])
    cameras = range(len(problem.views))
    places = np.concatenate(layout.frames[[carried, standing]])
    turn, _, _, shift, *_ = fit.noise.error.tolist()
    rig = HandEye(
        eye=first.eye,
        pictures=first.shots.count,
        used=int(agreeing[problem.motions_of(first)].sum()),
        hand=hand,
        base=base,
        reprojection={"mean": float(off.mean()), "max": float(off.max())},
        lens=solved.lens_facts(0),
        limited_by="",
        notes=(),
        repeatability={"position": shift, "rotation": turn},
        square={
            "said": first.board.side,
            "measured": measured,
            "interval": [measured - half, measured + half],
        },
        board={"text": first.board.text, "points": solved.board().tolist()},
        held_out={"rms": rms},
        left_out=problem.pictures_at(~agreeing),
        cameras=tuple(map(solved.camera, cameras)),
        convention=None if choice is None else choice.convention,
        frames=frames,
        names=problem.names,
        flange=bundle.motions.poses(values[layout.arm]),
        misses=misses,
        covariance=fit.covariance[np.ix_(places, places)],
        body=solved.body(0),
    )
    rig = replace(
        rig,
        limited_by=limit_of(problem, rig, agreeing),
        notes=notes_of(problem, fit, rig, agreeing),
    )
    return replace(rig, poses=solved.log(rig))


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit of pictures, and what it says of each camera and board."""

    problem: Problem
    fit: Fit
    agreeing: Mask  # (n,), motions that the fit rests on

    @cached_property
    def half_width(self) -> float:
        """How many sd a 95 % interval is to each side."""
        from scipy.special import stdtrit

        if self.problem.arm and self.fit.freedom < len(self.agreeing):
            return 1.96  # the joints are as good as exact
        return float(stdtrit(max(self.fit.freedom, 3.0), 0.975))

    @cached_property
    def sd(self) -> Array:
        """Sd (s,) of the unknowns."""
        return np.sqrt(np.maximum(np.diag(self.fit.covariance), 0.0))

    def frames(self, camera: int) -> tuple[int, int]:
        """Frames of what is in the hand and what stands still, of a camera and its board."""
        bundle = self.problem.bundle
        board = len(bundle.in_hand) + bundle.boards[camera]
        return (camera, board) if bundle.in_hand[camera] else (board, camera)

    def body(self, camera: int) -> Body | None:
        """What joints and one camera tell, as a belief; None of flange poses."""
        bundle = self.problem.bundle
        if not isinstance(bundle.motions, JointMotions):
            return None
        frames = self.frames(camera)
        return bundle.motions.body(self.fit, bundle.layout, *frames)

    def places(self, camera: int) -> tuple[Place, Place]:
        """What is in the hand and what stands still, of a camera in joints' terms if there are."""
        body = self.body(camera)
        if body is not None:
            hand = self._gauged(hand_pose(body))
            return hand, self._gauged(SensorPose.of(body))
        carried, standing = self.frames(camera)
        return self._place(carried), self._place(standing)

    def camera(self, number: int) -> CameraPlace:
        """One camera."""
        views = self.problem.views
        view = views[number]
        hand, base = self.places(number)
        camera = CameraPlace(name=view.name, eye=view.eye)
        camera[view.eye] = hand if view.in_hand else base
        camera["lens"] = self.lens_facts(number)
        first = [other.in_hand for other in views].index(view.in_hand)
        if first != number:
            camera["from_first"] = self._between(first, number)
        return camera

    def _place(self, number: int) -> Place:
        """A frame with its intervals, along the axes of its parent."""
        pose = self.fit.unknowns.frames[number]
        slope = np.eye(6)
        slope[:3, :3] = turn_of(pose)
        return self._moving(pose, slope, [number])

    def _between(self, first: int, second: int) -> Place:
        """A camera in the frame of another."""
        one, two = self.fit.unknowns.frames[[first, second]]
        to_first = inverse(one)
        pose = to_first @ two
        by_one = follow(np.eye(4), one, inverted=True)
        by_two = follow(to_first, two)
        slope = np.concatenate([by_one, by_two], axis=1)
        slope[3:] -= cross_matrix(shift_of(pose)) @ slope[:3]
        return self._moving(pose, slope, [first, second])

    def _moving(self, pose: Array, slope: Array, frames: list[int]) -> Place:
        """A pose whose turn and shift follow some frames by a slope (6, k)."""
        places = np.concatenate(self.problem.bundle.layout.frames[frames])
        covariance = self.fit.covariance[np.ix_(places, places)]
        variances = np.diag(slope @ covariance @ slope.T)
        turn, shift = np.sqrt(np.maximum(variances, 0.0)).reshape(2, 3)
        quaternion = quaternion_of(turn_of(pose[None]))[0]
        place = shift_of(pose)
        return self._document(place, quaternion, shift, turn, shift, turn)

    def _gauged(self, place: SensorPose | None) -> Place:
        """A place that joints tell but for what no picture tells of the first and last axis."""
        assert place is not None  # noqa: S101 - the arm has a drawing
        return self._document(
            place.position,
            place.quaternion,
            place.position_sd,
            place.turn_sd,
            place.position_sd_up_to_gauge,
            place.turn_sd_up_to_gauge,
        )

    def _document(
        self, position: Array, quaternion: Array, *sds: Array
    ) -> Place:
        shift, turn, sure_shift, sure_turn = self.half_width * np.array(sds)
        return {
            "position": position.tolist(),
            "quaternion": quaternion.tolist(),
            "position_95": shift.tolist(),
            "rotation_95": turn.tolist(),
            "position_95_up_to_gauge": sure_shift.tolist(),
            "rotation_95_up_to_gauge": sure_turn.tolist(),
        }

    def lens(self, number: int) -> Lens:
        """The lens of a camera."""
        places: Index = self.problem.bundle.layout.lenses[number]
        size = self.problem.views[number].shots.size
        rms = float(np.sqrt(2.0) * self.fit.noise.corner[number])
        lens = Lens.of(size, self.fit.unknowns.values[places], rms)
        covariance = self.fit.covariance[np.ix_(places, places)]
        return replace(lens, covariance=covariance)

    def lens_facts(self, number: int) -> LensFacts:
        """The lens as JSON, with half-widths of 95 % intervals."""
        lens = self.lens(number)
        sd = self.sd[self.problem.bundle.layout.lenses[number, :2]]
        return {
            "focal": float(lens.focal.mean()),
            "centre": lens.centre.tolist(),
            "focal_95": self.half_width * float(sd.mean()),
            "known": self.problem.views[number].given is not None,
            "matrix": lens.matrix.tolist(),
            "distortion": lens.distortion.tolist(),
            "size": list(lens.size),
        }

    def board(self) -> Array:
        """The first camera's board: corners (n, 3) as fitted, in its frame [m]."""
        points = self.problem.views[0].board.points()
        shape = self.fit.unknowns.values[self.problem.bundle.layout.shapes[0]]
        bent = points + bending(points, points) @ shape[:-1]
        return np.asarray(np.exp(shape[-1]) * bent)

    def log(self, rig: HandEye) -> Samples | None:
        """The first camera's pictures as a log of poses that knows the rig; None without joints."""
        arm = self.problem.arm
        if arm is None:
            return None
        view = self.problem.views[0]
        log = view.shots.log(self.lens(0), view.in_hand)
        log = log.take(self.agreeing[self.problem.motions_of(view)])
        return replace(
            log,
            lower=np.minimum(arm.lower, log.lower),
            upper=np.maximum(arm.upper, log.upper),
            revolute=arm.revolute,
            arm=arm,
            notes=(),
            source={**log.source, "rig": rig.document()},
        )
