"""Source: templates of C filled with numbers.

They are in the folder `c`: C99 that is also valid C++, without allocation and without any library
but ``math.h``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

_CHOICE = re.compile(
    r"^#if @(\w+)@\n((?:(?!#if @|#endif\n|#else\n).*\n)*)(?:#else\n((?:(?!#if @|#endif\n).*\n)*))?"
    r"#endif\n",
    re.MULTILINE,
)
_NUMBER = re.compile(r"[-\d.][-+.e\d]*")
_BRACES = str.maketrans("[]", "{}")
_FUNCTIONS = re.compile(r"\b(cos|sin|sqrt|floor|fabs|atan2|pow)\(")


def source(*names: str) -> str:
    """Files of the C source, a blank line between them."""
    folder = files(__package__) / "c"
    return "\n".join(
        (folder / f"{name}.h").read_text(encoding="ascii") for name in names
    )


def c_source(
    text: str, words: Mapping[str, object], prefix: str, single: bool
) -> str:
    """C source with words such as ``@dof@`` and ``#if @word@`` filled in, and names' prefix."""
    while "#if @" in text:  # the innermost first
        text = _CHOICE.sub(
            lambda match: (match[2] if words.get(match[1]) else match[3]) or "",
            text,
        )
    filled = {
        name: c_number(value, single)
        if isinstance(value, float)
        else str(value)
        for name, value in words.items()
    }
    text = re.sub(r"@(\w+)@", lambda match: filled[match[1]], text)
    text = _FUNCTIONS.sub(r"\1f(", text) if single else text
    return text.replace("calib_", prefix).replace("CALIB_", prefix.upper())


def c_number(value: float, single: bool) -> str:
    """A C constant that reads back as the same number; infinities as what no value exceeds."""
    return braces(np.asarray(value, dtype=float), single)


def table(name: str, values: NDArray[np.generic], single: bool) -> str:
    """A constant array of C of any shape, braces round each row."""
    if not values.size:
        values = np.zeros(
            [max(size, 1) for size in values.shape], dtype=values.dtype
        )
    if values.dtype.kind == "i":
        kind = "int"
        text = str(values.tolist()).translate(_BRACES)
    else:
        kind = "calib_real"
        text = braces(values, single)
    return f"static const {kind} {name}{''.join(f'[{n}]' for n in values.shape)} = {text};\n"


def braces(values: NDArray[np.generic], single: bool) -> str:
    """Numbers in the braces of a C constant, row by row."""
    numbers = np.clip(
        np.nan_to_num(np.asarray(values, float), nan=3e38), -3e38, 3e38
    )
    text = str(numbers.tolist())
    if single:  # nine digits distinguish any two floats
        text = _NUMBER.sub(lambda match: _nine_digits(match[0]), text)
    return text.replace("], [", "],\n[").translate(_BRACES)


def _nine_digits(text: str) -> str:
    text = f"{np.float32(text):.9g}"
    # a C literal needs a point or an exponent
    return (text if any(c in text for c in ".e") else text + ".0") + "f"
