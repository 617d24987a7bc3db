"""Tree: the links and joints of a robot, once its URDF has been checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

Vector = tuple[float, float, float]

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Mimic:
    """A joint's coupling to another: value = multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """One joint of a URDF; `limits` are its lower and upper value [rad or m], if stated."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    limits: tuple[float, float] | None
    mimic: Mimic | None

    @property
    def movable(self) -> bool:
        """Whether the joint moves at all."""
        return self.kind in MOVABLE

    @property
    def revolute(self) -> bool:
        """Whether the joint turns (rad) rather than slides (m)."""
        return self.kind != "prismatic"


@dataclass(frozen=True)
class Urdf:
    """A checked tree of links and joints.

    `notes` are things that were mended, for the user.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    notes: tuple[str, ...]
    masses: Mapping[str, tuple[float, Vector]]  # [kg] of links, and their centres [m]

    def joint(self, name: str) -> Joint | None:
        """Return the joint of that name, or None."""
        return next((joint for joint in self.joints if joint.name == name), None)

    def path(self, link: str) -> tuple[Joint, ...]:
        """Joints from the root to a link, in that order."""
        path: list[Joint] = []
        while link in self._above:
            path.append(self._above[link])
            link = path[-1].parent
        return tuple(reversed(path))

    def below(self, link: str) -> tuple[Joint, ...]:
        """Joints that a link carries directly, in file order."""
        return tuple(self._below.get(link, ()))

    def carries(self, link: str) -> bool:
        """Whether some movable joint lies beyond a link."""
        return link in self._carrying

    @cached_property
    def _above(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _below(self) -> dict[str, list[Joint]]:
        below: dict[str, list[Joint]] = {}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)
        return below

    @cached_property
    def _carrying(self) -> set[str]:
        ends = (joint.child for joint in self.joints if joint.movable)
        return {joint.parent for end in ends for joint in self.path(end)}
