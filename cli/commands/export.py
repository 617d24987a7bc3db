"""The command `calib export`: write a model as one C99 header for controllers without Python."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Option

from .. import options as opt
from ..options import option
from ..output import Outcome, say
from ..parsing import BadOption, check_file

_ENDINGS = {
    "output": (".h", ".hpp"),
    "camera": (".yaml", ".yml"),
    "transform": (".json",),
    "ur": (".yaml", ".yml"),
    "mjcf": (".xml",),
}
_ARMS = {"ur": "kinematics of a UR", "mjcf": "bodies for MuJoCo"}


def export(
    model: opt.ModelFile,
    *,
    output: Annotated[
        str | None, option("--output -o FILE", "The C header; with --lerobot JSON.")
    ] = None,
    single: Annotated[bool, Option("--float", help="Single precision.")] = False,
    prefix: Annotated[str, option("--prefix NAME", "Prefix of every name in C.")] = "calib_",
    camera: Annotated[
        str | None, option("--camera FILE.yaml", "Write the lens as ROS camera_info.")
    ] = None,
    transform: Annotated[
        str | None, option("--transform FILE.json", "Write the sensor's pose in the base frame.")
    ] = None,
    lerobot: Annotated[
        str | None, option("--lerobot OLD.json", "LeRobot's calibration; -o gets corrected zeros.")
    ] = None,
    ur: Annotated[
        str | None, option("--ur FILE.yaml", "Write the kinematics of a UR, as ROS reads them.")
    ] = None,
    mjcf: Annotated[
        str | None, option("--mjcf FILE.xml", "Write bodies, joints and the tip's site for MuJoCo.")
    ] = None,
) -> Outcome:
    """Write a model as one C99 header for controllers, or files for ROS, LeRobot and MuJoCo."""
    import calib
    from calib.common.atomic import atomic_write

    wanted = {"output": output, "camera": camera, "transform": transform, "ur": ur, "mjcf": mjcf}
    paths = {name: path for name, path in wanted.items() if path is not None}
    if not paths:
        raise BadOption(
            "nothing to write: expected -o FILE.h, --camera, --transform, --ur or --mjcf FILE"
        )
    endings = _ENDINGS if lerobot is None else {**_ENDINGS, "output": (".json",)}
    for name, path in paths.items():
        check_file(path, endings[name], option=f"--{name}")
    from calib.use.camera_files import camera_info, static_transform
    from calib.use.export_c import c_header

    loaded, document = calib.load(model), dict[str, Any](model=model)
    kinds = {"camera": "camera_info", "transform": "static transform", **_ARMS}
    contents: dict[str, bytes] = {}  # all of it is made before anything is written
    if lerobot is not None and output is None:
        raise BadOption("--lerobot needs -o NEW.json, where the corrected calibration goes")
    if lerobot is not None or {"ur", "mjcf"} & {*paths}:
        from calib.use.lerobot import homed, read_calibration
        from calib.use.robot_files import corrected_arm, mjcf_text, ur_kinematics

        motors = None if lerobot is None else read_calibration(lerobot)
        arm = corrected_arm(loaded)
        for name, make in (("ur", ur_kinematics), ("mjcf", mjcf_text)):
            if name in paths:
                contents[name] = make(arm).encode()
        document["offsets"] = arm.offsets
        if motors is not None:
            text, document["ticks"] = homed(motors, arm.offsets)
            contents["output"] = text.encode()
            kinds["output"] = f"homing offsets moved by {document['ticks']} ticks"
            say(["the ends of the motors' ranges move with their zeros: drive to them with care"])
    if output is not None and lerobot is None:
        header = c_header(loaded, prefix=prefix, single=single)
        # names of joints may hold any letter, a C99 compiler need not take them in comments
        contents["output"] = header.text.encode("ascii", "replace")
        size = len(contents["output"])
        document |= {"bytes": size, "table_bytes": header.tables}
        kilobytes = f"tables of {header.tables / 1024:.1f} kB, {size / 1e3:.0f} kB text"
        kinds["output"] = f"{'float' if single else 'double'}, {kilobytes}"
    for name, made in (("camera", camera_info), ("transform", static_transform)):
        if name in paths:
            contents[name] = made(loaded).encode()
    for name, path in paths.items():
        atomic_write(path, contents[name])
    lines = [f"{path}: {kinds[name]}" for name, path in paths.items()]
    return Outcome(document | paths, lines, result=lines)
