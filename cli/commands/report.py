"""The command `calib report`: write figures and tables that explain a calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from .. import options as opt
from ..options import Text, option
from ..output import Outcome
from ..parsing import BadOption, check_file
from ..photo import Drawn


def report(
    model: opt.ModelFile,
    *,
    output: Annotated[Text, option("--output -o FILE.html", "One file.")] = None,
    png: Annotated[Text, option("--png DIR", "Its figures as PNG.")] = None,
    drawn: Drawn,
) -> Outcome:
    """Write figures and tables that explain a calibration."""
    if output is None and png is None:
        raise BadOption("nothing to write: expected -o FILE.html, or --png DIR, or both")
    check_file(output, (".html", ".htm"))
    loaded, log = drawn.load(model)
    from calib.common.atomic import atomic_write
    from calib.show.report.drawing import to_png
    from calib.show.report.page import figures
    from calib.show.report.page import report as write_report

    lines = []
    if output is not None:
        write_report(loaded, output, log)
        size = Path(output).stat().st_size / 1e6
        lines.append(f"{output}: {size:.2f} MB, open it in a browser")
    if png is not None:
        folder = Path(png)
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures(loaded, log).items():
            path = folder / f"{name}.png"
            atomic_write(path, to_png(figure))
            lines.append(str(path))
    return Outcome({"output": output, "png": png}, lines, result=lines)
