"""Posture: where the links are, and the chain of few joints that they make."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from .rigid import rigid
from .rotations import exponential
from .spatial_chain import SpatialChain
from .urdf import Joint, Mimic, Urdf


@dataclass(frozen=True, eq=False)
class Posture:
    """Where links are, and with them the joints whose child they are, in the root link's frame."""

    frames: dict[str, Array]  # (4, 4), transform of each link's frame

    def place(self, link: str) -> Array:
        """Origin (3,) [m] of a link's frame."""
        return self.frames[link][:3, 3]

    def axis(self, joint: Joint) -> Array:
        """Unit axis (3,) of a joint."""
        return self.frames[joint.child][:3, :3] @ _direction(joint)


def posture_of(urdf: Urdf, chosen: Mapping[str, float]) -> Posture:
    """Return the posture at joint values [rad or m]; other joints follow them or are neutral.

    They are products of the joints' transforms; Pinocchio, which has no wheel for Windows, is not
    needed.
    """
    values = urdf.values(chosen)
    frames = {urdf.root: np.eye(4)}
    # a URDF may list a joint before the one that carries it
    for joint in sorted(
        urdf.joints, key=lambda joint: len(urdf.path(joint.child))
    ):
        frame = frames[joint.parent] @ joint.origin
        if joint.movable:
            frame = frame @ _motion(joint, values[joint.name])
        frames[joint.child] = frame
    return Posture(frames)


def _motion(joint: Joint, value: float) -> Array:
    """Transform (4, 4) by which a joint at a value [rad or m] moves its child link."""
    moved = value * _direction(joint)
    if joint.revolute:
        return rigid(exponential(moved), np.zeros(3))
    return rigid(np.eye(3), moved)


def _direction(joint: Joint) -> Array:
    """Unit axis (3,) of a joint in its own frame, which is its child's."""
    axis = np.array(joint.axis)
    return np.asarray(axis / np.linalg.norm(axis))


def chain_of(
    urdf: Urdf,
    moving: Mapping[str, Mimic],
    active: Sequence[str],
    tip: str,
    posture: Posture,
) -> SpatialChain:
    """Return the chain of the joints that move a tip, with all other transforms folded into it.

    moving : the active joint that each of them follows, base to tip; an active one itself
    posture : with the moving joints at zero
    """
    joints = [joint for joint in urdf.path(tip) if joint.name in moving]
    coupling = np.zeros((len(joints), len(active)))
    for row, mimic in zip(coupling, moving.values(), strict=True):
        row[active.index(mimic.leader)] = mimic.multiplier
    return SpatialChain(
        np.array([posture.axis(joint) for joint in joints]),
        np.array([posture.place(joint.child) for joint in joints]),
        posture.place(tip),
        posture.frames[tip][:3, :3],
        tuple(joint.revolute for joint in joints),
        coupling,
        np.array([mimic.offset for mimic in moving.values()]),
    )


def with_masses(
    chain: SpatialChain, urdf: Urdf, posture: Posture, moving: Collection[str]
) -> SpatialChain:
    """Return a chain with the masses beyond each joint, up to the next, and their centres.

    Links off the chain (fingers, covers) hang on the last chain joint below them and do not
    move of their own. It stays without where the robot states no mass for any, or one is unknown.

    posture, moving : see `chain_of`
    """
    order = list(moving)
    masses = np.zeros(chain.joints)
    moments = np.zeros((chain.joints, 3))
    for link, (mass, centre) in urdf.masses.items():
        path = [joint.name for joint in urdf.path(link)]
        carriers = [order.index(name) for name in path if name in moving]
        if carriers:
            place = posture.frames[link] @ [*centre, 1.0]
            masses[carriers[-1]] += mass
            moments[carriers[-1]] += mass * place[:3]
    if not masses.sum() > 0:
        return chain
    centres = chain.points.copy()
    heavy = masses > 0
    centres[heavy] = moments[heavy] / masses[heavy, None]
    return replace(chain, masses=masses, centres=centres)
