"""The command `calib preview`."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from .. import options as o
from .. import parsing
from ..measurements import log_for
from ..output import Notes, note, tell
from ..parsing import Columns
from ..photo import NoPhotoOption, PhotoOption, shown
from ..usage import BadOption, flag, option, refuse

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.samples.samples import Samples

MeshesOption = Annotated[
    str | None,
    option(
        "--meshes FOLDER",
        "Where the mesh files are that the URDF names; nothing outside of it is read.",
    ),
]
PortOption = Annotated[int, option("--port N", "Port (default any).", parsing.whole(0, 65535))]


def preview(
    model: o.ModelArgument,
    html: Annotated[
        str | None, option("--html FILE", "Write the page, which needs no network.")
    ] = None,
    data: o.DataOption = None,
    columns: o.ColumnsOption = None,
    degrees: o.LogDegreesOption = None,
    photo: PhotoOption = None,
    no_photo: NoPhotoOption = False,
    meshes: MeshesOption = None,
    port: PortOption = 0,
    no_open: Annotated[bool, flag("--no-open", "Print the address and open no browser.")] = False,
    live: Annotated[
        bool, flag("--live", "A target to drag, with every way of reaching it.")
    ] = False,
) -> None:
    """Show the arm and its learned maps in a browser, with meshcat."""
    import calib
    from calib.show.preview.page import html as page_of
    from calib.show.preview.scene import draw

    if live and html is not None:
        raise BadOption("--live needs a running preview: expected it without --html")
    folder = checked_folder(meshes)
    if html is not None:
        from .train import check_output

        check_output(html)
    loaded = calib.load(model)
    notes = Notes()
    log = log_of(loaded, data, columns, degrees, notes)
    loaded = shown(loaded, model, photo, no_photo, log, notes)
    scene = draw(loaded, samples=log, meshes=folder)
    notes.say(scene.notes)
    page = page_of(scene, loaded, live=live)
    if html is not None:
        from calib.common.atomic import atomic_write

        content = page.encode("utf-8")
        atomic_write(html, content)
        tell(f"{html}: {len(content) / 1e6:.2f} MB, open it in a browser")
        return
    _serve(loaded, page, port, no_open=no_open, live=live)


def _serve(model: Model, page: str, port: int, *, no_open: bool, live: bool) -> None:
    from calib.show.preview.server import PreviewServer

    answer = None
    if live:
        from calib.show.preview.live import Live

        answer = Live(model).answer
    with PreviewServer(page, port, answer) as server:
        print(server.url, flush=True)
        note("showing the preview; Ctrl-C ends it")
        if not no_open:
            webbrowser.open(server.url)
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            note("ended")


def checked_folder(meshes: str | None) -> Path | None:
    """Return the folder of the meshes, which has to be one."""
    if meshes is None:
        return None
    folder = Path(meshes)
    if not folder.is_dir():
        raise BadOption(f"--meshes {meshes!r}: expected the folder of the URDF's mesh files")
    return folder


def log_of(
    model: Model,
    data: str | None,
    columns: Columns | None,
    degrees: bool | None,
    notes: Notes,
) -> Samples | None:
    """Read a log of a model's own arm, None where none is given."""
    if data is None:
        of_logs = {"--columns": columns, "--degrees": degrees}
        refuse(of_logs, "applies to a log: expected --data LOG too")
        return None
    return log_for(model, data, columns, degrees, None, notes)
