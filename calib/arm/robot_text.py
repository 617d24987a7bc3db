"""Robot text: the text of a robot's description, checked before any library sees it.

Only the standard library's XML parser is used, and no NumPy: to list robots is light.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..common.wording import quoted
from ..errors import RobotError


@dataclass(frozen=True)
class Limits:
    """Limits on a description; more is a mistake in the file, or an attack."""

    size: int = 50_000_000  # [bytes]
    joints: int = 1_000  # links are followed by recursion
    # [m]; a slide that claims more states no usable limit
    travel: float = 1_000.0
    offset: float = 1e6  # [m]; further out a double has no micrometres left
    axis: float = 1e6  # length whose square overflows long before a double does
    mass: float = 1e5  # [kg]; heavier is no link of an arm


LIMITS = Limits()

_NUMBER = re.compile(
    r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|inf(inity)?)", re.IGNORECASE
)

_BEFORE_ROOT = re.compile(r"\s+|<!--.*?-->|<\?.*?\?>", re.DOTALL)

Vector = tuple[float, ...]

MJCF = "mujoco"
"""Root element of the other kind of description that is read, see `calib.arm.mjcf`."""


def read_robot_text(path: Path) -> str:
    """Read a URDF or MJCF file as text.

    Raises RobotError if it is missing, a folder, empty, not UTF-8, or larger than `LIMITS.size`.
    """
    try:
        if not path.is_file():  # some devices never end
            raise RobotError(
                f"{path.name}: is no file, expected a URDF or a bundled robot"
            )
        with path.open("rb") as file:
            text = file.read(LIMITS.size + 1).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(
            f"{path.name}: byte {error.start} is not UTF-8: expected a URDF, saved as UTF-8 text"
        ) from None
    except (OSError, ValueError) as error:
        raise RobotError(f"{path.name}: cannot be read: {error}") from None
    if not text.strip() or len(text) > LIMITS.size:
        size = f"{LIMITS.size // 1_000_000} MB"
        raise RobotError(
            f"{path.name}: is empty or above {size}, expected a URDF without its meshes"
        )
    return text


def parse_xml(text: str) -> ET.Element:
    """Root element of a robot's description.

    Raises RobotError if it is none, or holds what has to be expanded first.
    """
    # comments and instructions may come before it, and nothing else
    start = 0
    while before := _BEFORE_ROOT.match(text, start):
        start = before.end()
    if text.startswith("<!DOCTYPE", start):
        raise RobotError(
            "the URDF holds <!DOCTYPE: document types and entities are refused; remove it and "
            "write its values out"
        )
    expand = "expand xacro first, for example: xacro robot.xacro > robot.urdf"
    try:
        robot = ET.fromstring(text)  # noqa: S314 - entities were refused above
    except (ET.ParseError, ValueError) as error:
        remedy = "correct it there, or fetch a truncated file anew"
        if "<xacro:" in text:
            remedy = expand
        raise RobotError(
            f"the URDF is not well-formed XML ({error}): {remedy}"
        ) from None
    if robot.tag not in ("robot", MJCF):
        raise RobotError(
            f"the file's root element is <{robot.tag[:60]}>, expected <robot> or <mujoco>: convert "
            "SDF and other formats to URDF first"
        )
    for node in robot.iter():
        for word in (node.tag, *node.attrib.values()):
            if "xacro}" in word or "${" in word:
                raise RobotError(
                    f"the URDF still holds {quoted(word)}: {expand}"
                )
    return robot


class Attributes(dict[str, str]):
    """Attributes of an element, whose numbers are read as URDF libraries do, not as Python does.

    where : how messages name the element
    """

    def __init__(self, where: str, attributes: Mapping[str, str]) -> None:
        super().__init__(attributes)
        self.where = where

    def numbers(
        self, key: str, default: Vector, *, infinite: bool = False
    ) -> Vector:
        """The numbers of an attribute, as many as the default has."""
        text = self.get(key)
        if text is None:
            return default
        words = text.split()
        sound = len(words) == len(default) and all(
            map(_NUMBER.fullmatch, words)
        )
        values = tuple(map(float, words)) if sound else ()
        if not values or not (infinite or all(map(math.isfinite, values))):
            raise RobotError(
                f"{self.where}: {key} is {quoted(text)}, expected {len(default)} numbers"
            )
        return values

    def number(
        self, key: str, default: float = 0.0, *, infinite: bool = False
    ) -> float:
        """An attribute that is one number."""
        return self.numbers(key, (default,), infinite=infinite)[0]
