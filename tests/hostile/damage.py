"""Damage to bytes and texts, as disks, editors, networks and enemies do it."""

import gzip
import re
from random import Random

NUMBERS = (
    "nan", "NaN", "inf", "-inf", "Infinity", "1e308", "-1e308", "1.7976931348623157e308",
    "1e999", "-1e999", "1e-320", "5e-324", "0", "-0.0", "", " ", "0x10", "1_000", "1,5", "1e",
    "--1", "+1", "1.", ".5", "１２", "٣", "9" * 400, "1e16", "-2147483649", "18446744073709551616",
    "0.1 0.2", "1/2", "1d3", "∞", "NA", "null", "None", "true", "-", "?", "-3.141592653589793",
    "1e-9", "180", "1e6",
)  # fmt: skip
"""Numbers, and what is typed where numbers are expected."""

NAMES = (
    "", " ", "../../x", "/etc/passwd", "\0", "a\0b", "x" * 300, "x" * 5000, "..", ".", "/", "-",
    "--help", "~", "$HOME", "`id`", "%s%n", "{0}", "a\nb", "a\tb", "a\rb", "\x1b[31m", "\u009b31m",
    "\u202eabc", "\u2028", "\ufeff", "ä", "手", "🤖", "e\u0301", "'", '"', "<b>", "&amp;", "]]>",
    "a,b", "a=b", "a:b", "a;b", "nul", "CON.calib", "x", "z", "universe", "nan", "0", "\\",
    "file:///etc/passwd", "http://127.0.0.1:9/x", "sensor", "tip", "\x1b]0;x\x07", "$\\foo$",
)  # fmt: skip
"""Names that lead elsewhere, break lines or mean something to somebody."""

_TOKENS = (b"\0", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\n", b'"', b"'", b",", b";",
           b"<", b">", b"&", b"{", b"}", b"[" * 50, b"\x1b[2J", b"\x80", b"\xc3\x28",
           b"\xed\xa0\x80", b"PAR1", b"\x00" * 64)  # fmt: skip
_ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7", "latin-1")


def damaged(rng: Random, data: bytes, most: int = 4) -> bytes:
    """Return bytes after one to `most` mutations."""
    for _ in range(rng.randint(1, most)):
        data = rng.choice((_flip, _span, _span, _insert, _insert, _renumber, _renumber, _renumber,
                           _rewrap))(rng, data)  # fmt: skip
    return data


def _flip(rng: Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 8) if data else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _span(rng: Random, data: bytes) -> bytes:
    """Leave out a part, repeat it, or cut all that follows."""
    start = rng.randint(0, len(data))
    end = min(len(data), start + rng.randint(0, len(data) if rng.random() < 0.2 else 64))
    return rng.choice((data[:start] + data[end:], data[:end] + data[start:end] * 2 + data[end:],
                       data[:start]))  # fmt: skip


def _insert(rng: Random, data: bytes) -> bytes:
    place = rng.randint(0, len(data))
    token = rng.choice(_TOKENS) if rng.random() < 0.7 else rng.randbytes(rng.randint(1, 40))
    return data[:place] + token + data[place:]


def _renumber(rng: Random, data: bytes) -> bytes:
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE]-?\d+)?", data[:200_000]))
    if not found:
        return data
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(NUMBERS).encode() + data[one.end() :]


def _rewrap(rng: Random, data: bytes) -> bytes:
    return rng.choice((
        lambda: gzip.compress(data, mtime=0),
        lambda: b"",
        lambda: data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"", b"\n\n", b"\0\n"))),
        lambda: bytes(len(data)),
        lambda: data + rng.choice((b" ", b"x", b"\0", b"\n")) * rng.choice((1, 1000, 300_000)),
        lambda: data.decode("utf-8", "replace").encode(rng.choice(_ENCODINGS), "replace"),
    ))()  # fmt: skip
