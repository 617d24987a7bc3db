"""The command `calib preview`: show the arm and its learned maps in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

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
    from calib.show.preview.page import html as page_of
    from calib.show.preview.scene import draw

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    if meshes is not None and not Path(meshes).is_dir():
        raise BadOption(f"--meshes {meshes!r}: expected the folder of the URDF's mesh files")
    if html is not None:
        check_file(html)
    notes = Notes()
    loaded, log = drawn.load(model, reading, notes)
    scene = draw(loaded, samples=log, meshes=None if meshes is None else Path(meshes))
    notes.say(scene.notes)
    page = page_of(scene, loaded, live=live)
    if html is not None:
        from calib.common.atomic import atomic_write

        content = page.encode("utf-8")
        atomic_write(html, content)
        tell(f"{html}: {len(content) / 1e6:.2f} MB, open it in a browser")
        return
    from calib.show.preview.server import Live, PreviewServer

    with PreviewServer(page, port, Live(loaded).answer if live else None) as server:
        print(server.url, flush=True)
        note("showing the preview; Ctrl-C ends it")
        if not no_open:
            webbrowser.open(server.url)
        try:
            # so often it looks whether it shall end; Ctrl-C waits no longer [s]
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            note("ended")
