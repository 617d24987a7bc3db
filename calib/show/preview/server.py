"""Server: a preview for a browser on this computer."""

from __future__ import annotations

import json
import secrets
import threading
import webbrowser
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path

from ...common.atomic import FilePath, atomic_write
from ...common.wording import fill_template
from ...errors import OptionError, require
from ...model.model import Model
from ...recording.rig import HandEye
from ...samples.samples import Samples
from .scene import data_of_model, data_of_rig

_ADDRESS = "127.0.0.1"  # no other computer can reach it


def preview(
    model: Model | HandEye,
    path: FilePath | None = None,
    log: Samples | None = None,
    *,
    port: int = 0,
    browse: bool = True,
) -> Preview:
    """Show the arm and its learned maps in a browser.

    Parameters
    ----------
    model : Model or HandEye
    path : path-like, optional
        Write the page, which needs no network, into this file instead of showing it.
    log : Samples, optional
        Measured samples to show; without them a simulated model's are drawn again.
    port : int
        Port of the page, 0 for any that is free.
    browse : bool
        Whether to open a browser.

    Returns
    -------
    Preview
        Its page is there, at `url`, until ``close()`` or the end of the program.

    Examples
    --------
    >>> import calib
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> with calib.preview(model, browse=False) as shown:
    ...     shown.url.startswith("http://127.0.0.1:")
    True
    """
    if isinstance(model, HandEye):
        data = data_of_rig(model)
    else:
        require("model", model, Model)
        data = data_of_model(model, log)
    page = page_of(data).encode("utf-8")
    if path is not None:
        atomic_write(path, page)
        return Preview(Path(path).absolute().as_uri())
    shown = _serve(page, port)
    if browse:
        webbrowser.open(shown.url)
    return shown


def _serve(page: bytes, port: int) -> Preview:
    """Show a page at an address of this computer; OptionError if the port cannot be used."""
    try:
        server = _Server(port, page)
    except (OSError, OverflowError) as error:
        raise OptionError(
            f"port {port} cannot be used ({getattr(error, 'strerror', None) or error})",
            hint="choose another, or none for any that is free",
            parameter="port",
            value=port,
        ) from error
    threading.Thread(
        target=server.serve_forever, args=(0.2,), daemon=True
    ).start()
    place = f"{_ADDRESS}:{server.server_address[1]}{server.place}"
    return Preview(f"http://{place}", server)


def page_of(data: Mapping[str, object]) -> str:
    """Return the page of a scene."""
    # not imported, which takes a quarter of a second
    package = find_spec("meshcat")
    assert package is not None  # noqa: S101 - it is required
    folder = Path(str(package.origin)).parent
    viewer = folder / "viewer" / "dist" / "main.min.js"
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return fill_template(
        __package__,
        "page.html",
        viewer=viewer.read_text(encoding="utf-8"),
        # a name that holds a closing tag must not end the script
        data=text.replace("<", "\\u003c"),
    )


class Preview:
    """A page that is shown at the address `url`."""

    def __init__(self, url: str, server: _Server | None = None) -> None:
        self.url = url
        self._server = server

    def close(self) -> None:
        """End the server; a page in a file stays."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    def __enter__(self) -> Preview:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Preview({self.url})"


class _Server(ThreadingHTTPServer):
    """Serves one page on the loopback interface until it is closed."""

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, port: int, page: bytes) -> None:
        super().__init__((_ADDRESS, port), _Handler)
        self.page = page
        # a secret, so that other pages in the same browser cannot ask
        self.place = f"/{secrets.token_urlsafe(12)}/"

    def handle_error(self, request: object, client_address: object) -> None:
        """Stay quiet: browsers drop connections as they like."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 5.0  # a connection that is silent for this long is closed [s]

    def do_GET(self) -> None:
        """Send the page."""
        if self.path != self.server.place:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.page)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(self.server.page)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Stay quiet."""
