"""Robots: the catalogue of the URDF files that come with calib."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ..common.wording import quoted, suggestion
from ..errors import RobotError
from .robot_text import parse_xml, read_robot_text

_DESCRIPTION = re.compile(r"<!--\s*calib:\s*(.*?)\s*-->", re.DOTALL)


@dataclass(frozen=True)
class RobotEntry:
    """A bundled robot: its name, its active joints from base to tip, and what it is."""

    name: str
    joints: tuple[str, ...]
    dof: int
    description: str
    path: Path


def robots_folder() -> Path:
    """Folder of the bundled URDF files, installed or in a checkout."""
    package = Path(__file__).parent.parent
    installed = package / "_robots"
    if installed.is_dir():
        return installed
    return package.parent / "robots"


def list_robots() -> tuple[RobotEntry, ...]:
    """Return the bundled robots, sorted by name."""
    entries = []
    for path in sorted(robots_folder().glob("*.urdf")):
        text = read_robot_text(path)
        joints = tuple(
            joint.get("name", "")
            for joint in parse_xml(text).findall("joint")
            if joint.get("type") != "fixed"
        )
        comment = _DESCRIPTION.search(text)
        description = " ".join(comment[1].split()) if comment else ""
        entries.append(
            RobotEntry(path.stem, joints, len(joints), description, path)
        )
    return tuple(entries)


def resolve_robot(robot: str | Path) -> Path:
    """Return the file of a robot given as a bundled name or as a path.

    A bundled name wins over a file of the same name in the current folder (`./two_link`
    means the file).

    Raises RobotError if it is neither, with the names there are.
    """
    names = {path.stem: path for path in robots_folder().glob("*.urdf")}
    if isinstance(robot, str) and robot in names:
        return names[robot]
    path = Path(robot)
    try:
        if str(robot).strip() and path.exists():
            return path
    # a name too long for the file system, or with a null byte
    except (OSError, ValueError):
        pass
    raise RobotError(
        f"robot {quoted(str(robot))}: no such file and no bundled robot; give a path to a URDF, or "
        f"{suggestion(path.stem, sorted(names))}"
    )
