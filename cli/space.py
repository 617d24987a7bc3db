"""Space: questions to an arm in space that are asked in a frame, with an orientation, on a plane.

This file is imported only for such questions: it needs NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arm.rotations import matrix_of, quaternion_of
from calib.common.arrays import Array
from calib.errors import QueryError
from calib.inverse.pose import Reached
from calib.inverse.self_motions import free_directions
from calib.model.poses import described, first_of
from calib.model.space import Space
from calib.samples.roles import QUATERNION, from_angles

from .batch import UP_TO_SCALE
from .output import note, show_json
from .units import JointFormat, answers, meaning, show_answers
from .usage import BadOption

if TYPE_CHECKING:
    from calib import Model

_TOGETHER = 0.05  # of the largest share: joints that move less are not named


@dataclass(frozen=True)
class Asked:
    """What was asked besides the numbers."""

    frame: str  # ``"sensor"`` or ``"base"``
    # the orientation wanted
    quaternion: Sequence[float] | None = None
    rpy: Sequence[float] | None = None
    keep: bool = False  # whether the orientation at `near` is kept softly
    height: float | None = None  # [m], of the plane z of the base frame that a pixel lies on

    def orientation(self, degrees: bool) -> Array | None:
        """The quaternion (4,) wanted, checked."""
        if self.quaternion is not None and self.rpy is not None:
            raise BadOption("--quaternion and --rpy are given: expected one of them")
        if self.quaternion is not None:
            if len(self.quaternion) != 4:
                raise BadOption(f"--quaternion has {len(self.quaternion)} numbers: expected 4")
            length = float(np.linalg.norm(self.quaternion))
            if abs(length - 1) > 0.01:
                shown = f"of length {length:.4g}: expected length 1, in the order qx,qy,qz,qw"
                raise BadOption(f"--quaternion is {shown}")
            # typed numbers are rounded: the unit sphere's nearest point is meant
            return np.array([float(part) / length for part in self.quaternion])
        if self.rpy is None:
            return None
        if len(self.rpy) != 3:
            raise BadOption(f"--rpy has {len(self.rpy)} numbers: expected roll, pitch and yaw")
        angles = np.array([self.rpy])
        return np.asarray(from_angles(np.deg2rad(angles) if degrees else angles)[0])


def answer_inverse(
    model: Model,
    joints: JointFormat,
    asked: Asked,
    typed: Sequence[float],
    near: Sequence[float] | None,
    *,
    every: bool,
    as_json: bool,
) -> int:
    """Print the joints for a question in space; return the exit code."""
    space = Space.of(model)
    wanted = turn = asked.orientation(joints.degrees)
    if turn is not None and asked.keep:
        raise BadOption("--keep-orientation keeps that of --near: expected no orientation too")
    if asked.keep and near is None:
        raise BadOption("--keep-orientation keeps the orientation at --near: expected --near too")
    in_base = asked.frame == "base" or asked.height is not None
    target = _target(space, asked, typed)
    if turn is not None:
        rotation = matrix_of(turn[None])
        if not in_base:
            rotation = space.to_base(target[None], rotation)[1]
        found = space.reach_pose(target, rotation[0], near)
    else:
        found = space.reach_position(target, near, keep=asked.keep)
    frame = "base" if in_base else "sensor"
    told = described(space, [found if every else first_of(found)], frame)
    names = ("position", "quaternion", "distance", "turned", "expected_error", "model_error")
    bounds = up_to_scale(space, told.q) if in_base else {}
    solutions = answers(joints, told.q, **{name: getattr(told, name) for name in names}, **bounds)
    # a target that is missed has no answer to move away from
    free = space.free(found.q[0], 6 if turn is not None else 3)[: 9 if found.reachable else 0]
    if as_json:
        document: dict[str, Any] = {"target": list(typed), "frame": frame}
        if asked.height is not None:
            document["on_plane"] = {"z": asked.height, "position": target.tolist(), "unit": "m"}
        if wanted is not None:
            document["quaternion"] = wanted.tolist()
        document |= {
            "reachable": found.reachable,
            "solutions": solutions,
            "free": [dict(zip(joints.names, row, strict=True)) for row in free],
            **meaning(model.about, frame),
        }
        show_json(document)
    else:
        if asked.height is not None:
            x, y, z = 1e3 * target
            note(f"the pixel shows ({x:.2f}, {y:.2f}, {z:.2f}) mm of the base frame")
        shown = ["distance", *(["turned"] if turn is not None else []), "expected_error"]
        unit = "m" if in_base else model.about.unit
        show_answers(joints, solutions, unit, "xyz", shown)
    if UP_TO_SCALE in bounds:
        say_size(float(bounds[UP_TO_SCALE][0]))
    if in_base and not space.sees(target).all():
        note("the camera's picture does not show the target")
    if not found.reachable:
        _say_missed(found, len(joints.names), posed=turn is not None)
        return 3
    say_free(joints, free, near is not None)
    return 0


def _target(space: Space, asked: Asked, typed: Sequence[float]) -> Array:
    if asked.height is not None:
        if len(typed) != 2:
            raise BadOption(f"--on needs a pixel: expected U V, not {len(typed)} numbers")
        return np.asarray(space.pixels_on_plane(typed, asked.height)[0])
    if asked.frame == "sensor" and space.camera:
        raise QueryError(
            "a pixel alone is no position in space: say on which plane it lies, --on z=H, or give "
            "a position X Y Z [m] with --in base"
        )
    if len(typed) != 3:
        raise BadOption(f"{len(typed)} coordinates: expected 3, X Y Z")
    position = np.array([typed])
    return np.asarray(
        (position if asked.frame == "base" else space.to_base(position, np.eye(3))[0])[0]
    )


def _say_missed(found: Reached, dof: int, *, posed: bool) -> None:
    words = f"out of reach: the nearest attainable {'pose' if posed else 'point'} is "
    words += f"{1e3 * float(found.away[0]):.4g} mm"
    if posed:
        words += f" and {np.degrees(float(found.turned[0])):.3g} deg"
        if dof < 6:
            words += f" away; {dof} joints reach few poses, ask for a position alone"
            note(words)
            return
    note(words + " away")


def up_to_scale(space: Space, q: Array) -> dict[str, Array]:
    """The bound (n,) in the base frame of a camera [m], but for the arm's size; else nothing."""
    return {UP_TO_SCALE: space.bound(q, size=False)} if space.camera else {}


def say_size(bound: float) -> None:
    """Say what of a bound [m] in the base frame of a camera is the arm's size."""
    if np.isfinite(bound):
        note(
            "one camera cannot tell the size of the arm: but for it, the expected error is "
            f"{1e3 * bound:.2g} mm"
        )


def say_free(joints: JointFormat, free: Array, near: bool) -> None:
    """Say which motions of the joints leave the answer where it is."""
    if not len(free):
        return
    told = []
    for row in free:
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) > _TOGETHER]
        # each direction is scaled so that one joint moves by 1: it names the direction
        own = next(k for k in range(len(row)) if row[k] == 1.0 or abs(row[k] - 1) < 1e-9)
        others = [f"{joints.names[k]} {row[k]:+.2f}" for k in order if k != own]
        told.append(joints.names[own] + (f" with {', '.join(others)}" if others else " alone"))
    nearest = "--near" if near else "the middle of the ranges, --near chooses another"
    note(f"free: {'; '.join(told)}; the answer is the one nearest to {nearest}")


def free_of(model: Model, q: Any) -> Array:
    """Free directions (k, dof) at an answer q (dof,) to a position in the sensor's frame."""
    u = model.motor.scale.to_unit(np.asarray(q, dtype=float)[None])
    # the slope by joints: u = (q - lower) / span, so dx/dq = (dx/du) / span
    slope = model.predictor.value_and_slope(u)[1][0] / model.motor.scale.span
    return free_directions(slope)


def seen_forward(model: Model, values: Any, frame: str) -> dict[str, Array]:
    """What a frame adds to positions at joints (n, dof), by column.

    In the base frame x, y, z and their bound [m], and the orientation; in the sensor's the
    orientation, where it was measured.
    """
    from calib.body.poses import knows_orientation

    q = np.asarray(values, dtype=float)
    if frame == "base":
        space = Space.of(model)
        position, turns = space.forward(q)
        bounds = {"expected_error": space.bound(q), **up_to_scale(space, q)}
        bounds = {k: np.where(np.isfinite(position[:, 0]), v, np.nan) for k, v in bounds.items()}
        columns = dict(zip("xyz", position.T, strict=True)) | _named(turns)
        return columns | bounds | {"model_error": bounds["expected_error"]}
    if not knows_orientation(model.body):
        return {}
    space = Space.of(model)
    turns = quaternion_of(space.to_sensor(*space.evaluate(q)[:2])[1])
    return _named(np.where(np.isnan(model.forward(q)[:, :1]), np.nan, turns))


def _named(quaternions: Array) -> dict[str, Array]:
    return dict(zip(QUATERNION, quaternions.T, strict=True))
