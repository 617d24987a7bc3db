"""Robot: the links from a robot's root to its tip, moved by the active joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.description import parse_robot
from ..arm.posture import posture_of
from ..arm.urdf import Urdf
from ..common.arrays import Array
from ..common.wording import by_name
from ..errors import CalibError
from ..model.about import About


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as its URDF describes it."""

    urdf: Urdf
    about: About
    links: tuple[str, ...]  # from the root to the tip

    @staticmethod
    def of(about: About) -> Robot | None:
        """Return the robot of a model, None where no URDF came with it."""
        if not about.urdf or not about.tip:
            return None
        try:
            urdf = parse_robot(about.urdf, about.robot)
            path = urdf.path(about.tip)
            posture_of(urdf, about.locked)  # without Pinocchio no arm is drawn
        except CalibError:
            return None
        links = (urdf.root, *(joint.child for joint in path))
        return Robot(urdf, about, links)

    def poses(self, q: Array) -> dict[str, Array]:
        """Transforms (n, 4, 4) of the links in the root's frame, for joints (n, dof)."""
        postures = []
        for row in q.tolist():
            joints = by_name(self.about.joint_names, row)
            posture = posture_of(self.urdf, {**self.about.locked, **joints})
            postures.append(posture.frames)
        return {
            link: np.stack([frames[link] for frames in postures])
            for link in self.links
        }

    def tips(self, q: Array) -> Array:
        """Position (n, 3) of the tip in the root's frame [m]."""
        return self.poses(q)[self.links[-1]][:, :3, 3]
