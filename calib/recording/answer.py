"""Answer: the fit of all pictures as a rig: places with intervals, lenses, a board and a log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arm.rigid import (
    adjoint,
    along_parent,
    inverse,
    rigid,
    shift_of,
    shifts_along_parents,
    turn_of,
)
from ..arm.rotations import quaternion_of
from ..body.covariance import Z95
from ..body.sensor_pose import SensorPose, hand_pose
from ..common.arrays import Array, Index, Mask
from ..common.rows import rms, row_lengths
from ..samples.lens import Lens
from ..samples.samples import Samples
from .agreement import consensus, held_out_misses
from .bundle import CornerLayout, shape_slopes
from .fit import CornerFit
from .joint_motions import ArmBelief, JointMotions
from .notes import limit_of, notes_of
from .problem import Problem
from .rig import CameraPlace, HandEye, LensFacts, Place, Square


def solve_rig(problem: Problem) -> HandEye:
    """The rig that fits the pictures.

    Raises LogError where too few pictures agree.
    """
    fit, agreeing = consensus(problem)
    rig_fit = RigFit(problem, fit, agreeing)
    rig = rig_fit.rig()
    rig = replace(
        rig,
        limited_by=limit_of(problem, rig, agreeing),
        notes=notes_of(problem, fit, rig, agreeing),
    )
    return replace(rig, poses=rig_fit.log(rig))


@dataclass(frozen=True, eq=False)
class RigFit:
    """A fit of pictures, from which the rig is computed: places, lenses and a board."""

    problem: Problem
    fit: CornerFit
    agreeing: Mask  # (n,), motions that the fit rests on

    def rig(self) -> HandEye:
        """The rig without notes and log."""
        problem = self.problem
        bundle = problem.bundle
        first = problem.views[0]
        hand, base = self.places(0)
        # of turn and shift of the hand's frame, then of the base's
        frames = [*self.frame_numbers(0)]
        slope = shifts_along_parents(self.fit.unknowns.frames[frames])
        covariance = slope @ self.frame_covariance(frames) @ slope.T

        # errors of motions, by fits without them
        misses = held_out_misses(problem, self.fit, self.agreeing)
        choice = problem.choice
        noise = self.fit.noise
        return HandEye(
            eye=first.eye,
            pictures=first.count,
            used=int(self.agreeing[first.rows].sum()),
            hand=hand,
            base=base,
            reprojection=self.reprojection(),
            lens=self.lens_facts(0),
            limited_by="",
            notes=(),
            repeatability={"position": noise.shift, "rotation": noise.turn},
            square=self.square(),
            board={"text": first.board.text, "points": self.board().tolist()},
            held_out={"rms": rms(misses[self.agreeing])},
            left_out=problem.pictures_at(~self.agreeing),
            cameras=tuple(map(self.camera, range(len(problem.views)))),
            convention=None if choice is None else choice.convention,
            frames=problem.frames,
            names=problem.names,
            flange=bundle.motions.poses(self.values[self.layout.arm]),
            misses=misses,
            covariance=covariance,
            body=self.body(0),
        )

    @property
    def layout(self) -> CornerLayout:
        """Indices of the unknowns."""
        return self.problem.bundle.layout

    @property
    def values(self) -> Array:
        """Values (s,) of the unknowns."""
        return self.fit.unknowns.values

    def covariance(self, indices: Index) -> Array:
        """Covariance (k, k) of some unknowns."""
        return self.fit.covariance[np.ix_(indices, indices)]

    def frame_covariance(self, numbers: list[int]) -> Array:
        """Covariance (6 k, 6 k) of steps of some frames (k,)."""
        return self.covariance(self.layout.frames[numbers].ravel())

    @cached_property
    def half_width(self) -> float:
        """Half the width of a 95 % interval [sd]."""
        from scipy.special import stdtrit

        if self.problem.arm and self.fit.freedom < len(self.agreeing):
            return Z95  # the joints are as good as exact
        return float(stdtrit(max(self.fit.freedom, 3.0), 0.975))

    def reprojection(self) -> dict[str, float]:
        """Mean and largest error of the corners that the fit rests on [px]."""
        bundle = self.problem.bundle
        residuals = bundle.pixels - self.problem.predict(self.fit)
        distances = row_lengths(residuals[self.agreeing[bundle.motion]])
        return {"mean": float(distances.mean()), "max": float(distances.max())}

    def square(self) -> Square:
        """The side of the first board's squares, as stated and as measured [m]."""
        stated = self.problem.views[0].board.side
        size = self.layout.shapes[0, -1:]
        measured = stated * float(np.exp(self.values[size[0]]))
        sd = float(np.sqrt(self.covariance(size)[0, 0]))
        half = self.half_width * measured * sd
        return {
            "said": stated,
            "measured": measured,
            "interval": [measured - half, measured + half],
        }

    def frame_numbers(self, camera: int) -> tuple[int, int]:
        """Numbers of the frames of a camera and its board, that in the hand first."""
        bundle = self.problem.bundle
        numbers = bundle.frame_numbers(camera)
        return numbers if bundle.in_hand[camera] else numbers[::-1]

    def body(self, camera: int) -> ArmBelief | None:
        """The belief on the arm with one camera; None of flange poses."""
        motions = self.problem.bundle.motions
        if not isinstance(motions, JointMotions):
            return None
        return motions.body(self.fit, self.layout, *self.frame_numbers(camera))

    def places(self, camera: int) -> tuple[Place, Place]:
        """Places of what is in the hand and of what is at rest, of one camera and its board."""
        body = self.body(camera)
        base = SensorPose.of(body)
        if body is None or base is None:
            hand_frame, base_frame = self.frame_numbers(camera)
            return self.frame_place(hand_frame), self.frame_place(base_frame)
        return self._sensor_place(hand_pose(body)), self._sensor_place(base)

    def camera(self, number: int) -> CameraPlace:
        """One camera, with its place in the frame of the first camera of its eye."""
        views = self.problem.views
        view = views[number]
        hand, base = self.places(number)
        camera = CameraPlace(name=view.name, eye=view.eye)
        camera[view.eye] = hand if view.in_hand else base
        camera["lens"] = self.lens_facts(number)
        first = [other.in_hand for other in views].index(view.in_hand)
        if first != number:
            camera["from_first"] = self.frame_place(number, first)
        return camera

    def frame_place(self, number: int, parent: int | None = None) -> Place:
        """A frame with its intervals, along the axes of its parent or of another frame."""
        pose = self.fit.unknowns.frames[number]
        steps = np.eye(6)
        numbers = [number]
        if parent is not None:
            pose = inverse(self.fit.unknowns.frames[parent]) @ pose
            steps = np.hstack([-adjoint(inverse(pose)), steps])
            numbers = [parent, number]
        slope = along_parent(pose) @ steps
        variances = np.diag(slope @ self.frame_covariance(numbers) @ slope.T)
        turn, shift = np.split(np.sqrt(np.maximum(variances, 0.0)), 2)
        sd = np.concatenate([shift, turn])
        return self._place(pose, sd, sd)

    def _sensor_place(self, place: SensorPose) -> Place:
        """A place by joints; `up_to_gauge` leaves out turns about the first and the last axis."""
        pose = rigid(place.rotation, place.position)
        return self._place(pose, place.sd, place.sd_up_to_gauge)

    def _place(self, pose: Array, sd: Array, sd_up_to_gauge: Array) -> Place:
        """A pose (4, 4) [m] as JSON; sds (6,) are of shift and turn along the parent's axes."""
        place = {
            "position": shift_of(pose).tolist(),
            "quaternion": quaternion_of(turn_of(pose)).tolist(),
        }
        for which, sds in (("", sd), ("_up_to_gauge", sd_up_to_gauge)):
            shift, turn = np.split(self.half_width * sds, 2)
            place[f"position_95{which}"] = shift.tolist()
            place[f"rotation_95{which}"] = turn.tolist()
        return place

    def lens(self, number: int) -> Lens:
        """The lens of a camera."""
        indices = self.layout.lenses[number]
        size = self.problem.views[number].size
        distance = float(np.sqrt(2.0) * self.fit.noise.corner[number])
        lens = Lens.of(size, self.values[indices], distance)
        return replace(lens, covariance=self.covariance(indices))

    def lens_facts(self, number: int) -> LensFacts:
        """The lens as JSON, with half-widths of 95 % intervals."""
        lens = self.lens(number)
        sd = np.sqrt(np.diag(lens.covariance)[:2])
        return {
            "focal": float(lens.focal.mean()),
            "centre": lens.centre.tolist(),
            "focal_95": self.half_width * float(sd.mean()),
            "known": self.problem.views[number].stated_lens is not None,
            "matrix": lens.matrix.tolist(),
            "distortion": lens.distortion.tolist(),
            "size": list(lens.size),
        }

    def board(self) -> Array:
        """The first camera's board: corners (n, 3) as fitted, in its frame [m]."""
        points = self.problem.views[0].board.points()
        *bends, size = self.values[self.layout.shapes[0]]
        bent = points + shape_slopes(points) @ bends
        return np.asarray(np.exp(size) * bent)

    def log(self, rig: HandEye) -> Samples | None:
        """The first camera's pictures as a log of poses, with the rig; None without joints."""
        arm = self.problem.arm
        if arm is None:
            return None
        view = self.problem.views[0]
        log = view.log(self.lens(0), view.eye)
        log = log.take(self.agreeing[view.rows])
        return replace(
            log,
            lower=np.minimum(arm.lower, log.lower),
            upper=np.maximum(arm.upper, log.upper),
            revolute=arm.revolute,
            arm=arm,
            notes=(),
            source={**log.source, "rig": rig.document()},
        )
