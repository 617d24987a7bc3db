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
    from calib.show.report.page import pictures
    from calib.show.report.page import report as report_of

    if output is not None:
        content = report_of(loaded, log).encode("utf-8")
        atomic_write(output, content)
        tell(f"{output}: {len(content) / 1e6:.2f} MB, open it in a browser")
    if png is not None:
        folder = Path(png)
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in pictures(loaded, log).items():
            path = folder / f"{name}.png"
            atomic_write(path, picture)
            tell(str(path))
