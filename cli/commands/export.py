"""The command `calib export`: write a model as one C99 header for controllers without Python."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Option

from .. import options as opt
from ..options import Text, option
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
    *,
    output: Annotated[Text, option("--output -o FILE", "C header; JSON of --lerobot.")] = None,
    single: Annotated[bool, Option("--float", help="Single precision.")] = False,
    prefix: Annotated[str, option("--prefix NAME", "Prefix of every name in C.")] = "calib_",
    camera: Annotated[Text, option("--camera FILE.yaml", "The lens as ROS camera_info.")] = None,
    transform: Annotated[Text, option("--transform FILE.json", "The sensor in the base.")] = None,
    lerobot: Annotated[Text, option("--lerobot OLD.json", "LeRobot's: -o has new zeros.")] = None,
    ur: Annotated[Text, option("--ur FILE.yaml", "Kinematics of a UR, as ROS reads them.")] = None,
    mjcf: Annotated[Text, option("--mjcf FILE.xml", "Bodies, joints, tip for MuJoCo.")] = None,
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
    from calib.use.formats import (
        c_header,
        camera_info,
        corrected_arm,
        homed,
        mjcf_text,
        static_transform,
        ur_kinematics,
    )

    loaded, document = calib.load(model), dict[str, Any](model=model)
    made: dict[str, tuple[str, str]] = {}  # text, and what it is; all before anything is written
    if lerobot is not None and output is None:
        raise BadOption("--lerobot needs -o NEW.json, where the corrected calibration goes")
    if {lerobot, ur, mjcf} != {None}:
        corrected, document["offsets"] = corrected_arm(loaded)
        if ur is not None:
            made["ur"] = ur_kinematics(corrected, loaded.about.tip), "kinematics of a UR"
        if mjcf is not None:
            made["mjcf"] = mjcf_text(corrected, loaded.about.tip), "bodies for MuJoCo"
        if lerobot is not None:
            text, document["ticks"] = homed(lerobot, document["offsets"])
            made["output"] = text, f"homing offsets moved by {document['ticks']} ticks"
            say(["the ends of the motors' ranges move with their zeros: drive to them with care"])
    if output is not None and lerobot is None:
        text, tables = c_header(loaded, prefix=prefix, single=single)
        document |= {"bytes": len(text), "table_bytes": tables}
        size = f"tables of {tables / 1024:.1f} kB, {len(text) / 1e3:.0f} kB text"
        made["output"] = text, f"{'float' if single else 'double'}, {size}"
    if camera is not None:
        made["camera"] = camera_info(loaded), "camera_info"
    if transform is not None:
        made["transform"] = static_transform(loaded), "static transform"
    for name, (text, _) in made.items():
        # names of joints may hold any letter, a C99 compiler need not take them in comments
        ascii_alone = name == "output" and lerobot is None
        atomic_write(paths[name], text.encode(*(("ascii", "replace") if ascii_alone else ())))
    lines = [f"{path}: {made[name][1]}" for name, path in paths.items()]
    return Outcome(document | paths, lines, result=lines)
