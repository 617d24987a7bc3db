"""The command `calib export`."""

from __future__ import annotations

from pathlib import Path
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

    wanted = {"--output": output, "--camera": camera, "--transform": transform}
    paths = {option: path for option, path in wanted.items() if path is not None}
    if not paths:
        raise BadOption("nothing to write: expected -o FILE.h, --camera FILE or --transform FILE")
    for name, path in paths.items():
        if path == "-":
            raise BadOption(f"{name} '-': expected a file")
        check_writable(path)
    loaded, document, told = calib.load(model), dict[str, Any](model=model), list[str]()
    from calib.use.camera_files import camera_info, static_transform

    # all of it is made before anything is written
    camera_text = camera_info(loaded) if camera is not None else ""
    transform_text = static_transform(loaded) if transform is not None else ""
    if output is not None:
        from calib.use.export_c import c_header

        header = c_header(loaded, prefix=prefix, single=single)
        Notes().say(header.notes)
        atomic_write(output, header.text.encode("ascii", "replace"))
        size = Path(output).stat().st_size
        document |= {"output": output, "bytes": size, "table_bytes": header.tables}
        kind = "float" if single else "double"
        kilobytes = f"tables of {header.tables / 1024:.1f} kB, {size / 1e3:.0f} kB text"
        told.append(f"{output}: {kind}, {kilobytes}")
    if camera is not None:
        atomic_write(camera, camera_text.encode())
        document["camera"] = camera
        told.append(f"{camera}: camera_info")
    if transform is not None:
        atomic_write(transform, transform_text.encode())
        document["transform"] = transform
        told.append(f"{transform}: static transform")
    if as_json:
        show_json(document)
    else:
        for line in told:
            tell(line)
