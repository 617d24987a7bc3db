"""Gauge: what no reading of a sensor that stands anywhere tells of an arm in space.

It cannot tell where the base is turned to about the first joint's axis nor how far along it; a
camera cannot tell how large the arm is. What is left of these directions is the prior's, so that
what is known of an arm, and of its sensor's place, is also told without them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..common.arrays import Array
from .belief import Body, Second
from .structure import Indices

SENSOR = ("view.rotation", "view.shift", "view.scale", "lens")
"""Groups of parameters that are the sensor's."""

_ALIKE = 0.05  # a gauge is one where parameters move the tip as it does, but for this share
_POSES = 60


def without_gauge(structure: Any, belief: Body | Second, size: bool) -> Array:
    """Covariance (k, k) of a belief's parameters without motions of the tip that no reading tells.

    Of all parameters that readings cannot tell apart, those nearest to the belief's stand for them:
    a change of datum (Baarda 1981, S-transformation). Without `size` an error of all lengths by
    one factor is left out too.
    """
    base, beta = without_sensor(structure, belief.beta)
    own = ~np.isin(belief.active, sensor_of(structure))
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (_POSES, base.dof))
    position, x = base.linearise(q, beta, belief.active[own])
    axis, arm = base.chain.axes[0], position - base.chain.points[0]
    motions = [np.cross(axis, arm), np.broadcast_to(axis, arm.shape), *([] if size else [arm])]
    wanted = np.stack([motion.ravel() for motion in motions], axis=1)
    columns = x.reshape(len(wanted), -1) @ belief.root[own]  # of independent standard normals
    ways = np.linalg.lstsq(columns, wanted, rcond=1e-9)[0]
    left = np.linalg.norm(columns @ ways - wanted, axis=0) / np.linalg.norm(wanted, axis=0)
    ways, _ = np.linalg.qr(ways[:, left < _ALIKE])
    root = belief.root - (belief.root @ ways) @ ways.T
    return np.asarray(root @ root.T)


def sensor_of(structure: Any) -> Indices:
    """Indices of the sensor's parameters."""
    return np.concatenate([structure.groups[name] for name in SENSOR])


def without_sensor(structure: Any, beta: Array) -> tuple[Any, Array]:
    """The arm alone: its structure in the base frame [m], and parameters (d,)."""
    base = structure.with_view("base", unit="m", metre=1.0, extent=structure.chain.reach)
    own = beta.copy()
    own[sensor_of(structure)] = structure.neutral()[sensor_of(structure)]
    return base, own
