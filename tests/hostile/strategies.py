"""Hostile bytes, numbers and names, as disks, editors, networks and enemies make them."""

import gzip
import re

from hypothesis import strategies as st

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
