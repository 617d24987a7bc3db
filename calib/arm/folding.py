"""Folding: constant transforms and masses at a robot's zero posture, as a chain of few joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET
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
    *masses: Array,
) -> SpatialChain:
    """Return the chain of an arm; `posture` has its moving joints at zero.

    `moving` are the active joints and their followers, base to tip; `masses` those that they
    carry and their centres, see `carried`, none where gravity does not matter.
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
        *masses,
    )


#: A link heavier than this [kg] is a mistake in the file, not an arm's link.
_HEAVIEST = 1e5


def _link_masses(text: str) -> dict[str, tuple[float, Array]]:
    """Mass [kg] and centre (3,) [m], in the link's frame, of each link that states them.

    What is no positive finite number is left out: the file still describes a chain.
    """
    found: dict[str, tuple[float, Array]] = {}
    for link in ET.fromstring(text).findall("link"):  # noqa: S314 - parse_urdf refused entities
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            continue
        origin = inertial.find("origin")
        place = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
        try:
            value = float(mass.get("value", "nan"))
            centre = np.array([float(part) for part in place.split()])
        except ValueError:
            continue
        if 0 < value < _HEAVIEST and centre.shape == (3,) and np.isfinite(centre).all():
            found[link.get("name", "")] = (value, centre)
    return found


def carried(
    text: str, urdf: Urdf, posture: Posture, joints: Sequence[Joint]
) -> tuple[Array, Array]:
    """Lump the masses beyond each joint of a chain, up to the next joint of the chain.

    Links beside the chain (fingers, covers) hang on the last chain joint below them and do not
    move of their own. `posture` has all joints of the chain at zero.

    Returns masses : (m,) [kg]
    Returns centres : (m, 3) [m], in the root frame. Both are empty where the URDF states no mass
        for any of them.
    """
    order = {joint.name: k for k, joint in enumerate(joints)}
    masses, moments = np.zeros(len(joints)), np.zeros((len(joints), 3))
    for link, (mass, centre) in _link_masses(text).items():
        below = [order[joint.name] for joint in urdf.path(link) if joint.name in order]
        if not below or link not in posture.links:
            continue
        masses[below[-1]] += mass
        moments[below[-1]] += mass * (posture.links[link] + posture.rotations[link] @ centre)
    if not masses.any():
        return np.zeros(0), np.zeros((0, 3))
    points = np.array([posture.points[joint.name] for joint in joints])
    safe = np.where(masses > 0, masses, 1.0)[:, None]
    return masses, np.where(masses[:, None] > 0, moments / safe, points)
