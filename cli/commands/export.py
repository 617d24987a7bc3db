"""The command `calib export`: write a model as one C99 header for controllers without Python."""

from __future__ import annotations

from typing import Any

from ..options import takes
from ..output import Notes, show_json, tell
from ..usage import BadOption, flag, option


@takes(
    output=option("--output -o FILE.h", "The C header to write."),
    single=flag("--float", "Single precision, for microcontrollers."),
    prefix=option("--prefix NAME", "Prefix of every name in the header."),
    camera=option("--camera FILE.yaml", "Write the lens as ROS camera_info."),
    transform=option(
        "--transform FILE.json",
        "Write the pose of the camera or tracker in the base frame as a static transform.",
    ),
)
def export(
    model: str,
    output: str | None = None,
    single: bool = False,
    prefix: str = "calib_",
    camera: str | None = None,
    transform: str | None = None,
    as_json: bool = False,
) -> None:
    """Write a model as one C99 header for controllers without Python, or its camera for ROS."""
    import calib
    from calib.common.atomic import atomic_write, check_writable

    wanted = {"output": output, "camera": camera, "transform": transform}
    paths = {name: path for name, path in wanted.items() if path is not None}
    if not paths:
        raise BadOption("nothing to write: expected -o FILE.h, --camera FILE or --transform FILE")
    for name, path in paths.items():
        if path == "-":
            raise BadOption(f"--{name} '-': expected a file")
        check_writable(path)
    from calib.use.camera_files import camera_info, static_transform
    from calib.use.export_c import c_header

    loaded, document = calib.load(model), dict[str, Any](model=model)
    kinds = {"camera": "camera_info", "transform": "static transform"}
    contents: dict[str, bytes] = {}  # all of it is made before anything is written
    if output is not None:
        header = c_header(loaded, prefix=prefix, single=single)
        Notes().say(header.notes)
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
        document[name] = path
    if as_json:
        show_json(document)
    else:
        for name, path in paths.items():
            tell(f"{path}: {kinds[name]}")
