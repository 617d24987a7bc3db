"""The command `calib preview`: show the arm and its learned maps in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

from typer import Option

from .. import options as opt
from ..files import check_output
from ..measurements import Reading
from ..options import option
from ..output import Outcome, note, say
from ..parsing import BadOption
from ..photo import load_drawn


def preview(
    model: opt.Model,
    *,
    html: Annotated[
        str | None, option("--html FILE", "Write the page, which needs no network, and end.")
    ] = None,
    data: opt.Data = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    degrees: opt.LogDegrees = None,
    photo: opt.Photo = None,
    no_photo: opt.NoPhoto = False,
    meshes: Annotated[
        str | None, option("--meshes FOLDER", "Mesh files of the URDF; none from elsewhere.")
    ] = None,
    port: Annotated[
        int, Option("--port", metavar="N", min=0, max=65535, help="Port of the page (0: any).")
    ] = 0,
    no_open: Annotated[
        bool, Option("--no-open", help="Print the address and open no browser.")
    ] = False,
    live: Annotated[
        bool, Option("--live", help="Show a target that can be dragged, and all its solutions.")
    ] = False,
) -> Outcome:
    """Show the arm and its learned maps in a browser, with meshcat."""
    from calib.show.preview.page import html as page_of
    from calib.show.preview.scene import draw

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    if meshes is not None and not Path(meshes).is_dir():
        raise BadOption(f"--meshes {meshes!r}: expected the folder of the URDF's mesh files")
    check_output(html, (".html", ".htm"), option="--html")
    reading = Reading(columns, unit, degrees)
    loaded, log = load_drawn(model, data, photo, no_photo, reading)
    scene = draw(loaded, samples=log, meshes=None if meshes is None else Path(meshes))
    say(scene.notes)
    page = page_of(scene, loaded, live=live)
    if html is not None:
        from calib.common.atomic import atomic_write

        content = page.encode("utf-8")
        atomic_write(html, content)
        line = f"{html}: {len(content) / 1e6:.2f} MB, open it in a browser"
        return Outcome({"html": html, "bytes": len(content)}, [line])
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
    return Outcome({"url": server.url})
