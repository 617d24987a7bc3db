"""Closed-form arms, cameras and distortions: truths that share no code with calib.

The parts of `honesty.py` draw their logs here when they need to know what is really there.
Angles are in rad, lengths in m, images in px.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import calib

Array = Any
Row = dict[str, Any]
Truth = Callable[[Array], Array]

LENGTHS = {2: (0.30, 0.25), 3: (0.30, 0.25, 0.15)}
"""Links of the bundled `two_link` and `three_link` [m]."""


def tip(q: Array, lengths: Sequence[float]) -> Array:
    """Tip (n, 2) of a planar chain by the textbook, joints (n, dof)."""
    angle = np.cumsum(np.atleast_2d(q), axis=1)
    size = np.asarray(lengths)
    return np.stack([np.cos(angle) @ size, np.sin(angle) @ size], axis=1)


def turned(x: Array, angle: float, shift: Sequence[float]) -> Array:
    """Positions (n, 2) in a frame that is turned and shifted."""
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, s], [-s, c]]) + np.asarray(shift)


def image(x: Array, tilt: float = np.radians(20.0), focal: float = 900.0) -> Array:
    """Pixels (n, 2) of a pinhole camera 1.2 m above the plane, tilted; v points down."""
    away = x - np.array([0.15, 0.25])
    depth = 1.2 + np.sin(tilt) * away[:, 1]
    u = 640.0 + focal * away[:, 0] / depth
    v = 360.0 - focal * np.cos(tilt) * away[:, 1] / depth
    return np.stack([u, v], axis=1)


def tilted(x: Array) -> Array:
    """The same camera, its image scaled to metres and not mirrored."""
    seen = image(x) - np.array([640.0, 360.0])
    return seen * np.array([1.0, -1.0]) * (1.2 / 900.0)


def lens(x: Array) -> Array:
    """Pincushion distortion about a point inside the workspace, 10 % per 0.35 m squared."""
    away = x - np.array([0.2, 0.25])
    return x + 0.8 * np.sum(away**2, axis=1, keepdims=True) * away


def flexed(q: Array) -> Array:
    """Joints that give way under the weight of the links, up to 1.5 deg."""
    angle = np.cumsum(q, axis=1)
    elbow = np.cos(angle[:, 1])
    shoulder = 2.0 * np.cos(angle[:, 0]) + elbow
    return q - np.stack([0.009 * shoulder, 0.006 * elbow], axis=1)


def waves(size: float, dof: int, rng: np.random.Generator) -> Truth:
    """Periodic errors of the joints, 8 to 24 cycles a turn [rad]: joints to true angles."""
    cycles, phase = rng.integers(8, 25, dof), rng.uniform(0, 2 * np.pi, dof)
    return lambda q: q + size * np.sin(cycles * q + phase)


def nearly_nominal(size: float, rng: np.random.Generator) -> Truth:
    """A `two_link` as built: 0.5 mm and 0.05 deg off, in a sensor's own frame, with waves."""
    lengths = np.array(LENGTHS[2]) + 5e-4 * rng.standard_normal(2)
    offset = np.radians(0.05) * rng.standard_normal(2)
    bent = waves(size, 2, rng)
    angle, shift = rng.uniform(-np.pi, np.pi), rng.uniform(-0.3, 0.3, 2)
    return lambda q: turned(tip(bent(q) + offset, lengths), angle, shift)


def route(kind: str, n: int, rng: np.random.Generator) -> Array:
    """Joints (n, 2) along a path of `two_link`: "2", "3", "5" poses in turn, or a "circle"."""
    lower, upper = np.radians([0.0, 15.0]), np.radians([90.0, 150.0])
    if kind == "circle":
        angle = np.linspace(0, 4 * np.pi, n)
        x = np.array([0.20, 0.30]) + 0.10 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        a, b = LENGTHS[2]
        elbow = np.arccos((np.sum(x**2, axis=1) - a * a - b * b) / (2 * a * b))
        ahead = np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
        return np.stack([np.arctan2(x[:, 1], x[:, 0]) - ahead, elbow], axis=1)
    poses = rng.uniform(lower, upper, (int(kind), 2))
    at = np.linspace(0, len(poses) - 1, n)
    return np.stack([np.interp(at, np.arange(len(poses)), p) for p in poses.T], axis=1)


def samples(q: Array, x: Array, lower: Array, upper: Array, **more: Any) -> calib.Samples:
    """A log of joints j0, j1, ... or of the arm that is given."""
    arm = more.get("arm")
    names = arm.joint_names if arm else tuple(f"j{k}" for k in range(q.shape[1]))
    return calib.Samples(q, x, names, lower, upper, (True,) * q.shape[1], **more)


def distance(said: Array, truth: Array) -> Array:
    """Distance of each row (n,)."""
    return np.linalg.norm(said - truth, axis=1)


def row(what: str, measured: float, unit: str = "", **more: Any) -> Row:
    """A row of the table; `least` and `most` are its bar, `more` is said behind it."""
    return {"what": what, "measured": measured, "unit": unit, **more}
