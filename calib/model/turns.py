"""Turns: joints that can turn more than once, and the turn on which an answer stands."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from ..common.scale import TURN
from .parts import Parts


def joint_limits(model: Parts) -> Array:
    """Lower and upper limit (dof, 2) [rad or m] of each joint, of more than a turn where it can."""
    about = model.about
    limits = getattr(about, "limits", None)
    if limits is None:
        return np.column_stack([about.lower, about.upper])
    return np.asarray(limits, dtype=float)


def on_turn(model: Parts, q: Array, near: Array) -> Array:
    """Joints (n, dof) by whole turns as near to others (n, dof) as their limits allow."""
    periodic = model.motor.scale.periodic
    if not periodic.any():
        return q
    lower, upper = joint_limits(model).T
    moved = q + TURN * np.round((near - q) / TURN)
    moved = moved - TURN * np.ceil(np.maximum(moved - upper, 0.0) / TURN)
    moved = moved + TURN * np.ceil(np.maximum(lower - moved, 0.0) / TURN)
    return np.where(periodic, moved, q)
