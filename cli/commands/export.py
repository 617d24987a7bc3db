"""The command `calib export`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options as o
from ..output import Notes, show_json, tell
from ..parsing import BadOption


def export(
    model: o.ModelArgument,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE.h", help="The C header to write.")
    ] = None,
    single: Annotated[
        bool, typer.Option("--float", help="Single precision, for microcontrollers.")
    ] = False,
    prefix: Annotated[
        str, typer.Option("--prefix", metavar="NAME", help="Prefix of every name in the header.")
    ] = "calib_",
    camera: Annotated[
        str | None,
        typer.Option("--camera", metavar="FILE.yaml", help="Write the lens as ROS camera_info."),
    ] = None,
    transform: Annotated[
        str | None,
        typer.Option(
            "--transform",
            metavar="FILE.json",
            help="Write the pose of the camera or tracker in the base frame as a static transform.",
        ),
    ] = None,
    as_json: o.JsonOption = False,
) -> None:
    """Write a model as one C99 header for controllers without Python, or its camera for ROS."""
    import calib
    from calib.common.atomic import atomic_write, check_writable

    wanted = {"--output": output, "--camera": camera, "--transform": transform}
    paths = {option: path for option, path in wanted.items() if path is not None}
    if not paths:
        raise BadOption("nothing to write: expected -o FILE.h, --camera FILE or --transform FILE")
    for option, path in paths.items():
        if path == "-":
            raise BadOption(f"{option} '-': expected a file")
        check_writable(path)
    loaded, document = calib.load(model), dict[str, Any](model=model)
    from calib.use.camera_files import camera_info, static_transform

    kinds: dict[str, Callable[[Any], str]] = {
        "--camera": camera_info,
        "--transform": static_transform,
    }
    texts = {option: kinds[option](loaded) for option in paths if option in kinds}
    if output is not None:
        from calib.use.export_c import c_header

        header = c_header(loaded, prefix=prefix, single=single)
        Notes().say(header.notes)
        atomic_write(output, header.text.encode("ascii", "replace"))
        size = Path(output).stat().st_size
        document |= {"output": output, "bytes": size, "table_bytes": header.tables}
        if not as_json:
            kind = "float" if single else "double"
            kilobytes = f"tables of {header.tables / 1024:.1f} kB, {size / 1e3:.0f} kB text"
            tell(f"{output}: {kind}, {kilobytes}")
    for option, text in texts.items():
        atomic_write(paths[option], text.encode())
        document[option.removeprefix("--")] = paths[option]
        if not as_json:
            what = "camera_info" if option == "--camera" else "static transform"
            tell(f"{paths[option]}: {what}")
    if as_json:
        show_json(document)
