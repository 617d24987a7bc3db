"""Write a model as one C99 header for controllers, or files for ROS, LeRobot and MuJoCo."""

from __future__ import annotations

from typing import Annotated

from .. import options as opt
from ..output import Outcome, say
from ..parsing import BadOption, check_file

_ENDINGS = {
    "output": (".h", ".hpp"),
    "camera": (".yaml", ".yml"),
    "transform": (".json",),
    "ur": (".yaml", ".yml"),
    "mjcf": (".xml",),
}


def export(
    model: opt.ModelFile,
    output: Annotated[
        str | None,
        opt.value("--output -o", "FILE", "C header; JSON of --lerobot."),
    ] = None,
    single: Annotated[bool, opt.option("--float", "Single precision.")] = False,
    small: Annotated[
        bool,
        opt.option(
            "--small", "No tables of bounds and starts, for little memory."
        ),
    ] = False,
    prefix: Annotated[
        str, opt.value("--prefix", "NAME", "Prefix of every name in C.")
    ] = "calib_",
    camera: Annotated[
        str | None,
        opt.value("--camera", "FILE.yaml", "The lens as ROS camera_info."),
    ] = None,
    transform: Annotated[
        str | None,
        opt.value("--transform", "FILE.json", "The sensor in the base."),
    ] = None,
    lerobot: Annotated[
        str | None,
        opt.value("--lerobot", "OLD.json", "LeRobot's: -o has new zeros."),
    ] = None,
    ur: Annotated[
        str | None,
        opt.value(
            "--ur", "FILE.yaml", "Kinematics of a UR, as ROS reads them."
        ),
    ] = None,
    mjcf: Annotated[
        str | None,
        opt.value("--mjcf", "FILE.xml", "Bodies, joints, tip for MuJoCo."),
    ] = None,
    ros2: Annotated[
        str | None,
        opt.value("--ros2", "FOLDER", "A ROS 2 package that runs the model."),
    ] = None,
    free: opt.Free = "all",
    sensor: opt.OfSensor = "sensor",
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.use import formats
    from calib.use.lerobot import RANGES_MOVE, homed
    from calib.use.ros2 import write_ros2_package
    from calib.use.ur import ur_kinematics

    from ..query import model_in

    options = {
        "output": output,
        "camera": camera,
        "transform": transform,
        "ur": ur,
        "mjcf": mjcf,
    }
    paths = {name: path for name, path in options.items() if path is not None}
    if not paths and ros2 is None:
        raise BadOption(
            "nothing to write: expected -o FILE.h, --camera, --transform, --ur or --mjcf FILE, or "
            "--ros2 FOLDER"
        )
    for name, path in paths.items():
        calibration = name == "output" and lerobot is not None
        endings = (".json",) if calibration else _ENDINGS[name]
        check_file(path, endings, option=f"--{name}")
    if lerobot is not None and output is None:
        raise BadOption(
            "--lerobot needs -o NEW.json, where the corrected calibration goes"
        )
    loaded = model_in(model, sensor)
    tip = loaded.about.tip
    document: dict[str, object] = {"model": model}
    texts: dict[str, str] = {}  # all are made before anything is written
    words: dict[str, str] = {}
    if lerobot or ur or mjcf:
        corrected, zeros = formats.corrected_arm(
            loaded, drawn=free == "offsets"
        )
        offsets = {name: float(zero.value) for name, zero in zeros.items()}
        widths = {name: float(zero.interval) for name, zero in zeros.items()}
        document |= {"offsets": offsets, "intervals": widths}
        if ur is not None:
            texts["ur"] = ur_kinematics(corrected, tip)
            words["ur"] = "kinematics of a UR"
        if mjcf is not None:
            texts["mjcf"] = formats.mjcf_text(corrected, tip)
            words["mjcf"] = "bodies for MuJoCo"
        if lerobot is not None:
            texts["output"], ticks = homed(lerobot, offsets)
            words["output"] = f"homing offsets moved by {ticks} ticks"
            document["ticks"] = ticks
            say([RANGES_MOVE])
    if output is not None and lerobot is None:
        text, tables = formats.c_header(
            loaded, prefix=prefix, single=single, small=small
        )
        # names of joints may hold any letter, a C99 compiler need not take them in comments
        texts["output"] = text.encode("ascii", "replace").decode()
        document |= {"bytes": len(text), "table_bytes": tables}
        size = (
            f"tables of {tables / 1024:.1f} kB, {len(text) / 1e3:.0f} kB text"
        )
        words["output"] = f"{'float' if single else 'double'}, {size}"
    if camera is not None:
        texts["camera"] = formats.camera_info(loaded)
        words["camera"] = "camera_info"
    if transform is not None:
        texts["transform"] = formats.static_transform(loaded)
        words["transform"] = "static transform"
    for name, text in texts.items():
        atomic_write(paths[name], text.encode())
    lines = [f"{path}: {words[name]}" for name, path in paths.items()]
    if ros2 is not None:
        files = write_ros2_package(loaded, ros2)
        document["ros2"] = ros2
        lines.append(f"{ros2}: a ROS 2 package of {len(files)} files")
    return Outcome({**document, **paths}, lines)
