"""Turns: joints that can turn more than once, and the turn of an answer.

The box in which joints are learned is one turn wide at most: after a turn the arm is the same.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.scale import TURN
from .parts import ModelParts

_ROUNDED = 1e-9  # [rad] by which a joint may be rounded beyond its limit


def joint_limits(model: ModelParts) -> Array:
    """Lower and upper limit (dof, 2) [rad or m]: of more than a turn as drawn."""
    about = model.about
    if about.limits is None:
        return np.column_stack([about.lower, about.upper])
    return about.limits


def within_limits(model: ModelParts, q: Array) -> Mask:
    """Which joint values (n, dof) are within the limits of `joint_limits`."""
    lower, upper = joint_limits(model).T
    return np.asarray((q >= lower - _ROUNDED) & (q <= upper + _ROUNDED))


def nearest_turn(model: ModelParts, q: Array, near: Array) -> Array:
    """Joints (n, dof) by whole turns as near to others (n, dof) as can be, beyond limits too."""
    scale = model.motor.scale
    if not scale.goes_round:
        return q
    turns = np.round((near - q) / TURN)
    return np.where(scale.periodic, q + TURN * turns, q)


def on_turn(model: ModelParts, q: Array, near: Array) -> Array:
    """Joints (n, dof) by whole turns as near to others (n, dof) as their limits allow."""
    scale = model.motor.scale
    if not scale.goes_round:
        return q
    lower, upper = joint_limits(model).T
    moved = nearest_turn(model, q, near)
    moved = moved - TURN * np.ceil(
        np.maximum(moved - upper - _ROUNDED, 0.0) / TURN
    )
    moved = moved + TURN * np.ceil(
        np.maximum(lower - moved - _ROUNDED, 0.0) / TURN
    )
    return np.where(scale.periodic, np.clip(moved, lower, upper), q)


def unwound(model: ModelParts, q: Array, start: Array) -> tuple[Array, Index]:
    """Joints (n, dof) of a path on the turns that follow each other, and rows that turn round.

    A joint continues over the seam of its turn where its limits allow; where they do not, it has to
    turn round, which is a jump.  `start` (dof,) sets the turn on which the path begins.
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
    jumps: list[int] = []
    first = 0
    while first < len(track):
        rest = track[first:]
        # whole turns that keep each row, and those before it, within the limits
        room = lower - np.minimum.accumulate(rest) - _ROUNDED
        least = np.ceil(room / TURN)
        room = upper - np.maximum.accumulate(rest) + _ROUNDED
        most = np.floor(room / TURN)
        # of the turns on which the joint gets furthest the one nearest to the start
        out = np.append(least > most, True)
        count = max(int(np.argmax(out)), 1)
        nearest = np.round((start - rest[0]) / TURN)
        turn = np.clip(nearest, least[count - 1], most[count - 1])
        rest[:count] += TURN * turn
        start = float(rest[count - 1])
        first += count
        jumps.append(first)
    return track, jumps[:-1]
