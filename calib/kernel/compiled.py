"""The compiled kernel: templates of C filled with numbers, and what a C compiler makes of them.

The source is in the folder `c`: C99 that is also valid C++, without allocation and without any
library but ``math.h``.
"""

from __future__ import annotations

import ctypes
import math
import os
import re
import shlex
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError

OFF = "CALIB_NO_CC"  # leaves the compiler alone where it is set to anything but 0

_FLAGS = ("-O2", "-std=c99", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
# where the compiler knows them: a bound of six joints takes 20 us for 41
_QUICKLY = (
    *("-ftree-vectorize", "-fvect-cost-model=dynamic"),
    *("-fno-inline-small-functions", "-fno-tree-pre"),
)
_PATIENT = 10  # niceness of a compiler that another thread than the main one calls
_MOST = 120.0  # s that a compiler may take
_MOST_JOINTS = 16
# where in a thread's buffer stand what is asked beside joints, `_PART` numbers each, and what
# answers, as in ``c/calls.h``
_ASKED, _PART, _FOUND, _SIZE = 16, 4, 32, 128

_CHOICE = re.compile(
    r"^#if @(\w+)@\n((?:(?!#if @|#endif\n|#else\n).*\n)*)(?:#else\n((?:(?!#if @|#endif\n).*\n)*))?"
    r"#endif\n",
    re.MULTILINE,
)
_NUMBER = re.compile(r"[-\d.][-+.e\d]*")
_BRACES = str.maketrans("[]", "{}")
_FUNCTIONS = re.compile(r"\b(cos|sin|sqrt|floor|fabs|atan2)\(")


def source(*names: str) -> str:
    """Files of the C source, one after another."""
    folder = files(__package__) / "c"
    return "".join((folder / f"{name}.h").read_text(encoding="ascii") for name in names)


def c_source(text: str, words: Mapping[str, object], prefix: str, single: bool) -> str:
    """C source with words such as ``@dof@`` and ``#if @word@`` filled in, and names' prefix."""
    while "#if @" in text:  # the innermost first
        text = _CHOICE.sub(lambda found: (found[2] if words[found[1]] else found[3]) or "", text)
    filled = {
        name: c_number(value, single) if isinstance(value, float) else str(value)
        for name, value in words.items()
    }
    text = re.sub(r"@(\w+)@", lambda found: filled[found[1]], text)
    text = _FUNCTIONS.sub(r"\1f(", text) if single else text
    return text.replace("calib_", prefix).replace("CALIB_", prefix.upper())


def c_number(value: float, single: bool) -> str:
    """A C constant that reads back as the same number; infinities as what no value exceeds."""
    return braces(np.asarray(value, dtype=float), single)


def table(name: str, values: NDArray[Any], single: bool, floats: bool = False) -> str:
    """A constant array of C of any shape, braces round each row; `floats` in any header."""
    if not values.size:
        values = np.zeros([max(size, 1) for size in values.shape], dtype=values.dtype)
    whole = values.dtype.kind == "i"
    text = str(values.tolist()).translate(_BRACES) if whole else braces(values, single or floats)
    kind = "int" if whole else "float" if floats else "calib_real"
    return f"static const {kind} {name}{''.join(f'[{n}]' for n in values.shape)} = {text};\n"


def braces(values: Array, single: bool) -> str:
    """Numbers in the braces of a C constant, row by row."""
    numbers = np.clip(np.nan_to_num(values, nan=3e38), -3e38, 3e38)
    text = str(numbers.tolist())
    if single:  # nine digits tell any two floats apart
        text = _NUMBER.sub(lambda found: _nine_digits(found[0]), text)
    return text.replace("], [", "],\n[").translate(_BRACES)


def _nine_digits(text: str) -> str:
    text = f"{np.float32(text):.9g}"
    # a C literal needs a point or an exponent
    return (text if any(c in text for c in ".e") else text + ".0") + "f"


class Compiled:
    """A shared library that answers single queries; every thread has buffers of its own."""

    def __init__(self, library: ctypes.CDLL, folder: Any, dof: int, outputs: int) -> None:
        self._folder, self._library, self._own = folder, library, threading.local()
        place = (outputs,)
        # sizes of what is asked beside joints, and shape of the answer
        self._shapes: dict[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
            "forward": ((), place), "jacobian": ((), (outputs, dof)), "bounds": ((), ()),
            "model_bounds": ((), ()), "inverse": (place, (dof,)), "inverse_pose": ((3, 4), (dof,)),
            "correct": ((), (1, dof)),
        }  # fmt: skip
        self._dof = dof

    def has(self, name: str) -> bool:
        """Whether it answers a kind of query."""
        return hasattr(self._library, f"called_{name}")

    def ask(self, name: str, joints: Any, *asked: Any) -> tuple[Any, int] | None:
        """The answer for joints (dof,) and what else is asked, and how sure, see ``c/calls.h``.

        None where a question is none: the batch refuses it in words.
        """
        try:
            call, address, place, parts, found = getattr(self._own, name)
        except AttributeError:
            setattr(self._own, name, self._prepared(name))
            return self.ask(name, joints, *asked)
        try:
            if len(joints) != self._dof:
                return None
            place[:] = joints
            if asked:
                for part, values in zip(parts, asked, strict=True):
                    if len(values) != len(part):
                        return None
                    part[:] = values
        except (TypeError, ValueError):
            return None
        said: int = call(address)
        if said != 1 and not all(math.isfinite(sum(part)) for part in (place, *parts)):
            return None
        return found.copy() if found.ndim else found[()], said

    def _prepared(self, name: str) -> tuple[Any, int, Array, tuple[Array, ...], Array]:
        """A function, the address of this thread's buffer for it, and parts of the buffer."""
        call = getattr(self._library, f"called_{name}")
        call.argtypes, call.restype = (ctypes.c_void_p,), ctypes.c_int
        asked, shape = self._shapes[name]
        whole = np.zeros(_SIZE)
        begins = range(_ASKED, _FOUND, _PART)
        parts = tuple(whole[a : a + size] for a, size in zip(begins, asked, strict=False))
        found = whole[_FOUND : _FOUND + math.prod(shape)].reshape(shape)
        return call, int(whole.ctypes.data), whole[: self._dof], parts, found


def compile_source(text: str, words: dict[str, object], dof: int, outputs: int) -> Compiled:
    """The library that the C compiler (``$CC``, else ``cc``) makes of a header's text.

    words : what the functions that Python calls depend on, see ``c/calls.h``
    Raises OptionError where it cannot be made.
    """
    if os.environ.get(OFF, "0") not in ("", "0"):
        raise OptionError(f"{OFF} is set")
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if not shutil.which(command[0]):
        raise OptionError("no C compiler was found")
    if dof > _MOST_JOINTS:
        raise OptionError(f"more than {_MOST_JOINTS} joints")
    # a folder of this user alone, removed with the object or at exit
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    made, path = Path(folder.name) / "kernel.c", Path(folder.name) / "kernel.so"
    calls = c_source(source("calls"), words, "calib_", single=False)
    made.write_text(text + calls, encoding="ascii")
    if threading.current_thread() is not threading.main_thread() and shutil.which("nice"):
        command = ["nice", "-n", str(_PATIENT), *command]  # a control loop may run beside it
    end = ("-o", str(path), str(made), "-lm")
    try:
        for flags in ((*_FLAGS, *_QUICKLY), _FLAGS):
            done = subprocess.run(  # noqa: S603
                [*command, *flags, *end], capture_output=True, timeout=_MOST,
                stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
            if done.returncode == 0:
                return Compiled(ctypes.CDLL(str(path)), folder, dof, outputs)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise OptionError(f"{command[0]} failed: {type(error).__name__}") from error
    said = " ".join(done.stderr.decode(errors="replace").split())[:120]
    raise OptionError(f"{command[-1]} failed: {said}")
