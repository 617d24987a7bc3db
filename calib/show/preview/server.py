"""Server: a preview for a browser on this computer, and answers while a target is dragged."""

from __future__ import annotations

import json
import os
import secrets
import threading
import webbrowser
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from ...common.atomic import atomic_write
from ...common.rows import checked_rows
from ...common.wording import for_people, length_in_words
from ...errors import CalibError, OptionError
from ...model.model import Model
from ...samples.samples import Samples
from ..settings import SETTINGS
from .scene import Scene

_ADDRESS = "127.0.0.1"  # no other computer can reach it
_LONGEST = 10_000  # bytes of a question
_NONSENSE = (
    ValueError,
    TypeError,
    KeyError,
    AttributeError,
    CalibError,
    ArithmeticError,
)


def preview(
    model: Model,
    path: str | os.PathLike[str] | None = None,
    log: Samples | None = None,
    *,
    live: bool = False,
    port: int = 0,
    browse: bool = True,
) -> Preview:
    """Show the arm and its learned maps in a browser.

    Parameters
    ----------
    model : Model
    path : path-like, optional
        Write the page, which needs no network, into this file instead of showing it.
    log : Samples, optional
        Measured samples to show; without them a simulated model's are drawn again.
    live : bool
        Show a target that can be dragged, and every inverse solution for it.
    port : int
        Port of the page, 0 for any that is free.
    browse : bool
        Whether to open a browser.

    Returns
    -------
    Preview
        Its page is there, at `url`, until ``close()`` or the end of the program; `notes` are what
        the user should be told.

    Examples
    --------
    >>> import calib
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> with calib.preview(model, browse=False) as shown:
    ...     shown.url.startswith("http://127.0.0.1:")
    True
    """
    if live and path is not None:
        raise OptionError("`live` needs a running preview: expected it without a file")
    scene = Scene(model, log)
    page = scene.html(live=live).encode("utf-8")
    if path is not None:
        atomic_write(path, page)
        return Preview(Path(path).absolute().as_uri(), scene)
    try:
        server = _Server((_ADDRESS, port), _Handler)
    except (OSError, OverflowError) as error:
        raise OptionError(
            f"port {port} cannot be used ({getattr(error, 'strerror', None) or error})",
            hint="choose another, or none for any that is free",
            parameter="port",
            value=port,
        ) from error
    server.page = page
    server.scene = scene if live else None
    threading.Thread(target=server.serve_forever, args=(0.2,), daemon=True).start()
    shown = Preview(
        f"http://{_ADDRESS}:{server.server_address[1]}{server.place}", scene, server
    )
    if browse:
        webbrowser.open(shown.url)
    return shown


class Preview:
    """A page that is shown: `url`, where it is, and `notes`, what the user should be told."""

    def __init__(self, url: str, scene: Scene, server: _Server | None = None) -> None:
        self.url = url
        self.notes = tuple(scene.notes)
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
    page: bytes
    scene: Scene | None  # whose map answers questions

    def __init__(self, *how: Any) -> None:
        super().__init__(*how)
        # a secret, so that other pages in the same browser cannot ask
        self.place = f"/{secrets.token_urlsafe(12)}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stay quiet: browsers drop connections as they like."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 5.0  # a connection that says nothing for so long is closed [s]

    def do_GET(self) -> None:
        """Send the page."""
        if self.path == self.server.place:
            self._send(200, "text/html; charset=utf-8", self.server.page)
        else:
            self._send(404, "text/plain", b"not here")

    def do_POST(self) -> None:
        """Answer a question of the page."""
        scene = self.server.scene
        length = self.headers.get("Content-Length", "")
        small = length.isascii() and length.isdigit() and int(length[:9]) <= _LONGEST
        if self.path != f"{self.server.place}ask" or scene is None or not small:
            self._send(404, "text/plain", b"not here")
            return
        try:
            reply = _answer(scene, json.loads(self.rfile.read(int(length))))
            text = json.dumps(reply, allow_nan=False)
        except TimeoutError:
            raise
        except (RecursionError, *_NONSENSE) as error:
            self._send(400, "text/plain", str(error).encode())
            return
        self._send(200, "application/json", text.encode())

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Stay quiet."""

    def _send(self, status: int, kind: str, data: bytes) -> None:
        # against DNS rebinding: a page of another name, led here, asks in the user's browser
        if self.headers.get("Host", "").split(":")[0] not in (_ADDRESS, "localhost"):
            status = 404
            kind = "text/plain"
            data = b"not here"
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(data)


def _answer(scene: Scene, question: Mapping[str, object]) -> dict[str, object]:
    """Answer with every branch that reaches a point of the scene.

    question : "at", a point of the scene; what is off the drawn plane is left out
    Returns "reachable", "words", "target" (the point in the plane) and "branches", each
    with "joints" in the motor map's unit box, and transforms of "links".
    """
    model = scene.model
    about = model.about
    placement = scene.placements[0]
    point = checked_rows(question["at"], ("x", "y", "z"), "at")[0]
    x = placement.drop(point)
    solutions = model.solve_all(x)[0]
    reachable = bool(solutions.reachable.any())
    lines = [f"{len(solutions.q)} ways to reach it"]
    if not reachable:
        off = length_in_words(float(solutions.distance[0]), about.unit)
        lines = [f"out of reach, the nearest point is {off} away"]
    branches: list[dict[str, object]] = []
    for q, error in zip(solutions.q, solutions.expected_error, strict=True):
        if len(branches) == SETTINGS.branches:
            break
        values = []
        for name, value, kind in zip(
            about.joint_names, q, about.units_of_joints, strict=True
        ):
            factor, unit = for_people(kind)
            values.append(f"{name} {factor * value:.2f} {unit}")
        lines.append(", ".join(values))
        lines.append(f"expected error {length_in_words(float(error), about.unit)}")
        links = {}
        if scene.robot is not None:
            for name, frames in scene.robot.poses(q).items():
                links[name] = frames[0].T.ravel().tolist()
        unit_joints = model.motor.scale.to_unit(q[None])[0]
        branches.append({"joints": unit_joints.tolist(), "links": links})
    return {
        "reachable": reachable,
        "words": "\n".join(lines),
        "target": placement.lift(x)[0].tolist(),
        "branches": branches,
    }
