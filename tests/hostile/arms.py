"""Random planar arms in space, as URDFs, with what is known about them by construction."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from random import Random

import numpy as np

NAMES = (
    "a b", "été", "关节", "🤖", "it's", 'the "elbow"', "<tip>", "a&b", "a;b", "50%", "-x", "--tip",
    "universe", "root_joint", "world", "base", "base_link", "x", "joint 1 ", "{0}", "a/b", "a:b=c",
    "a,b", "0", "nan", "\\n", "tool0", "e\u0301", "sensor", "ß" * 80,
)  # fmt: skip
"""Names that are legal in XML and that programs stumble over."""


@dataclass
class RandomArm:
    """A robot with one planar arm in it."""

    text: str = ""  # URDF
    joints: list[str] = field(default_factory=list)  # of the arm, base to tip
    tip: str = ""
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # of its plane
    values: dict[str, float] = field(default_factory=dict)  # where other joints stand [rad or m]
    refused: str | None = None  # what the reason has to name, "not planar" where a plane is asked


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about an axis, by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def rotation(rpy: tuple[float, float, float]) -> np.ndarray:
    """Rotation of fixed-axis roll, pitch and yaw, as URDF defines it."""
    x, y, z = np.eye(3)
    return turned(z, rpy[2]) @ turned(y, rpy[1]) @ turned(x, rpy[0])


def random_arm(rng: Random) -> RandomArm:
    """Make a planar arm of one to seven joints anywhere in space, among other joints."""
    return _Builder(rng).build()


class _Builder:
    def __init__(self, rng: Random) -> None:
        self.rng, self.arm, self.frame = rng, RandomArm(), np.eye(3)
        self.nodes: list[ET.Element] = []
        self.names: set[str] = set()
        self.strange = rng.random() < 0.6

    def build(self) -> RandomArm:
        rng, arm = self.rng, self.arm
        if rng.random() < 0.7:
            arm.normal = self._direction()
        link = self._link()
        if rng.random() < 0.5:
            link = self._locked(link)
        count = rng.randint(1, 7)
        bent = rng.randrange(count) if rng.random() < 0.1 and count > 2 else None
        for k in range(count):
            if rng.random() < 0.25:
                link = self._locked(link)
            link = self._active(link, bent=k == bent)
            if rng.random() < 0.3:
                self._branch(link)
        arm.tip = self._locked(link, fixed=True)
        arm.refused = "two or more" if count == 1 else "not planar" if bent is not None else None
        rng.shuffle(self.nodes)
        robot = ET.Element("robot", name=self._name("robot"))
        robot.extend(self.nodes)
        arm.text = ET.tostring(robot, encoding="unicode")
        return arm

    def _active(self, parent: str, *, bent: bool) -> str:
        """Add a joint of the arm: across the plane if it turns, within it if it slides."""
        rng, normal = self.rng, self.arm.normal
        kind = rng.choice(("revolute", "revolute", "continuous", "prismatic"))
        across = np.cross(normal, self._direction())
        across /= np.linalg.norm(across)
        slides = kind == "prismatic"
        axis = across if slides else normal * rng.choice((1, -1))
        if bent:  # well out of the plane, or well into it
            axis = math.cos(0.7) * axis + math.sin(0.7) * (normal if slides else across)
        lower = rng.uniform(-2.5, 1.0)
        limits = (0.0, 0.3) if slides else (lower, lower + rng.uniform(0.3, 2.5))
        rpy = self._rpy()
        frame = self.frame @ rotation(rpy)
        axis = frame.T @ axis * rng.choice((1.0, 1.0, 0.01, 30.0))
        name, link = self._joint(kind, parent, axis, rpy=rpy, limits=limits)
        self.arm.joints.append(name)
        return link

    def _locked(self, parent: str, *, fixed: bool = False) -> str:
        """Add a joint that is fixed, or held at its neutral value."""
        rng, axis = self.rng, self._direction()
        kind = "fixed" if fixed or rng.random() < 0.5 else rng.choice(("revolute", "prismatic"))
        lower = rng.choice((-1.0, -0.2, 0.1, 0.4, -0.9))
        limits = (lower, lower + rng.uniform(0.05, 0.5))
        name, link = self._joint(kind, parent, axis, limits=limits)
        if kind != "fixed":
            value = min(max(0.0, limits[0]), limits[1])
            self.arm.values[name] = value
            if kind == "revolute":
                self.frame = self.frame @ turned(axis, value)
        return link

    def _branch(self, parent: str) -> None:
        """Add links beside the arm, one of which may move."""
        frame = self.frame
        for _ in range(self.rng.randint(1, 2)):
            kind = self.rng.choice(("fixed", "revolute", "continuous", "prismatic"))
            name, parent = self._joint(kind, parent, self._direction(), limits=(-0.5, 0.5))
            if kind != "fixed":
                self.arm.values[name] = 0.0
        self.frame = frame

    def _joint(self, kind, parent, axis, *, limits, rpy=None) -> tuple[str, str]:
        """Add a joint and its link; all that follows stands in its frame."""
        rng, link = self.rng, self._link()
        rpy = self._rpy() if rpy is None else rpy
        self.frame = self.frame @ rotation(rpy)
        name = self._name("joint")
        node = ET.Element("joint", name=name, type=kind)
        xyz = [rng.uniform(0.05, 0.5) * rng.choice((1, -1)) for _ in range(3)]
        parts = [
            ET.Element("parent", link=parent),
            ET.Element("child", link=link),
            ET.Element("origin", xyz=_written(xyz), rpy=_written(rpy)),
            ET.Element("axis", xyz=_written(axis)),
        ]
        if kind != "fixed":
            parts.append(ET.Element("limit", effort="10", velocity="1"))
        if kind in ("revolute", "prismatic"):
            parts[-1].attrib.update(lower=repr(limits[0]), upper=repr(limits[1]))
        rng.shuffle(parts)
        node.extend(parts)
        self.nodes.append(node)
        return name, link

    def _link(self) -> str:
        name = self._name("link")
        self.nodes.append(ET.Element("link", name=name))
        return name

    def _name(self, what: str) -> str:
        name = f"{what}_{len(self.names)}"
        if self.strange and self.rng.random() < 0.5:
            name = self.rng.choice(NAMES)
        name = name if name not in self.names else f"{name} {len(self.names)}"
        self.names.add(name)
        return name

    def _direction(self) -> np.ndarray:
        vector = np.array([self.rng.gauss(0, 1) for _ in range(3)])
        return vector / np.linalg.norm(vector)

    def _rpy(self) -> tuple[float, float, float]:
        if self.rng.random() < 0.3:
            return (0.0, 0.0, 0.0)
        a, b, c = (self.rng.uniform(-math.pi, math.pi) for _ in range(3))
        return (a, b, c)


def _written(vector) -> str:
    return " ".join(repr(float(value)) for value in vector)
