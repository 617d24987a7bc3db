"""The command `calib export`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from .. import options as opt
from ..output import Outcome, say
from ..parsing import BadOption, check_file

if TYPE_CHECKING:
    pass


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
        Option("--output", "-o", metavar="FILE", help="C header; JSON of --lerobot."),
    ] = None,
    single: Annotated[bool, Option("--float", help="Single precision.")] = False,
    small: Annotated[
        bool,
        Option("--small", help="No tables of bounds and starts, for little memory."),
    ] = False,
    prefix: Annotated[
        str, Option("--prefix", metavar="NAME", help="Prefix of every name in C.")
    ] = "calib_",
    camera: Annotated[
        str | None,
        Option("--camera", metavar="FILE.yaml", help="The lens as ROS camera_info."),
    ] = None,
    transform: Annotated[
        str | None,
        Option("--transform", metavar="FILE.json", help="The sensor in the base."),
    ] = None,
    lerobot: Annotated[
        str | None,
        Option("--lerobot", metavar="OLD.json", help="LeRobot's: -o has new zeros."),
    ] = None,
    ur: Annotated[
        str | None,
        Option(
            "--ur", metavar="FILE.yaml", help="Kinematics of a UR, as ROS reads them."
        ),
    ] = None,
    mjcf: Annotated[
        str | None,
        Option("--mjcf", metavar="FILE.xml", help="Bodies, joints, tip for MuJoCo."),
    ] = None,
    ros2: Annotated[
        str | None,
        Option("--ros2", metavar="FOLDER", help="A ROS 2 package that runs the model."),
    ] = None,
    free: opt.Free = "all",
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Write a model as one C99 header for controllers, or files for ROS, LeRobot and MuJoCo."""
    import calib
    from calib.common.atomic import atomic_write

    wanted = {
        "output": output,
        "camera": camera,
        "transform": transform,
        "ur": ur,
        "mjcf": mjcf,
    }
    paths = {name: path for name, path in wanted.items() if path is not None}
    if not paths and ros2 is None:
        raise BadOption(
            "nothing to write: expected -o FILE.h, --camera, --transform, --ur or --mjcf FILE, or "
            "--ros2 FOLDER"
        )
    endings = _ENDINGS if lerobot is None else {**_ENDINGS, "output": (".json",)}
    for name, path in paths.items():
        check_file(path, endings[name], option=f"--{name}")
    from calib.use import formats
    from calib.use.lerobot import homed
    from calib.use.ur import ur_kinematics

    loaded = calib.load(model)
    document = dict[str, Any](model=model)
    made: dict[
        str, tuple[str, str]
    ] = {}  # text, and what it is; all before anything is written
    if lerobot is not None and output is None:
        raise BadOption(
            "--lerobot needs -o NEW.json, where the corrected calibration goes"
        )
    if {lerobot, ur, mjcf} != {None}:
        corrected, document["offsets"] = formats.corrected_arm(
            loaded, drawn=free == "offsets"
        )
        if ur is not None:
            made["ur"] = (
                ur_kinematics(corrected, loaded.about.tip),
                "kinematics of a UR",
            )
        if mjcf is not None:
            made["mjcf"] = (
                formats.mjcf_text(corrected, loaded.about.tip),
                "bodies for MuJoCo",
            )
        if lerobot is not None:
            text, document["ticks"] = homed(lerobot, document["offsets"])
            made["output"] = text, f"homing offsets moved by {document['ticks']} ticks"
            say(
                [
                    "the ends of the motors' ranges move with their zeros: drive to them with care"
                ]
            )
    if output is not None and lerobot is None:
        text, tables = formats.c_header(
            loaded, prefix=prefix, single=single, small=small
        )
        document |= {"bytes": len(text), "table_bytes": tables}
        size = f"tables of {tables / 1024:.1f} kB, {len(text) / 1e3:.0f} kB text"
        made["output"] = text, f"{'float' if single else 'double'}, {size}"
    if camera is not None:
        made["camera"] = formats.camera_info(loaded), "camera_info"
    if transform is not None:
        made["transform"] = formats.static_transform(loaded), "static transform"
    for name, (text, _) in made.items():
        # names of joints may hold any letter, a C99 compiler need not take them in comments
        ascii_alone = name == "output" and lerobot is None
        atomic_write(
            paths[name], text.encode(*(("ascii", "replace") if ascii_alone else ()))
        )
    lines = [f"{path}: {made[name][1]}" for name, path in paths.items()]
    if ros2 is not None:
        from calib.use.ros2 import write_ros2_package

        files = write_ros2_package(loaded, ros2)
        document["ros2"] = ros2
        lines.append(f"{ros2}: a ROS 2 package of {len(files)} files")
    return Outcome(document | paths, lines)
