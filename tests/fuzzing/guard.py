"""Guard: what an input may cost, read and say, and whether it did."""

from __future__ import annotations

import os
import signal
import socket
import sys
import tempfile
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

SECONDS = 5.0
"""Processor time that one input may take."""

MEMORY = 1 << 30
"""Memory that the process may occupy while it handles one input [bytes]."""

LONGEST = 2_000
"""Characters of an error message."""

_NETWORK = ("socket.connect", "socket.getaddrinfo", "socket.sendto", "socket.bind",
            "urllib.Request", "http.client.connect", "ftplib.connect")  # fmt: skip
_PROCESSES = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork",
              "webbrowser.open", "pty.spawn")  # fmt: skip
_LIBRARIES = tuple({str(Path(p).resolve()) for p in
                    (sys.prefix, sys.base_prefix, Path(__file__).parents[2])})  # fmt: skip
_SPOOLED = str(Path(tempfile.gettempdir()).resolve() / "calib-")  # standard input is kept there
_FONTS = ("/usr/share/fonts", str(Path.home() / ".cache"), str(Path.home() / ".config"),
          os.environ.get("MPLCONFIGDIR") or "/usr/share/fonts")  # fmt: skip
_SYSTEM = (
    *_FONTS,
    _SPOOLED,
    "/proc/",
    "/sys/",
    "/dev/null",
    "/dev/urandom",
    "/usr/share/zoneinfo",
    "/etc/localtime",
)


class Violation(AssertionError):  # noqa: N818
    """An input did what no input may do."""


class _TooLong(BaseException):
    """No Exception, so that nobody takes it for one of their own."""


class _Watch:
    """The state of the audit hook, of which a process can have only one."""

    def __init__(self) -> None:
        self.folder = ""
        self.allowed: tuple[str, ...] = ()
        self.seen: list[str] = []
        self.hooked = False

    def hook(self, event: str, args: tuple[object, ...]) -> None:
        if not self.folder:
            return
        if event == "open" and isinstance(args[0], str | bytes | os.PathLike):
            self._opened(os.fspath(args[0]))
        elif event in _NETWORK or event in _PROCESSES:
            self.seen.append(f"{event} {args!r:.200}")

    def _opened(self, path: str | bytes) -> None:
        text = os.fsdecode(path)
        if "\0" in text:
            return
        full = os.path.realpath(text)
        allowed = (self.folder, *_LIBRARIES, *_SYSTEM, *self.allowed)
        # a name that the user typed may be a device; what else is read was not asked for
        if not full.startswith(allowed) and not full.startswith("/dev/"):
            self.seen.append(f"open {text}")


_WATCH = _Watch()


def _too_long(_signal: int, _frame: FrameType | None) -> None:
    raise _TooLong


@contextmanager
def guarded(
    folder: Path, named: Iterable[str] = (), seconds: float | None = None
) -> Iterator[None]:
    """Allow files below `folder` and those `named`, no network and no processes.

    Time and memory are bounded by `seconds` (`SECONDS`) and `MEMORY`.

    Raises
    ------
    Violation
        If the block did more.
    """
    if not _WATCH.hooked:
        sys.addaudithook(_WATCH.hook)
        _WATCH.hooked = True
    forget_peak()
    seconds = SECONDS if seconds is None else seconds
    previous = signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    _WATCH.allowed = tuple(os.path.realpath(name) for name in named if "\0" not in name)
    _WATCH.folder, _WATCH.seen = os.path.realpath(folder), []
    try:
        yield
    except _TooLong:
        raise Violation(f"took more than {seconds:g} s of processor time") from None
    finally:
        _WATCH.folder = ""
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, previous)
    if _WATCH.seen:
        raise Violation("; ".join(_WATCH.seen[:5]))
    if peak() > MEMORY:
        raise Violation(f"occupied {peak() / 1e6:.0f} MB")


def forget_peak() -> None:
    """Let the system measure the peak of memory anew, where it can (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak() -> int:
    """Largest resident memory since `forget_peak` [bytes], 0 where it is not known."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return 0
    line = next((line for line in status.splitlines() if line.startswith("VmHWM")), "VmHWM: 0")
    return int(line.split()[1]) * 1024


def one_line(text: str) -> str:
    """Return a message that is one printable line of bearable length, else raise."""
    controls = [c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp", "Cs")]
    if controls:
        raise Violation(f"{controls[0]!r} in a message: {text[:200]!r}")
    if not text.strip() or len(text) > LONGEST:
        raise Violation(f"a message of {len(text)} characters: {text[:200]!r}")
    if "Traceback" in text or "internal error" in text:
        raise Violation(text[:1000])
    return text


class Trap:
    """A secret file and a server that nothing may touch, watched by the system itself.

    Python's audit hooks do not see what compiled libraries open; inotify does (Linux).
    """

    def __init__(self, folder: Path) -> None:
        self.secret = folder / "secret.stl"
        self.secret.write_text("solid secret\n")
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self.port = self._server.getsockname()[1]
        self._events = _inotify(self.secret)

    def check(self) -> None:
        """Raise if the secret was opened or the server called since the last check."""
        if self._events is not None:
            try:
                if os.read(self._events, 4096):
                    raise Violation("the secret file was opened")
            except BlockingIOError:
                pass
        try:
            self._server.accept()[0].close()
        except BlockingIOError:
            return
        raise Violation("the server was called")

    def close(self) -> None:
        """Let go of the server and the watch."""
        self._server.close()
        if self._events is not None:
            os.close(self._events)


def _inotify(path: Path) -> int | None:
    import ctypes

    try:
        libc = ctypes.CDLL(None)
        handle = libc.inotify_init1(os.O_NONBLOCK)
        opened, accessed = 0x20, 0x1
        if handle < 0 or libc.inotify_add_watch(handle, os.fsencode(path), opened | accessed) < 0:
            return None
    except (AttributeError, OSError):  # another system
        return None
    return int(handle)
