"""Server: a preview for a browser on this computer, and answers while a target is dragged."""

from __future__ import annotations

import json
import os
import secrets
import threading
import webbrowser
from collections.abc import Mapping, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from ...common.atomic import atomic_write
from ...common.rows import checked_rows
from ...common.wording import for_people, length_in_words
from ...errors import CalibError, OptionError, require
from ...model.model import Model
from ...recording.rig import HandEye
from ...samples.samples import Samples
from ..settings import SETTINGS
from .page import page_of
from .rig_scene import data_of_rig
from .scene import Scene

_ADDRESS = "127.0.0.1"  # no other computer can reach it
_NONSENSE = (*(ValueError, TypeError, KeyError, RecursionError), CalibError)


def preview(
    model: Model | HandEye,
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
    model : Model or HandEye
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
        raise OptionError(
            "`live` needs a running preview: expected it without a file"
        )
    scene = None
    notes: list[str] = []
    if isinstance(model, HandEye):
        data = data_of_rig(model)
    else:
        require("model", model, Model)
        scene = Scene(model, log)
        data = scene.data
        notes = scene.notes
    page = page_of(data, live=live).encode("utf-8")
    if path is not None:
        atomic_write(path, page)
        return Preview(Path(path).absolute().as_uri(), notes)
    try:
        server = _Server(port, page, scene if live else None)
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
    shown = Preview(
        f"http://{_ADDRESS}:{server.server_address[1]}{server.place}",
        notes,
        server,
    )
    if browse:
        webbrowser.open(shown.url)
    return shown


class Preview:
    """A page that is shown: `url`, where it is, and `notes`, what the user should be told."""

    def __init__(
        self, url: str, notes: Sequence[str], server: _Server | None = None
    ) -> None:
        self.url = url
        self.notes = tuple(notes)
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

    def __init__(self, port: int, page: bytes, scene: Scene | None) -> None:
        super().__init__((_ADDRESS, port), _Handler)
        self.page = page
        self.scene = scene  # whose map answers questions
        # a secret, so that other pages in the same browser cannot ask
        self.place = f"/{secrets.token_urlsafe(12)}/"

    def handle_error(self, request: object, client_address: object) -> None:
        """Stay quiet: browsers drop connections as they like."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 5.0  # a connection that says nothing for so long is closed [s]

    def do_GET(self) -> None:
        """Send the page."""
        if self.path == self.server.place:
            self._send(200, "text/html; charset=utf-8", self.server.page)
        else:
            self._send(404)

    def do_POST(self) -> None:
        """Answer a question of the page."""
        scene = self.server.scene
        length = self.headers.get("Content-Length", "")
        small = length.isascii() and length.isdigit() and len(length) < 5
        if self.path != f"{self.server.place}ask" or scene is None or not small:
            self._send(404)
            return
        try:
            answer = _answer(scene, json.loads(self.rfile.read(int(length))))
        except TimeoutError:
            raise
        except _NONSENSE as error:
            self._send(400, "text/plain", str(error).encode())
            return
        self._send(200, "application/json", json.dumps(answer).encode())

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Stay quiet."""

    def _send(
        self, status: int, kind: str = "text/plain", data: bytes = b"not here"
    ) -> None:
        # against DNS rebinding: a page of another name, led here, asks in the user's browser
        if self.headers.get("Host", "").split(":")[0] not in (
            _ADDRESS,
            "localhost",
        ):
            status = 404
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
    unit = model.about.unit
    placement = scene.placements[0]
    point, _ = checked_rows(question["at"], ("x", "y", "z"), "at")
    x = placement.drop(point)
    (solutions,) = model.solve_all(x)
    reachable = bool(solutions.reachable.any())
    lines = [f"{len(solutions.q)} ways to reach it"]
    if not reachable:
        off = length_in_words(float(solutions.distance[0]), unit)
        lines = [f"out of reach, the nearest point is {off} away"]
    joints = solutions.q[: SETTINGS.branches]
    shares = model.motor.scale.to_unit(joints)
    poses = {} if scene.robot is None else scene.robot.poses(joints)
    branches = []
    for row, q in enumerate(joints):
        values = []
        for name, value, kind in zip(
            model.about.joint_names, q, model.about.units_of_joints, strict=True
        ):
            factor, shown = for_people(kind)
            values.append(f"{name} {factor * value:.2f} {shown}")
        lines.append(", ".join(values))
        error = length_in_words(float(solutions.expected_error[row]), unit)
        lines.append(f"expected error {error}")
        links = {
            link: frames[row].T.ravel().tolist()
            for link, frames in poses.items()
        }
        branches.append({"joints": shares[row].tolist(), "links": links})
    return {
        "reachable": reachable,
        "words": "\n".join(lines),
        "target": placement.lift(x)[0].tolist(),
        "branches": branches,
    }
