"""A ROS 2 package that runs a model: corrected trajectories, static transforms, diagnostics."""

import json
import os
import re
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

from ..common.atomic import FilePath, atomic_write
from ..common.wording import one_line
from ..errors import OptionError
from ..model.model import Model
from ..model_file.storage import to_bytes
from .exports import corrected_arm, static_transforms
from .geometry import Quantity

_NAME = re.compile(r"[a-z][a-z0-9_]{1,60}")
_XACRO = "http://www.ros.org/wiki/xacro"

_TEMPLATES = {
    "package.xml": "package.xml",
    "setup.py": "setup.py.in",
    "setup.cfg": "setup.cfg",
    "launch/{package}.launch.py": "launch.py.in",
    "{package}/node.py": "node.py.in",
}
"""Files of the package, and the template of each in `ros2_package`."""


def write_ros2_package(model: Model, folder: FilePath) -> list[Path]:
    """Write a package that `colcon build` takes, and return its files.

    Its node corrects whole trajectories, publishes where the sensor (and a board) is, and shows by
    diagnostics whether the last minutes' rows still fit the model.

    model : with a URDF, which trajectories are corrected from
    folder : its name is the package's
    Raises OptionError if the folder's name is no name for a package, or it holds something else,
    RobotError if the model has no URDF.
    """
    target = Path(folder)
    package = target.resolve().name
    why = ""
    is_ours = (target / "arm.calib").is_file()
    if not _NAME.fullmatch(package):
        why = (
            ": expected the name of a ROS package, small letters, digits and underscores, such as "
            "calib_corrector"
        )
    elif target.exists() and any(target.iterdir()) and not is_ours:
        why = " holds other files: give the name of a new one"
    if why:
        name = os.fspath(folder)
        raise OptionError(f"folder {name!r}{why}", parameter="ros2", value=name)
    contents = _contents(model, package)
    for name, content in contents.items():
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, content)
    return [target / name for name in contents]


def _contents(model: Model, package: str) -> dict[str, bytes]:
    """Return the content of each file by its path in the package."""
    robot = re.sub(r"[^\w .-]", "-", one_line(model.about.robot or "an arm"))
    templates = files("calib.use") / "ros2_package"
    contents: dict[str, bytes] = {}
    for path, template in _TEMPLATES.items():
        text = Template((templates / template).read_text(encoding="utf-8"))
        filled = text.substitute(package=package, robot=robot)
        contents[path.format(package=package)] = filled.encode()
    contents[f"{package}/__init__.py"] = b""
    contents[f"resource/{package}"] = b""
    contents["arm.calib"] = to_bytes(model)
    transforms: list[dict[str, object]] = []
    with suppress(OptionError):  # where no sensor's place is known
        transforms = static_transforms(model)
    contents["transforms.json"] = json.dumps(transforms, indent=2).encode()
    contents["offsets.xacro"] = offsets_xacro(corrected_arm(model)[1]).encode()
    return contents


def offsets_xacro(zeros: dict[str, Quantity]) -> str:
    """Return a property NAME_offset [rad or m] for each joint, to include into a xacro file.

    It is what has to be added to the joint's value, so that the drawing is true.
    """
    lines = [f'<robot xmlns:xacro="{_XACRO}">']
    for name, zero in zeros.items():
        value = repr(float(zero.value))
        attributes = (
            f"name={quoteattr(name + '_offset')} value={quoteattr(value)}"
        )
        lines.append(f"  <xacro:property {attributes}/>")
    return "\n".join([*lines, "</robot>"]) + "\n"
