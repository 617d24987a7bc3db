"""Turns: joints that can turn more than once, and the turn on which an answer stands.

The box in which joints are learned is one turn wide at most: the arm is the same a turn on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..arm.description import parse_robot
from ..common.arrays import Array, Mask
from ..common.scale import TURN
from ..errors import CalibError
from .parts import Parts

_ROUNDED = 1e-9  # [rad] by which a joint may be rounded beyond its limit


def joint_limits(model: Parts) -> Array:
    """Lower and upper limit (dof, 2) [rad or m]: of more than a turn, or infinite, as drawn."""
    if "limits" not in model.cache:
        about = model.about
        limits = np.column_stack([about.lower, about.upper])
        several = about.urdf and model.motor.scale.periodic.any()
        drawn = _urdf_limits(about.urdf) if several else {}
        for k, name in enumerate(about.joint_names):
            lower, upper = drawn.get(name, (0.0, 0.0))
            if model.motor.scale.periodic[k] and upper - lower > TURN:
                limits[k] = lower, upper
        model.cache["limits"] = limits
    both: Array = model.cache["limits"]
    return both


def within_limits(model: Parts, q: Array) -> Mask:
    """Which joint values (n, dof) are within the limits of `joint_limits`."""
    lower, upper = joint_limits(model).T
    return np.asarray((q >= lower - _ROUNDED) & (q <= upper + _ROUNDED))


def _urdf_limits(urdf: str) -> dict[str, tuple[float, float]]:
    """What the joints of a URDF can reach, by name; nothing where there is none."""
    try:
        joints = parse_robot(urdf).joints
    except CalibError:
        return {}
    return {joint.name: joint.travel for joint in joints}


def nearest_turn(model: Parts, q: Array, near: Array) -> Array:
    """Joints (n, dof) by whole turns as near to others (n, dof) as can be, beyond limits too."""
    periodic = model.motor.scale.periodic
    if not periodic.any():
        return q
    turns = np.round((near - q) / TURN)
    return np.where(periodic, q + TURN * turns, q)


def on_turn(model: Parts, q: Array, near: Array) -> Array:
    """Joints (n, dof) by whole turns as near to others (n, dof) as their limits allow."""
    periodic = model.motor.scale.periodic
    if not periodic.any():
        return q
    lower, upper = joint_limits(model).T
    moved = nearest_turn(model, q, near)
    moved = moved - TURN * np.ceil(
        np.maximum(moved - upper - _ROUNDED, 0.0) / TURN
    )
    moved = moved + TURN * np.ceil(
        np.maximum(lower - moved - _ROUNDED, 0.0) / TURN
    )
    return np.where(periodic, np.clip(moved, lower, upper), q)


def unwound(
    model: Parts, q: Array, start: Array
) -> tuple[Array, NDArray[np.intp]]:
    """Joints (n, dof) of a path on the turns that follow each other, and rows that turn round.

    A joint goes on over the seam of its turn where its limits allow; where they do not, it has to
    turn round, which is a jump.  `start` (dof,) says on which turn the path begins.
    """
    rows = q.copy()
    jumps: list[int] = []
    limits = joint_limits(model)
    for k in np.flatnonzero(model.motor.scale.periodic):
        rows[:, k], turned = _unwound_joint(
            q[:, k], limits[k, 0], limits[k, 1], start[k]
        )
        jumps += turned
    return rows, np.unique(np.array(jumps, dtype=np.intp))


def _unwound_joint(
    q: Array, lower: float, upper: float, start: float
) -> tuple[Array, list[int]]:
    """One joint (n,) of a path on the turns that follow each other, and rows that turn round."""
    track = np.unwrap(q)
    out = track.copy()
    jumps: list[int] = []
    first = 0
    before = start
    while first < len(track):
        nearest = round((before - track[first]) / TURN)
        turns = _possible_turns(float(track[first]), lower, upper, nearest)
        # of the turns on which a joint gets furthest the nearest
        ends = [
            first + _run(track[first:] + TURN * turn, lower, upper)
            for turn in turns
        ]
        best = min(
            zip(ends, turns, strict=True),
            key=lambda way: (-way[0], abs(way[1] - nearest)),
        )
        end = max(best[0], first + 1)
        out[first:end] = track[first:end] + TURN * best[1]
        before = float(out[end - 1])
        if end < len(track):
            jumps.append(end)
        first = end
    return out, jumps


def _possible_turns(
    value: float, lower: float, upper: float, nearest: int
) -> range:
    """Whole turns that bring a value within limits; without a limit the nearest on that side."""
    least = nearest
    most = nearest
    if not math.isinf(lower):
        least = math.ceil((lower - value - _ROUNDED) / TURN)
    if not math.isinf(upper):
        most = math.floor((upper - value + _ROUNDED) / TURN)
    return range(least, max(least, most) + 1)


def _run(track: Array, lower: float, upper: float) -> int:
    """How many values (n,) from the first on lie within limits."""
    outside = (track < lower - _ROUNDED) | (track > upper + _ROUNDED)
    return int(np.argmax(outside)) if outside.any() else len(track)
