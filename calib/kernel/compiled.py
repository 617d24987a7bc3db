"""The compiled kernel: single queries of a model by its own C, through ctypes.

The system's C compiler (``$CC``, else ``cc``) makes a shared library of the source in a private
temporary folder, which is removed when nothing uses it any more, at the latest at exit.
"""

from __future__ import annotations

import ctypes
import math
import os
import shlex
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..errors import OptionError
from .source import c_source, source

OFF = "CALIB_NO_CC"
"""Environment variable that leaves the compiler alone where it is set to anything but 0."""

_FLAGS = ("-O2", "-std=c99", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
_QUICKLY = (
    *("-ftree-vectorize", "-fvect-cost-model=dynamic"),
    *("-fno-inline-small-functions", "-fno-tree-pre"),
)
"""Where the compiler knows them: a bound of six joints takes 20 us for 41, and the compiler .78 s
for .81 (1.21 at -O3)."""

_PATIENT = 10  # niceness of a compiler that another thread than the main one calls

_MOST = 120.0  # s that a compiler may take
_MOST_JOINTS = 16
_ASKED, _PART, _FOUND, _SIZE = 16, 4, 32, 128
"""Where in a thread's buffer stand what is asked, `_PART` numbers each, and what answers; given
joints are first.  As in ``c/calls.h``."""


class Compiled:
    """A shared library that answers single queries.

    The interpreter's lock is released during a call, and every thread has buffers of its own.
    """

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
        """The answer for joints (dof,) and what else is asked, and how sure it is.

        0 stands for no answer, 1 for a sure one, see ``c/calls.h``.  None where a question is none:
        the batch refuses it in words.
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
    """The library of a header's text.

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
