"""The command `calib export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import options as o
from ..output import Notes, show_json
from ..parsing import BadOption


def export(
    model: o.ModelArgument,
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="FILE.h", help="The C header to write.")
    ],
    single: Annotated[
        bool, typer.Option("--float", help="Single precision, for microcontrollers.")
    ] = False,
    prefix: Annotated[
        str, typer.Option("--prefix", metavar="NAME", help="Starts every name in the header.")
    ] = "calib_",
    as_json: o.JsonOption = False,
) -> None:
    """Write a model as one C99 header for controllers without Python."""
    import calib
    from calib.common.atomic import atomic_write, check_writable
    from calib.use.export_c import c_header

    if output == "-":
        raise BadOption("--output '-': expected a file such as arm.h")
    check_writable(output)
    header = c_header(calib.load(model), prefix=prefix, single=single)
    Notes().say(header.notes)
    atomic_write(output, header.text.encode("ascii", "replace"))
    size = Path(output).stat().st_size
    if as_json:
        show_json({"model": model, "output": output, "bytes": size, "table_bytes": header.tables})
    else:
        kind = "float" if single else "double"
        print(
            f"{output}: {kind}, tables of {header.tables / 1024:.1f} kB, {size / 1e3:.0f} kB text"
        )
