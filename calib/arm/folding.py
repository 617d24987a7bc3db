"""Folding: the constant transforms of a robot at its zero posture, as a chain of few joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..common.wording import quoted
from ..errors import RobotError
from .posture import Posture
from .spatial_chain import SpatialChain
from .tree import Joint, Urdf

Array = NDArray[np.float64]

#: The active joint that a mimic joint follows, its multiplier and its offset [rad or m].
Following = Mapping[str, tuple[str, float, float]]


def followers(urdf: Urdf, path: Sequence[Joint], active: Sequence[Joint]) -> Following:
    """Mimic joints on the way to the tip that follow an active joint, directly or through others.

    Returns
    -------
    dict of str to (str, float, float)
        The active joint, the multiplier and the offset of each.
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


def refuse_followers(path: Sequence[Joint], active: Sequence[Joint]) -> None:
    """Refuse mimic joints of active ones on the way to a planar arm's tip."""
    for joint in path:
        if joint.mimic and any(joint.mimic.leader == other.name for other in active):
            raise RobotError(
                f"joint {quoted(joint.name)} mimics the active {quoted(joint.mimic.leader)} on "
                "the way to the tip: coupled joints are not supported in a planar arm; choose "
                "others"
            )


def folded(
    moving: Sequence[Joint],
    active: Sequence[Joint],
    following: Following,
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
