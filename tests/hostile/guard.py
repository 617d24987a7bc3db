"""Hostile bytes, numbers and names, as disks, editors and enemies make them; and the guard."""

import gzip
import os
import re
import sys
import tempfile
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st

import calib

LENGTH = int(os.environ.get("CALIB_FUZZ", "1"))
"""How many times the usual number of inputs; more than once they are drawn anew."""
LONGEST = 2_000
"""Characters of an error message."""
_FORBIDDEN = ("socket.connect", "socket.getaddrinfo", "socket.sendto", "socket.bind",
              "urllib.Request", "http.client.connect", "ftplib.connect", "subprocess.Popen",
              "os.system", "os.exec", "os.posix_spawn", "os.fork", "webbrowser.open",
              "pty.spawn")  # fmt: skip
_INSTALLED = (sys.prefix, sys.base_prefix, *sys.path, Path(__file__).parents[2])
_LIBRARIES = tuple(str(Path(path).resolve()) for path in _INSTALLED if path)
_SPOOLED = str(Path(tempfile.gettempdir()).resolve() / "calib-")  # standard input is kept there
_FONTS = (str(Path.home() / ".cache"), str(Path.home() / ".config"),
          os.environ.get("MPLCONFIGDIR") or "/usr/share/fonts")  # fmt: skip
_SYSTEM = (*_FONTS, _SPOOLED, "/usr/share/fonts", "/proc/", "/sys/", "/dev/", "/etc/localtime",
           "/usr/share/zoneinfo")  # fmt: skip
NUMBERS = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.text("0123456789.eEx+-_,/ １٣∞", max_size=6),
    st.sampled_from(("", "NaN", "-Infinity", "1e999", "9" * 400, "NA", "null", "true", "1d3")),
)
"""Numbers, and what is typed where numbers are expected."""
NAMES = st.one_of(
    st.text(max_size=8),
    st.sampled_from((
        "../../x", "/etc/passwd", "a\0b", "x" * 5000, "..", "/", "-", "--help", "$HOME", "%s%n",
        "{0}", "a\nb", "\x1b[31m", "\u202eabc", "e\u0301", "🤖", "]]>", "a,b", "a=b", "CON.calib",
        "universe", "tip", "z", "nan", "http://127.0.0.1:9/x", "\x1b]0;x\x07", "$\\foo$",
    )),
)  # fmt: skip
"""Names that lead elsewhere, break lines or mean something to somebody."""
PARTS = st.one_of(
    st.binary(max_size=40),
    NUMBERS.map(lambda text: text.encode()),
    st.sampled_from((b"\0", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b'"', b";", b"[" * 50, b"\xed\xa0",
                     b"PAR1")),
)  # fmt: skip
"""What may stand in the place of a part of a file."""
WRAPPINGS = st.sampled_from((
    *[bytes] * 9,
    lambda data: gzip.compress(data, mtime=0),
    lambda data: data.replace(b"\n", b"\r\n"),
    lambda data: data.replace(b"\n", b""),
    lambda data: bytes(len(data)),
    lambda data: data + b"x" * 300_000,
    lambda data: data.decode("utf-8", "replace").encode("utf-16"),
    lambda data: data.decode("utf-8", "replace").encode("latin-1", "replace"),
))  # fmt: skip
"""What becomes of a file as a whole: mostly nothing."""


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


@st.composite
def damaged(draw, data: bytes, most: int = 4) -> bytes:
    """Bytes of which one to `most` parts were lost, repeated, flipped or replaced."""
    for _ in range(draw(st.integers(1, most))):
        numbers = [found.span() for found in re.finditer(rb"-?\d+(\.\d+)?", data[:200_000])]
        start = draw(st.integers(0, len(data)))
        length = draw(st.sampled_from((0, 1, 8, 64, len(data))))
        span = (start, min(len(data), start + length))
        if numbers:
            span = draw(st.sampled_from((span, numbers[start % len(numbers)])))
        kept = data[slice(*span)]
        flipped = bytes(byte ^ 1 for byte in kept)
        part = draw(PARTS | st.sampled_from((b"", kept * 2)) | st.just(flipped) | st.just(flipped))
        data = data[: span[0]] + part + data[span[1] :]
    return draw(WRAPPINGS)(data)
