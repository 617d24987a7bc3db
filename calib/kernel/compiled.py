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
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..errors import OptionError

OFF = "CALIB_NO_CC"  # leaves the compiler alone where it is set to anything but 0

_FLAGS = ("-O2", "-std=c99", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
# where the compiler knows them: a bound of six joints takes 16 us for 41
_QUICKLY = (
    "-march=native",
    *("-ftree-vectorize", "-fvect-cost-model=dynamic"),
    *("-fno-inline-small-functions", "-fno-tree-pre"),
)
_PATIENT = 10  # niceness of a compiler that another thread than the main one calls
_MOST = 120.0  # s that a compiler may take
_MOST_JOINTS = 16
# where in a thread's buffer stand what is asked beside joints, `_PART` numbers each, and what
# answers, as in ``c/calls.h``
_ASKED = 16
_PART = 4
_FOUND = 32
_SIZE = 128
NOTHING = 3  # flag of a position that nothing reaches
_SHARED_ROWS = (
    1000  # rows from which two threads answer: one takes a millisecond or more for them
)
_MOST_WAYS = 32  # ways of a pose: six joints have 16 at most
_MOST_BRANCHES = 8  # ways of a position without spare joints

_CHOICE = re.compile(
    r"^#if @(\w+)@\n((?:(?!#if @|#endif\n|#else\n).*\n)*)(?:#else\n((?:(?!#if @|#endif\n).*\n)*))?"
    r"#endif\n",
    re.MULTILINE,
)
_NUMBER = re.compile(r"[-\d.][-+.e\d]*")
_BRACES = str.maketrans("[]", "{}")
_FUNCTIONS = re.compile(r"\b(cos|sin|sqrt|floor|fabs|atan2|pow)\(")


def source(*names: str) -> str:
    """Files of the C source, one after another."""
    folder = files(__package__) / "c"
    return "".join((folder / f"{name}.h").read_text(encoding="ascii") for name in names)


def c_source(text: str, words: Mapping[str, object], prefix: str, single: bool) -> str:
    """C source with words such as ``@dof@`` and ``#if @word@`` filled in, and names' prefix."""
    while "#if @" in text:  # the innermost first
        text = _CHOICE.sub(
            lambda found: (found[2] if words[found[1]] else found[3]) or "", text
        )
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
    text = (
        str(values.tolist()).translate(_BRACES)
        if whole
        else braces(values, single or floats)
    )
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


@dataclass(frozen=True)
class Buffers:
    """Where a thread's single query of one kind stands: one array, and views of its parts."""

    call: Callable[[int], int]
    address: int  # of the array
    joints: Array  # (dof,)
    arguments: tuple[Array, ...]  # what is asked beside joints
    answer: Array


class Compiled:
    """A shared library that answers queries; every thread has buffers of its own."""

    def __init__(
        self,
        library: ctypes.CDLL,
        folder: tempfile.TemporaryDirectory[str],
        dof: int,
        outputs: int,
    ) -> None:
        self._folder = folder  # is removed with the library
        self._library = library
        self._local = threading.local()
        self._dof = dof
        self._outputs = outputs
        place = (outputs,)
        # sizes of what is asked beside joints, and shape of the answer
        self._shapes: dict[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
            "forward": ((), place),
            "jacobian": ((), (outputs, dof)),
            "bounds": ((), ()),
            "model_bounds": ((), ()),
            "pose": ((), (7,)),
            "inverse": (place, (dof,)),
            "inverse_pose": ((3, 4), (dof,)),
            "correct": ((), (1, dof)),
        }
        if hasattr(library, "prepare"):
            library.prepare()

    def has(self, name: str) -> bool:
        """Whether it answers a kind of single query."""
        return hasattr(self._library, f"called_{name}")

    @property
    def poses(self) -> bool:
        """Whether it knows poses in space."""
        return hasattr(self._library, "rows_poses")

    def ask(
        self, name: str, joints: ArrayLike, *arguments: ArrayLike
    ) -> tuple[Array, int] | None:
        """The answer for joints (dof,) and what else is asked, and how sure, see ``c/calls.h``.

        None where a question is none: the batch refuses it in words.
        """
        try:
            buffers: Buffers = getattr(self._local, name)
        except AttributeError:
            buffers = self._prepared(name)
            setattr(self._local, name, buffers)
        try:
            if len(joints) != self._dof:  # type: ignore[arg-type]
                return None
            buffers.joints[:] = joints
            if arguments:
                for part, values in zip(buffers.arguments, arguments, strict=True):
                    if len(values) != len(part):  # type: ignore[arg-type]
                        return None
                    part[:] = values
        except (TypeError, ValueError):
            return None
        sure = buffers.call(buffers.address)
        if sure != 1:
            parts = (buffers.joints, *buffers.arguments)
            if not all(math.isfinite(sum(part)) for part in parts):
                return None
        answer = buffers.answer
        value: Array = answer.copy() if answer.ndim else answer[()]
        return value, sure

    @property
    def reason(self) -> str | None:
        """Why this thread's last query was refused, None if it was not."""
        reason: str | None = getattr(self._local, "reason", None)
        self._local.reason = None
        return reason

    def refused(self, value: Array, reason: str) -> Array:
        """NaN in place of a value, and the reason for :attr:`reason`."""
        self._local.reason = reason
        return np.full_like(value, np.nan)

    def _prepared(self, name: str) -> Buffers:
        """Buffers of one kind of query, for the thread that asks."""
        call = getattr(self._library, f"called_{name}")
        call.argtypes = (ctypes.c_void_p,)
        call.restype = ctypes.c_int
        sizes, shape = self._shapes[name]
        whole = np.zeros(_SIZE)
        begins = range(_ASKED, _FOUND, _PART)
        parts = tuple(
            whole[a : a + size] for a, size in zip(begins, sizes, strict=False)
        )
        answer = whole[_FOUND : _FOUND + math.prod(shape)].reshape(shape)
        return Buffers(call, int(whole.ctypes.data), whole[: self._dof], parts, answer)

    def forward(self, q: Array) -> tuple[Array, Array]:
        """Positions (n, m) of joints (n, dof), and which are answers (n,)."""
        x = np.empty((len(q), self._outputs))
        return x, self._rows("forward", len(q), q, x)

    def bounds(self, q: Array, which: str) -> tuple[Array, Array]:
        """95 % bounds (n,) at joints (n, dof), and which are answers; `bounds`, `model_bounds`."""
        bound = np.empty(len(q))
        return bound, self._rows(which, len(q), q, bound)

    def inverse(self, x: Array, near: Array) -> tuple[Array, Array]:
        """Joints (n, dof) of positions (n, m), and how sure (n,), see `calib_answer`."""
        q = np.empty((len(x), self._dof))
        return q, self._rows("inverse", len(x), x, near, q)

    def inverse_all(self, x: Array) -> tuple[Array, Array]:
        """All ways (n, most, dof) to positions (n, m), and how many there are (n,)."""
        q = np.empty((len(x), _MOST_BRANCHES, self._dof))
        return q, self._rows("inverse_all", len(x), x, _MOST_BRANCHES, q)

    def inverse_poses(
        self, p: Array, rotation: Array, near: Array, free: int = -1, *, far: bool
    ) -> tuple[Array, Array]:
        """Joints (n, dof) of poses (n, 3), (n, 3, 3) of the sensor's frame, and how sure (n,).

        The turn about an axis of the tip, `free` 0 to 2, may be left open.  `far` looks for ways
        far from `near`, too.
        """
        n = len(p)
        q = np.empty((n, self._dof))
        sure = self._rows("poses", n, p, rotation, free, near, q)
        unsure = np.flatnonzero(sure != 1)
        if far and len(unsure):
            others = q[unsure]
            flags = sure[unsure]
            rows = (p[unsure], rotation[unsure], free, near[unsure], others)
            self._rows("poses_far", len(unsure), *rows, flags=flags)
            q[unsure] = others
            sure[unsure] = flags
        return q, sure

    def inverse_poses_all(
        self, p: Array, rotation: Array, starts: Array, free: int = -1
    ) -> tuple[Array, Array]:
        """All ways (n, most, dof) to poses of the sensor's frame, and how many there are (n,).

        From starts (n, k, dof), NaN where there is none; without any (k = 0) from a table.
        """
        n = len(p)
        q = np.empty((n, _MOST_WAYS, self._dof))
        arguments = (p, rotation, free, starts.shape[1], starts, _MOST_WAYS, q)
        return q, self._rows("poses_all", n, *arguments)

    def _rows(
        self, name: str, n: int, *arguments: Array | int, flags: Array | None = None
    ) -> Array:
        """Call a function for n rows, by two threads where there are two cores; its flags (n,)."""
        call = getattr(self._library, f"rows_{name}")
        if flags is None:
            flags = np.zeros(n, dtype=np.int8)
        arrays = []
        passed: list[object] = []
        for argument in (*arguments, flags):
            if isinstance(argument, int):
                passed.append(ctypes.c_int(argument))
                continue
            if argument.flags.c_contiguous and argument.dtype in (np.float64, np.int8):
                array = argument
            else:
                array = np.ascontiguousarray(argument, dtype=float)
            arrays.append(array)  # alive while the call runs
            passed.append(ctypes.c_void_p(array.ctypes.data))
        edges = [0, n]
        if n >= _SHARED_ROWS and (os.cpu_count() or 1) > 1:
            edges = [0, n // 2, n]

        def answer(first: int, last: int) -> None:
            call(ctypes.c_long(first), ctypes.c_long(last), *passed)

        if len(edges) == 2:
            answer(0, n)
        else:
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(answer, edges[:-1], edges[1:]))
        return flags


def compile_source(
    text: str, words: dict[str, object], dof: int, outputs: int
) -> Compiled:
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
    made = Path(folder.name) / "kernel.c"
    path = Path(folder.name) / "kernel.so"
    calls = c_source(source("calls"), words, "calib_", single=False)
    made.write_text(text + calls, encoding="ascii")
    if threading.current_thread() is not threading.main_thread() and shutil.which(
        "nice"
    ):
        command = [
            "nice",
            "-n",
            str(_PATIENT),
            *command,
        ]  # a control loop may run beside it
    end = ("-o", str(path), str(made), "-lm")
    try:
        for flags in ((*_FLAGS, *_QUICKLY), _FLAGS):
            done = subprocess.run(  # noqa: S603
                [*command, *flags, *end],
                capture_output=True,
                timeout=_MOST,
                stdin=subprocess.DEVNULL,
                check=False,
            )
            if done.returncode == 0:
                return Compiled(ctypes.CDLL(str(path)), folder, dof, outputs)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise OptionError(f"{command[0]} failed: {type(error).__name__}") from error
    said = " ".join(done.stderr.decode(errors="replace").split())[:120]
    raise OptionError(f"{command[-1]} failed: {said}")
