"""The command `calib report`: write figures and tables that explain a calibration."""

from __future__ import annotations

from pathlib import Path

from ..measurements import Reading
from ..options import takes
from ..output import Notes, tell
from ..photo import Drawn
from ..usage import BadOption, check_file, option


@takes(
    output=option("--output -o FILE.html", "The report, in one file."),
    png=option("--png DIR", "Write its figures as PNG into this folder."),
)
def report(
    *,
    model: str,
    output: str | None = None,
    png: str | None = None,
    reading: Reading,
    drawn: Drawn,
) -> None:
    """Write figures and tables that explain a calibration."""
    if output is None and png is None:
        raise BadOption("nothing to write: expected -o FILE.html, or --png DIR, or both")
    if output is not None:
        check_file(output)
    notes = Notes()
    loaded, log = drawn.load(model, reading, notes)
    from calib.common.atomic import atomic_write
    from calib.show.report.drawing import to_png
    from calib.show.report.page import figures
    from calib.show.report.page import report as write_report

    if output is not None:
        write_report(loaded, output, log)
        tell(f"{output}: {Path(output).stat().st_size / 1e6:.2f} MB, open it in a browser")
    if png is not None:
        folder = Path(png)
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures(loaded, log).items():
            path = folder / f"{name}.png"
            atomic_write(path, to_png(figure))
            tell(str(path))
