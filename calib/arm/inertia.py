"""Inertia: the masses that a chain's joints carry, read from a URDF's <inertial> elements."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .posture import Posture
from .tree import Joint, Urdf

Array = NDArray[np.float64]

#: A link heavier than this [kg] is a mistake in the file, not an arm's link.
_HEAVIEST = 1e5


def link_masses(text: str) -> dict[str, tuple[float, Array]]:
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

    Returns
    -------
    masses : (m,) array [kg]
    centres : (m, 3) array [m]
        In the root frame. Both are empty where the URDF states no mass for any of them.
    """
    order = {joint.name: k for k, joint in enumerate(joints)}
    masses, moments = np.zeros(len(joints)), np.zeros((len(joints), 3))
    for link, (mass, centre) in link_masses(text).items():
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
