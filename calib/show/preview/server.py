"""Server: a preview for a browser on this computer, and answers while a target is dragged."""

from __future__ import annotations

import json
import re
import secrets
import sys
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from ...common.wording import one_line
from ...errors import CalibError, OptionError, QueryError
from ...model.model import Model
from ..error_scale import length_in_words
from .arm import DrawnArm
from .placement import place_model

ADDRESS = "127.0.0.1"
"""The loopback interface: no other computer can reach it."""

_LONGEST = 10_000  # bytes of a question
_NONSENSE = (ValueError, TypeError, KeyError, AttributeError, CalibError)

_Reply = Callable[[dict[str, Any]], dict[str, Any]]


class PreviewServer(ThreadingHTTPServer):
    """Serves one page on the loopback interface until it is closed.

    port : 0 for any that is free
    answer : answers the page's questions, plain data to plain data

    Attributes
    ----------
    url : str
        Where a browser finds the page. It holds a secret, so that other pages in the
        same browser cannot ask.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, page: str, port: int = 0, answer: _Reply | None = None) -> None:
        try:
            super().__init__((ADDRESS, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise OptionError(
                f"port {port} cannot be used ({reason})",
                hint="choose another, or none for any that is free",
                parameter="port",
                value=port,
            ) from error
        self.page = page.encode("utf-8")
        self.answer = answer
        self.secret = secrets.token_urlsafe(12)
        self.url = f"http://{ADDRESS}:{self.server_address[1]}/{self.secret}/"

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Say in one line why a connection ended: browsers drop them as they like."""
        error = sys.exc_info()[1]
        self.tell(f"connection dropped ({type(error).__name__})")

    def tell(self, text: str) -> None:
        """Print a line on standard error."""
        if sys.stderr is not None:
            print(f"preview: {one_line(' '.join(text.split()))}", file=sys.stderr)


class _Handler(BaseHTTPRequestHandler):
    server: PreviewServer
    timeout = 5.0  # a connection that says nothing for so long is closed [s]

    def do_GET(self) -> None:
        """Send the page."""
        if self.path == f"/{self.server.secret}/":
            self._send(200, "text/html; charset=utf-8", self.server.page)
        elif self.path == "/favicon.ico":
            self._send(204, "image/x-icon", b"")
        else:
            self._send(404, "text/plain", b"not here")

    def do_POST(self) -> None:
        """Answer a question of the page."""
        answer = self.server.answer
        known = self.path == f"/{self.server.secret}/ask" and answer is not None
        length = self.headers.get("Content-Length", "")
        small = re.fullmatch(r"[0-9]{1,5}", length) and int(length) <= _LONGEST
        if not known or answer is None or not small:
            self._send(404, "text/plain", b"not here")
            return
        try:
            question = json.loads(self.rfile.read(int(length)))
            reply = json.dumps(answer(question), allow_nan=False).encode()
        except TimeoutError:
            raise
        except (ArithmeticError, RecursionError, *_NONSENSE) as error:
            self._send(400, "text/plain", str(error).encode())
            return
        self._send(200, "application/json", reply)

    def log_error(self, format: str, *args: Any) -> None:  # noqa: A002
        """Say in one line what went wrong with a connection."""
        self.server.tell(format % args)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Stay quiet."""

    def _send(self, status: int, kind: str, data: bytes) -> None:
        host = self.headers.get("Host", "")
        # against DNS rebinding: a page of another name, led here, asks in the user's browser
        if host.split(":")[0] not in (ADDRESS, "localhost"):  # a name that leads here
            status, kind, data = 404, "text/plain", b"not here"
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        if data:
            self.wfile.write(data)


_MOST = 12  # branches that are drawn


class Live:
    """Answers inverse queries of a page with a model's map."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._body = DrawnArm.of(model.about)
        self._placement = place_model(model, self._body)

    def answer(self, question: dict[str, Any]) -> dict[str, Any]:
        """Answer with every branch that reaches a point of the scene.

        question : "at", a point of the scene; what is off the drawn plane is left out
        Returns "reachable", "words", "target" (the point in the plane) and "branches", each
        with "words", "joints" in the motor map's unit box, and transforms of "links".
        """
        placement, model = self._placement, self._model
        about, unit = model.about, model.about.unit
        point = np.asarray(question["at"], dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise QueryError(f"a point of {point.size} numbers: expected three finite ones")
        # the plane's axes span two of three dimensions: least squares drops the third
        x = (point - placement.origin) @ np.linalg.pinv(placement.axes)
        found = model.solve_all(x[None])[0]
        reachable = bool(found.reachable.any())
        branches = []
        for q, error in zip(found.q[:_MOST], found.expected_error, strict=False):
            shown = [
                f"{name} {np.degrees(v):.2f}°" if turns else f"{name} {1e3 * v:.2f} mm"
                for name, turns, v in zip(about.joint_names, about.revolute, q, strict=True)
            ]
            poses = {} if self._body is None else self._body.poses(q)
            bound = length_in_words(float(error), unit)
            branches.append(
                {
                    "words": f"{', '.join(shown)}\nexpected error {bound}",
                    "joints": model.motor.scale.to_unit(q[None])[0].tolist(),
                    "links": {name: t[0].T.ravel().tolist() for name, t in poses.items()},
                }
            )
        words = f"{len(branches)} ways to reach it" if len(branches) > 1 else "one way to reach it"
        if not reachable:
            off = length_in_words(float(found.distance[0]), unit)
            words = f"out of reach, the nearest point is {off} away"
        target = placement.lift(x[None])[0].tolist()
        told = {"reachable": reachable, "words": words, "target": target}
        return {**told, "branches": branches}
