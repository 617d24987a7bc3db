"""Posture: where the links are, and the chain of few joints that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
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
        return np.asarray(self.frames[joint.child][:3, :3] @ _direction(joint))


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
    frame = np.eye(4)
    moved = value * _direction(joint)
    if joint.revolute:
        frame[:3, :3] = exponential(moved)
    else:
        frame[:3, 3] = moved
    return frame


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
    *,
    with_masses: bool,
) -> SpatialChain:
    """Return the chain of the joints that move a tip, with all other transforms folded into it.

    moving : the active joint that each of them follows, base to tip; an active one itself
    posture : with the moving joints at zero
    with_masses : whether the masses beyond each joint are part of it
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
        *(_masses(urdf, posture, joints) if with_masses else ()),
    )


def _masses(
    urdf: Urdf, posture: Posture, joints: Sequence[Joint]
) -> tuple[Array, Array]:
    """Masses (m,) [kg] beyond each joint of a chain, up to the next, and their centres (m, 3) [m].

    Links beside the chain (fingers, covers) hang on the last chain joint below them and do not
    move of their own. Both are empty where the robot states no mass for any, or one is unknown.
    """
    order = {joint.name: k for k, joint in enumerate(joints)}
    masses = np.zeros(len(joints))
    moments = np.zeros((len(joints), 3))
    for link, (mass, centre) in urdf.masses.items():
        if below := [
            order[joint.name]
            for joint in urdf.path(link)
            if joint.name in order
        ]:
            masses[below[-1]] += mass
            moments[below[-1]] += (
                mass * (posture.frames[link] @ [*centre, 1.0])[:3]
            )
    if not masses.sum() > 0:
        return np.zeros(0), np.zeros((0, 3))
    centres = np.array([posture.place(joint.child) for joint in joints])
    heavy = masses > 0
    centres[heavy] = moments[heavy] / masses[heavy, None]
    return masses, centres
