"""The commands that show a model: `calib report` and `calib preview`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

from .. import options as opt
from ..options import Text, flag, option
from ..output import Outcome, note, say
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
    import calib
    from calib.common.atomic import atomic_write
    from calib.show.report.figures import to_png

    lines = []
    if output is not None:
        calib.report(loaded, output, log)
        size = Path(output).stat().st_size / 1e6
        lines.append(f"{output}: {size:.2f} MB, open it in a browser")
    if png is not None:
        folder = Path(png)
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in calib.figures(loaded, log).items():
            path = folder / f"{name}.png"
            atomic_write(path, to_png(figure))
            lines.append(str(path))
    return Outcome({"output": output, "png": png}, lines)


def preview(
    model: opt.ModelFile,
    *,
    html: Annotated[Text, option("--html FILE", "Write the page for any browser.")] = None,
    drawn: Drawn,
    port: Annotated[int, option("--port N", "Of the page (0: any).", min=0, max=65535)] = 0,
    no_open: Annotated[bool, flag("--no-open", "Print the address alone.")] = False,
    live: Annotated[bool, flag("--live", "Drag a target, see all its solutions.")] = False,
) -> Outcome:
    """Show the arm and its learned maps in a browser, with meshcat."""
    import calib

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    check_file(html, (".html", ".htm"), option="--html")
    loaded, log = drawn.load(model)
    how: dict[str, Any] = {"live": live, "port": port, "browse": not no_open}
    with calib.preview(loaded, html, log, **how) as shown:
        say(shown.notes)
        if html is not None:
            size = Path(html).stat().st_size
            line = f"{html}: {size / 1e6:.2f} MB, open it in a browser"
            return Outcome({"html": html, "bytes": size}, [line])
        try:
            print(shown.url, flush=True)
            note("showing the preview; Ctrl-C ends it")
            while True:
                time.sleep(0.2)  # so often it looks whether it shall end [s]
        except KeyboardInterrupt:
            note("ended")
    return Outcome({"url": shown.url})
