"""Geometry: joint offsets and link placements that fit a learned map best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .correct import frames, nominal_arm

if TYPE_CHECKING:
    from ..arm.planar_arm import PlanarArm
    from ..model.model import Model

Array = NDArray[np.float64]

_POINTS = 500
_STEPS = 50
_RIGID = 1000.0  # a displacement [m] is so many times less likely than an offset [rad or m]


@dataclass(frozen=True, eq=False)
class Geometry:
    """A fitted planar geometry.

    Attributes
    ----------
    arm : PlanarArm
        The nominal arm.
    offsets : (dof,) array [rad or m]
        Joint value at which the nominal arm stands where the real one reads zero.
    moved : (dof, 2) array [m]
        How far each joint's successor (the last one's: the tip) is displaced in the plane,
        in the axes of the plane at the zero posture.
    base : (2,) array [m]
        Displacement of the first joint.
    interval_offsets, interval_moved, interval_base : arrays
        Half widths of the 95 % intervals, from the map's own expected error.
    residual : float [unit]
        Root mean square distance that this geometry does not explain.
    before : float [unit]
        The same for the nominal geometry.
    """

    arm: PlanarArm
    offsets: Array
    moved: Array
    base: Array
    interval_offsets: Array
    interval_moved: Array
    interval_base: Array
    residual: float
    before: float

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        names = self.arm.joint_names
        return {
            "offsets": {
                n: {"value": v, "interval": i}
                for n, v, i in zip(
                    names, self.offsets.tolist(), self.interval_offsets.tolist(), strict=True
                )
            },
            "moved": {
                n: {"value": v, "interval": i}
                for n, v, i in zip(
                    names, self.moved.tolist(), self.interval_moved.tolist(), strict=True
                )
            },
            "base": {"value": self.base.tolist(), "interval": self.interval_base.tolist()},
            "residual": self.residual,
            "before": self.before,
        }


def fit_geometry(model: Model) -> Geometry:
    """Fit the nominal chain to a learned map by least squares (Gauss-Newton).

    Unknown are an offset for each joint and, in the plane, the place of the tip in the
    last link's frame and of each joint in its predecessor's.  Offset and turned link are
    the same to the tip; of such a family the smallest change is taken, so that a link's
    length and a joint's offset come out apart.

    Parameters
    ----------
    model : Model
        It must bear a URDF and speak in metres.
    """
    arm = nominal_arm(model)
    if model.about.unit != "m":
        raise OptionError(
            f"the model's positions are in {model.about.unit!r}, a URDF's are in m: adapt it with "
            "a log in m (or `unit='mm'`)"
        )
    u = np.random.default_rng(0).random((_POINTS, arm.dof))
    q = model.motor.scale.from_unit(u)
    x: Array = model.forward(q)
    known = np.isfinite(x).all(axis=1)
    q, x = q[known], x[known]
    # undo what is the sensor's: the URDF describes the arm alone
    for frame in reversed(frames(model)):
        x = np.asarray(np.linalg.solve(frame.matrix, (x - frame.shift).T).T, dtype=float)
    dof = arm.dof
    theta: Array = np.zeros(dof + 2 * dof + 2)
    size = np.append(np.ones(dof), np.full(2 * dof + 2, 1.0 / _RIGID))
    for _ in range(_STEPS):
        residual = (x - _forward(arm, theta, q)).ravel()
        slope = _slopes(arm, theta, q) * size
        step = size * np.linalg.lstsq(slope, residual, rcond=1e-7)[0]
        theta = theta + step
        if np.abs(step).max() < 1e-12:
            break
    theta = _shortest(arm, theta, q, size)
    left = x - _forward(arm, theta, q)
    rms = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    before = float(np.sqrt(np.mean(np.sum((x - arm.forward(q)) ** 2, axis=1))))
    interval = _intervals(model, _slopes(arm, theta, q), rms)
    parts, widths = _split(theta, dof), _split(interval, dof)
    return Geometry(arm, *parts, *widths, rms, before)


def _split(theta: Array, dof: int) -> tuple[Array, Array, Array]:
    return theta[:dof], theta[dof : 3 * dof].reshape(dof, 2), theta[3 * dof :]


def changed_arm(arm: PlanarArm, moved: Array, base: Array) -> PlanarArm:
    """The arm with its joints and tip displaced in the plane at the zero posture."""
    from dataclasses import replace

    axes = np.stack([arm.plane.x, arm.plane.y])
    shifts = np.cumsum(np.vstack([base, moved]), axis=0) @ axes
    chain = arm.chain
    chain = replace(chain, points=chain.points + shifts[:-1], tip=chain.tip + shifts[-1])
    return replace(arm, chain=chain)


def _forward(arm: PlanarArm, theta: Array, q: Array) -> Array:
    offsets, moved, base = _split(theta, arm.dof)
    return changed_arm(arm, moved, base).forward(q + offsets)


def _slopes(arm: PlanarArm, theta: Array, q: Array) -> Array:
    columns = []
    for k in range(len(theta)):
        step = np.zeros_like(theta)
        step[k] = 1e-6
        change = _forward(arm, theta + step, q) - _forward(arm, theta - step, q)
        columns.append(change.ravel() / 2e-6)
    return np.stack(columns, axis=1)


def _shortest(arm: PlanarArm, theta: Array, q: Array, size: Array) -> Array:
    """Follow the directions that change nothing to where the change is smallest."""
    target = _forward(arm, theta, q)
    for _ in range(40):
        singular, directions = np.linalg.svd(_slopes(arm, theta, q) * size, full_matrices=False)[1:]
        idle = directions[singular < 1e-6 * singular[0]]
        if not len(idle):
            break
        step = -size * (idle.T @ (idle @ (theta / size)))
        theta = theta + 0.7 * step
        # return to the same positions: the directions are straight only nearby
        for _ in range(3):
            gap = (target - _forward(arm, theta, q)).ravel()
            slope = _slopes(arm, theta, q) * size
            theta = theta + size * np.linalg.lstsq(slope, gap, rcond=1e-6)[0]
        if np.abs(step).max() < 1e-9:
            break
    return theta


def _intervals(model: Model, slope: Array, rms: float) -> Array:
    """Half widths of 95 % intervals: as if the samples that were measured had this error."""
    samples = max(model.about.samples, 10)
    error = max(rms / np.sqrt(2.0), float(np.nanmedian(model.bounds)) / 2.45)
    size, directions = np.linalg.svd(slope, full_matrices=False)[1:]
    keep = size > 1e-6 * size[0]
    variance = np.sum((directions[keep].T / size[keep]) ** 2, axis=1)
    return np.asarray(1.96 * error * np.sqrt(variance * len(slope) / 2.0 / samples))
