"""The command `calib report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from .. import options as opt
from ..camera import Drawn
from ..output import Outcome, progress_bar
from ..parsing import BadOption, check_file


def report(
    model: opt.ModelFile,
    output: Annotated[
        str | None, Option("--output", "-o", metavar="FILE.html", help="One file.")
    ] = None,
    png: Annotated[
        str | None, Option("--png", metavar="DIR", help="Its figures as PNG.")
    ] = None,
    figures: Annotated[
        str | None, Option("--figures", metavar="FOLDER", help="Its figures as SVG.")
    ] = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    data: opt.Data = None,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Write how accurate a calibration is, what is off, where and why, as one page."""
    drawn = Drawn(
        columns=columns,
        unit=unit,
        time_offset=time_offset,
        degrees=degrees,
        data=data,
        photo=photo,
        no_photo=no_photo,
    )
    if output is None and png is None and figures is None:
        raise BadOption(
            "nothing to write: expected -o FILE.html, --figures FOLDER or --png DIR"
        )
    check_file(output, (".html", ".htm"))
    loaded, log = drawn.load(model)
    import calib
    from calib.common.atomic import atomic_write
    from calib.show.report.drawing import to_file

    lines = []
    if output is not None:
        with progress_bar() as progress:
            lines.append(calib.report(loaded, output, log, progress=progress))
        lines.append(_page(output))
    for kind, folder in (("png", png), ("svg", figures)):
        if folder is None:
            continue
        Path(folder).mkdir(parents=True, exist_ok=True)
        for name, figure in calib.figures(loaded, log).items():
            path = Path(folder) / f"{name}.{kind}"
            atomic_write(path, to_file(figure, kind))
            lines.append(str(path))
    return Outcome({"output": output, "png": png, "figures": figures}, lines)


def _page(path: str) -> str:
    return f"{path}: {Path(path).stat().st_size / 1e6:.2f} MB, open it in a browser"
