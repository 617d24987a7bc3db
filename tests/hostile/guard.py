"""Guard: what an input may open and say."""

import os
import sys
import tempfile
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hypothesis import settings

import calib

LENGTH = int(os.environ.get("CALIB_FUZZ", "1"))
"""How many times the usual number of inputs; more than once they are drawn anew."""

LONGEST = 2_000
"""Characters of an error message."""

_FORBIDDEN = ("socket.connect", "socket.getaddrinfo", "socket.sendto", "socket.bind",
              "urllib.Request", "http.client.connect", "ftplib.connect", "subprocess.Popen",
              "os.system", "os.exec", "os.posix_spawn", "os.fork", "webbrowser.open",
              "pty.spawn")  # fmt: skip
_LIBRARIES = tuple(
    str(Path(path).resolve())
    for path in (sys.prefix, sys.base_prefix, *sys.path, Path(__file__).parents[2])
    if path
)
_SPOOLED = str(Path(tempfile.gettempdir()).resolve() / "calib-")  # standard input is kept there
_FONTS = (str(Path.home() / ".cache"), str(Path.home() / ".config"),
          os.environ.get("MPLCONFIGDIR") or "/usr/share/fonts")  # fmt: skip
_SYSTEM = (*_FONTS, _SPOOLED, "/usr/share/fonts", "/proc/", "/sys/", "/dev/", "/etc/localtime",
           "/usr/share/zoneinfo")  # fmt: skip


def inputs(n: int) -> settings:
    """Judge `n` inputs, the same ones each time; times `CALIB_FUZZ`, then others each time."""
    return settings(max_examples=n * LENGTH, derandomize=LENGTH == 1)


class _Watch:
    """State of the audit hook, of which a process can have only one."""

    allowed: tuple[str, ...] = ()  # nothing is watched where it is empty
    seen: tuple[str, ...] = ()
    hooked = False

    @classmethod
    def hook(cls, event: str, args: tuple[object, ...]) -> None:
        if not cls.allowed:
            return
        if event == "open" and isinstance(args[0], str | bytes | os.PathLike):
            path = os.fsdecode(args[0])
            if "\0" not in path and not os.path.realpath(path).startswith(cls.allowed):
                cls.seen += (f"open {path}",)
        elif event in _FORBIDDEN:
            cls.seen += (f"{event} {args!r:.200}",)


@contextmanager
def guarded(folder: Path, named: Iterable[str] = ()) -> Iterator[None]:
    """Allow files below `folder` and those `named`; no network, no processes."""
    if not _Watch.hooked:
        sys.addaudithook(_Watch.hook)
        _Watch.hooked = True
    given = (os.path.realpath(name) for name in (folder, *named) if "\0" not in str(name))
    _Watch.seen, _Watch.allowed = (), (*given, *_LIBRARIES, *_SYSTEM)
    try:
        yield
    finally:
        _Watch.allowed = ()
    assert not _Watch.seen, "; ".join(_Watch.seen[:5])


def one_line(text: str) -> str:
    """Return a message that is one printable line of bearable length, else raise."""
    assert not {unicodedata.category(c) for c in text} & {"Cc", "Zl", "Zp", "Cs"}, text[:200]
    assert text.strip()
    assert len(text) <= LONGEST, text[:500]
    assert "Traceback" not in text
    assert "internal error" not in text
    return text


def answer(path: Path, data: bytes, read: Callable, refusal: type[Exception] = calib.CalibError):
    """Read the content of a file under guard: an answer, or a refusal in one line."""
    path.write_bytes(data)
    try:
        with guarded(path.parent):
            return read(path)
    except refusal as error:
        return one_line(str(error))
