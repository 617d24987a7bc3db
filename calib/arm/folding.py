"""Folding: constant transforms and masses at a robot's zero posture, as a chain of few joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..common.arrays import Array
from .posture import Posture
from .spatial_chain import SpatialChain
from .tree import Joint, Urdf

#: The active joint that a mimic joint follows, its multiplier and its offset [rad or m].
_Following = Mapping[str, tuple[str, float, float]]


def followers(urdf: Urdf, path: Sequence[Joint], active: Sequence[Joint]) -> _Following:
    """Mimic joints on the way to the tip that follow an active joint, directly or through others.

    Returns the active joint, the multiplier and the offset of each.
    """
    names = {joint.name for joint in active}
    found: dict[str, tuple[str, float, float]] = {}
    for joint in path:
        scale, offset, other, seen = 1.0, 0.0, joint, {joint.name}
        while other.mimic and other.name not in names:
            offset += scale * other.mimic.offset
            scale *= other.mimic.multiplier
            leader = urdf.joint(other.mimic.leader)
            if leader is None or leader.name in seen:
                break
            seen.add(leader.name)
            other = leader
        if joint.name not in names and joint.movable and other.name in names:
            found[joint.name] = (other.name, scale, offset)
    return found


def folded(
    moving: Sequence[Joint],
    active: Sequence[Joint],
    following: _Following,
    tip: str,
    posture: Posture,
    urdf: Urdf | None,
) -> SpatialChain:
    """Return the chain of an arm; `posture` has its moving joints at zero.

    `moving` are the active joints and their followers, base to tip; `urdf` states
    the masses that they carry, None where gravity does not matter.
    """
    columns = {joint.name: k for k, joint in enumerate(active)}
    coupling, bias = np.zeros((len(moving), len(active))), np.zeros(len(moving))
    for i, joint in enumerate(moving):
        leader, scale, bias[i] = following.get(joint.name, (joint.name, 1.0, 0.0))
        coupling[i, columns[leader]] = scale
    return SpatialChain(
        np.array([posture.axes[joint.name] for joint in moving]),
        np.array([posture.points[joint.name] for joint in moving]),
        posture.links[tip],
        posture.rotations[tip],
        tuple(joint.revolute for joint in moving),
        coupling,
        bias,
        *(_carried(urdf, posture, moving) if urdf else ()),
    )


def _carried(urdf: Urdf, posture: Posture, joints: Sequence[Joint]) -> tuple[Array, Array]:
    """Lump the masses beyond each joint of a chain, up to the next joint of the chain.

    Links beside the chain (fingers, covers) hang on the last chain joint below them and do not
    move of their own. `posture` has all joints of the chain at zero.

    Returns masses : (m,) [kg]
    Returns centres : (m, 3) [m], in the root frame. Both are empty where the URDF states no mass
        for any of them.
    """
    order = {joint.name: k for k, joint in enumerate(joints)}
    masses, moments = np.zeros(len(joints)), np.zeros((len(joints), 3))
    for link, (mass, centre) in urdf.masses.items():
        below = [order[joint.name] for joint in urdf.path(link) if joint.name in order]
        if below:
            masses[below[-1]] += mass
            place = posture.links[link] + posture.rotations[link] @ np.array(centre)
            moments[below[-1]] += mass * place
    if not masses.any():
        return np.zeros(0), np.zeros((0, 3))
    points = np.array([posture.points[joint.name] for joint in joints])
    safe = np.where(masses > 0, masses, 1.0)[:, None]
    return masses, np.where(masses[:, None] > 0, moments / safe, points)
