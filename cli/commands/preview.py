"""The command `calib preview`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from .. import options as opt
from ..camera import Drawn
from ..output import Outcome, note, say
from ..parsing import BadOption, check_file, whole

if TYPE_CHECKING:
    pass


def preview(
    model: opt.ModelFile,
    html: Annotated[
        str | None,
        Option("--html", metavar="FILE", help="Write the page for any browser."),
    ] = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    data: opt.Data = None,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
    port: Annotated[
        int,
        Option(
            "--port", metavar="N", parser=whole(0, 65535), help="Of the page (0: any)."
        ),
    ] = 0,
    no_open: Annotated[
        bool, Option("--no-open", help="Print the address alone.")
    ] = False,
    live: Annotated[
        bool, Option("--live", help="Drag a target, see all its solutions.")
    ] = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Show the arm and its learned maps in a browser, with meshcat."""
    drawn = Drawn(
        columns=columns,
        unit=unit,
        time_offset=time_offset,
        degrees=degrees,
        data=data,
        photo=photo,
        no_photo=no_photo,
    )
    import calib

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    check_file(html, (".html", ".htm"), option="--html")
    loaded, log = drawn.load(model)
    how: dict[str, Any] = {"live": live, "port": port, "browse": not no_open}
    with calib.preview(loaded, html, log, **how) as shown:
        say(shown.notes)
        if html is not None:
            return Outcome(
                {"html": html, "bytes": Path(html).stat().st_size}, [_page(html)]
            )
        try:
            print(shown.url, flush=True)
            note("showing the preview; Ctrl-C ends it")
            while True:
                time.sleep(0.2)  # so often it looks whether it shall end [s]
        except KeyboardInterrupt:
            note("ended")
    return Outcome({"url": shown.url})


def _page(path: str) -> str:
    return f"{path}: {Path(path).stat().st_size / 1e6:.2f} MB, open it in a browser"
