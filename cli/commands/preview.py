"""The command `calib preview`: show the arm and its learned maps in a browser."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from .. import parsing
from ..measurements import Reading
from ..options import takes
from ..output import Notes, note, tell
from ..photo import Drawn
from ..usage import BadOption, check_file, flag, option


@takes(
    html=option("--html FILE", "Write the page into a file, which needs no network, and end."),
    meshes=option(
        "--meshes FOLDER", "Folder of the URDF's mesh files; nothing outside of it is read."
    ),
    port=option(
        "--port N", "Port of the page (default: any free port).", parsing.integer(0, 65535)
    ),
    no_open=flag("--no-open", "Print the address and open no browser."),
    live=flag("--live", "Show a target that can be dragged, and every inverse solution for it."),
)
def preview(
    *,
    model: str,
    html: str | None = None,
    reading: Reading,
    drawn: Drawn,
    meshes: str | None = None,
    port: int = 0,
    no_open: bool = False,
    live: bool = False,
) -> None:
    """Show the arm and its learned maps in a browser, with meshcat."""
    from calib.show.preview.server import preview as show

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    if html is not None:
        check_file(html)
    notes = Notes()
    loaded, log = drawn.load(model, reading, notes)
    options: dict[str, Any] = {"live": live, "meshes": meshes, "port": port}
    with show(loaded, html, log, **options, browse=not no_open) as shown:
        notes.say(shown.notes)
        if html is not None:
            tell(f"{html}: {Path(html).stat().st_size / 1e6:.2f} MB, open it in a browser")
            return
        try:
            print(shown.url, flush=True)
            note("showing the preview; Ctrl-C ends it")
            while True:
                time.sleep(0.2)  # so often it looks whether it shall end [s]
        except KeyboardInterrupt:
            note("ended")
