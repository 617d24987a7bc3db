"""The command `calib preview`: show the arm and its learned maps in a browser."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from .. import options as opt
from ..options import Text, option
from ..output import Outcome, note, say
from ..parsing import BadOption, check_file
from ..photo import Drawn


def preview(
    model: opt.ModelFile,
    *,
    html: Annotated[Text, option("--html FILE", "Write the page for any browser.")] = None,
    drawn: Drawn,
    port: Annotated[
        int, Option("--port", metavar="N", min=0, max=65535, help="Port of the page (0: any).")
    ] = 0,
    no_open: Annotated[bool, Option("--no-open", help="Print the address alone.")] = False,
    live: Annotated[bool, Option("--live", help="Drag a target, see all its solutions.")] = False,
) -> Outcome:
    """Show the arm and its learned maps in a browser, with meshcat."""
    from calib.show.preview.server import preview as show

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    check_file(html, (".html", ".htm"), option="--html")
    loaded, log = drawn.load(model)
    how: dict[str, Any] = {"live": live, "port": port, "browse": not no_open}
    with show(loaded, html, log, **how) as shown:
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
