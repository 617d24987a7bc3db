"""Write a model as one C99 header for controllers, or files for ROS, LeRobot and MuJoCo."""

import json
from collections.abc import Mapping
from typing import Annotated, NamedTuple

from .. import options as opt
from ..output import Outcome, say
from ..parsing import BadOption, check_file
from ..units import units_of

_YAML = (".yaml", ".yml")


class File(NamedTuple):
    """A file to write."""

    path: str
    text: str
    words: str  # what it is


def export(
    model: opt.ModelFile,
    output: Annotated[
        str | None,
        opt.value("--output -o FILE", "C header; JSON of --lerobot."),
    ] = None,
    single: Annotated[bool, opt.option("--float", "Single precision.")] = False,
    small: Annotated[
        bool,
        opt.option(
            "--small", "No tables of bounds and starts, for little memory."
        ),
    ] = False,
    prefix: Annotated[
        str, opt.value("--prefix NAME", "Prefix of every name in C.")
    ] = "calib_",
    camera: Annotated[
        str | None,
        opt.value("--camera FILE.yaml", "The lens as ROS camera_info."),
    ] = None,
    transform: Annotated[
        str | None,
        opt.value("--transform FILE.json", "Where the sensor stands."),
    ] = None,
    lerobot: Annotated[
        str | None,
        opt.value("--lerobot OLD.json", "LeRobot's: -o has new zeros."),
    ] = None,
    ur: Annotated[
        str | None,
        opt.value("--ur FILE.yaml", "Kinematics of a UR, as ROS reads them."),
    ] = None,
    mjcf: Annotated[
        str | None,
        opt.value("--mjcf FILE.xml", "Bodies, joints, tip for MuJoCo."),
    ] = None,
    ros2: Annotated[
        str | None,
        opt.value("--ros2 FOLDER", "A ROS 2 package that runs the model."),
    ] = None,
    free: opt.Free = "all",
    sensor: opt.OfSensor = "sensor",
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.use import exports
    from calib.use.lerobot import RANGES_MOVE, with_corrected_zeros
    from calib.use.ros2 import write_ros2_package
    from calib.use.ur import ur_kinematics

    from ..query import model_in

    paths = {
        "output": output,
        "camera": camera,
        "transform": transform,
        "ur": ur,
        "mjcf": mjcf,
    }
    _check(paths, lerobot, ros2)
    loaded = model_in(model, sensor)
    document: dict[str, object] = {
        "model": model,
        "units": units_of(loaded.about),
    }
    # all are made before anything is written
    files: list[File] = []
    if lerobot or ur or mjcf:
        corrected, zeros = exports.corrected_arm(
            loaded, geometry_is_drawn=free == "offsets"
        )
        document |= {
            "offsets": {name: zero.value for name, zero in zeros.items()},
            "intervals": {name: zero.interval for name, zero in zeros.items()},
        }
    if output and lerobot:
        text, ticks = with_corrected_zeros(lerobot, zeros)
        files.append(
            File(output, text, f"homing offsets moved by {ticks} ticks")
        )
        document["ticks"] = ticks
        say([RANGES_MOVE])
    elif output:
        text, tables = exports.c_header(
            loaded, prefix=prefix, single=single, small=small
        )
        document |= {"bytes": len(text), "table_bytes": tables}
        files.append(_c_header(output, text, tables, single=single))
    if camera:
        files.append(File(camera, exports.camera_info(loaded), "camera_info"))
    if transform:
        frames = exports.static_transforms(loaded)
        transforms = frames if len(frames) > 1 else frames[0]
        text = json.dumps(transforms, indent=2) + "\n"
        files.append(File(transform, text, "static transform"))
    tip = loaded.about.tip
    if ur:
        text = ur_kinematics(corrected, tip)
        files.append(File(ur, text, "kinematics of a UR"))
    if mjcf:
        text = exports.mjcf_text(corrected, tip)
        files.append(File(mjcf, text, "bodies for MuJoCo"))
    lines = []
    for file in files:
        atomic_write(file.path, file.text.encode())
        lines.append(f"{file.path}: {file.words}")
    if ros2 is not None:
        package = write_ros2_package(loaded, ros2)
        document["ros2"] = ros2
        lines.append(f"{ros2}: a ROS 2 package of {len(package)} files")
    document |= {name: path for name, path in paths.items() if path}
    return Outcome(document, lines)


def _check(
    paths: Mapping[str, str | None], lerobot: str | None, ros2: str | None
) -> None:
    """Refuse files, by option, that cannot be written."""
    if lerobot is not None and paths["output"] is None:
        raise BadOption(
            "--lerobot needs -o NEW.json, where the corrected calibration goes"
        )
    if not any(paths.values()) and ros2 is None:
        raise BadOption(
            "nothing to write: expected -o FILE.h, --camera, --transform, --ur or --mjcf FILE, or "
            "--ros2 FOLDER"
        )
    endings = {
        "output": (".h", ".hpp") if lerobot is None else (".json",),
        "camera": _YAML,
        "transform": (".json",),
        "ur": _YAML,
        "mjcf": (".xml",),
    }
    for name, path in paths.items():
        check_file(path, endings[name], option=f"--{name}")


def _c_header(path: str, text: str, tables: int, *, single: bool) -> File:
    """The C header, and the size of its tables in bytes."""
    kind = "float" if single else "double"
    sizes = f"tables of {tables / 1024:.1f} kB, {len(text) / 1e3:.0f} kB text"
    # names of joints may hold any letter, a C99 compiler need not take them in comments
    ascii_text = text.encode("ascii", "replace").decode()
    return File(path, ascii_text, f"{kind}, {sizes}")
