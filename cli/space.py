"""Space: what queries to an arm in space ask and tell besides positions: poses, planes, freedom.

This file is imported only for such queries: it needs NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from calib.arm.rotations import quaternion_of
from calib.common.arrays import Array
from calib.inverse.self_motions import free_directions
from calib.model.space import Space
from calib.samples.roles import QUATERNION, from_angles

from .answers import UP_TO_SCALE
from .output import note
from .parsing import BadOption
from .units import JointFormat

if TYPE_CHECKING:
    from calib import Model

_TOGETHER = 0.05  # of the largest share: joints that move less are not named


def orientation(
    quaternion: Sequence[float] | None, rpy: Sequence[float] | None, degrees: bool
) -> Array | None:
    """Return the quaternion (4,) that was typed, checked; None for none."""
    if quaternion is not None and rpy is not None:
        raise BadOption("--quaternion and --rpy are given: expected one of them")
    if quaternion is not None:
        length = float(np.linalg.norm(quaternion))
        if len(quaternion) != 4 or abs(length - 1) > 0.01:
            shown = f"{len(quaternion)} numbers of length {length:.4g}"
            raise BadOption(f"--quaternion has {shown}: expected 4 of length 1, qx,qy,qz,qw")
        # typed numbers are rounded: the unit sphere's nearest point is meant
        return np.array(quaternion) / length
    if rpy is None:
        return None
    if len(rpy) != 3:
        raise BadOption(f"--rpy has {len(rpy)} numbers: expected roll, pitch and yaw")
    angles = np.array([rpy])
    return np.asarray(from_angles(np.deg2rad(angles) if degrees else angles)[0])


def pixel_on_plane(model: Model, pixel: Sequence[float], height: float) -> Array:
    """Return the point (3,) [m] that a pixel shows of a plane of the base frame, and tell it."""
    if len(pixel) != 2:
        raise BadOption(f"--on needs a pixel: expected U V, not {len(pixel)} numbers")
    point = np.asarray(Space.of(model).pixels_on_plane(pixel, height)[0])
    x, y, z = 1e3 * point
    note(f"the pixel shows ({x:.2f}, {y:.2f}, {z:.2f}) mm of the base frame")
    return point


def up_to_scale(model: Model, q: ArrayLike) -> dict[str, Array]:
    """The bound (n,) in the base frame of a camera [m], but for the arm's size; else nothing."""
    space = Space.of(model)
    return {UP_TO_SCALE: space.bound(q, size=False)} if space.camera else {}


def say_size(bound: float) -> None:
    """Say what of a bound [m] in the base frame of a camera is the arm's size."""
    if np.isfinite(bound):
        note(
            "one camera cannot tell the size of the arm: but for it, the expected error is "
            f"{1e3 * bound:.2g} mm"
        )


def free(model: Model, q: Array, rows: int | None) -> Array:
    """Directions (k, dof) of the joints that leave an answer at q (dof,) where it is.

    rows : 3 for a position in the base frame, 6 for a pose; None for a position that the model
        itself predicts, in the sensor's frame
    """
    if rows is not None:
        return Space.of(model).free(q, rows)[:9]
    scale = model.motor.scale
    # the slope by joints: u = (q - lower) / span, so dx/dq = (dx/du) / span
    slope = model.predictor.value_and_slope(scale.to_unit(q[None]))[1][0] / scale.span
    return free_directions(slope)


def say_free(joints: JointFormat, directions: Array, near: bool) -> None:
    """Say which motions of the joints leave the answer where it is."""
    if not len(directions):
        return
    told = []
    for row in directions:
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) > _TOGETHER]
        # each direction is scaled so that one joint moves by 1: it names the direction
        own = next(k for k in range(len(row)) if abs(row[k] - 1) < 1e-9)
        others = [f"{joints.names[k]} {row[k]:+.2f}" for k in order if k != own]
        told.append(joints.names[own] + (f" with {', '.join(others)}" if others else " alone"))
    nearest = "--near" if near else "the middle of the ranges, --near chooses another"
    note(f"free: {'; '.join(told)}; the answer is the one nearest to {nearest}")


def seen_forward(model: Model, values: Any, frame: str) -> dict[str, Array]:
    """What a frame adds to positions at joints (n, dof), by column.

    In the base frame x, y, z and their bound [m], and the orientation; in the sensor's the
    orientation, where it was measured.
    """
    from calib.body.belief import knows_orientation

    q = np.asarray(values, dtype=float)
    if frame == "base":
        space = Space.of(model)
        position, turns = space.forward(q)
        bounds = {"expected_error": space.bound(q), **up_to_scale(model, q)}
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
