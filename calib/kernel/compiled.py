"""The compiled kernel: single queries of a model by its own C, through ctypes.

The system's C compiler (``$CC``, else ``cc``) makes a shared library of the source in a private
temporary folder, which is removed when nothing uses it any more, at the latest at exit.  The
interpreter's lock is released during a call, and every thread has buffers of its own.
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
from typing import Any, NamedTuple

import numpy as np

from ..common.arrays import Array

OFF = "CALIB_NO_CC"
"""Environment variable that leaves the compiler alone where it is set to anything but 0."""

_FLAGS = ("-std=c99", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
_PLANAR, _SPATIAL = "-O2", "-O3"
"""Loops over a posterior in space are vectorised: a bound of six joints takes 22 us for 44, the
compiler 1.0 s for .7; in a plane the compiler's tenth of a second would buy nothing."""

_MOST = 120.0  # s that a compiler may take

_CALLS = """
#define CALLED __attribute__((visibility("default")))
CALLED int called_forward(double *b) { return calib_forward(b, b + 16); }
CALLED int called_jacobian(double *b) { return calib_jacobian(b, b + 16); }
CALLED int called_pose(double *b) { return calib_pose(b, b + 16, b + 19); }
CALLED int called_bound(double *b) { return calib_expected_error(b, b + 16); }
CALLED int called_model_bound(double *b) { return calib_model_error(b, b + 16); }
CALLED int called_inverse(double *b) { return calib_inverse(b + 16, b, b + 32); }
#if @placed@
CALLED int called_inverse_pose(double *b) { return calib_inverse_pose(b + 16, b + 19, b, b + 32); }
#endif
#if @corrected@
CALLED int called_correct(double *b) { return calib_correct(b, b + 32); }
#endif
"""
_MOST_JOINTS = _ASKED = 16
_FOUND = 32
"""Where in a thread's buffer stand what is asked and what answers; given joints are first."""


class Compiled:
    """A shared library that answers single queries; None where the batch has to.

    Joint values (dof,) are in rad or m; anything else than finite numbers is left to the batch,
    which refuses it in words.
    """

    def __init__(self, library: ctypes.CDLL, folder: Any, dof: int, outputs: int) -> None:
        self._folder, self._dof, self._outputs = folder, dof, outputs
        self._own = threading.local()
        self._calls = {}
        for name in ("forward", "jacobian", "pose", "bound", "model_bound", "inverse",
                     "inverse_pose", "correct"):  # fmt: skip
            call = getattr(library, f"called_{name}", None)
            if call is not None:
                call.argtypes, call.restype = (ctypes.c_void_p,), ctypes.c_int
                self._calls[name] = call
        self._forward, self._inverse = self._calls["forward"], self._calls["inverse"]
        self.correcting: Any = None  # what `calib.correct` keeps between calls

    def has(self, name: str) -> bool:
        """Whether it answers a kind of query."""
        return name in self._calls

    def _asked(self, q: Any) -> _Buffers | None:
        """The thread's buffers after joint values were put in; None if they are no numbers."""
        try:
            kept: _Buffers = self._own.kept
        except AttributeError:
            kept = self._own.kept = _Buffers.of(self._dof, self._outputs)
        try:
            if len(q) != self._dof:
                return None
            kept.joints[:] = q
        except (TypeError, ValueError):
            return None
        return kept

    def forward(self, q: Any) -> tuple[Array, bool] | None:
        """Position (m,) and whether there is one."""
        return self._vector(self._forward, q, self._outputs)

    def jacobian(self, q: Any) -> tuple[Array, bool] | None:
        """Derivative (m, dof) of the position, and whether there is one."""
        found = self._vector(self._calls["jacobian"], q, self._outputs * self._dof)
        return None if found is None else (found[0].reshape(-1, self._dof), found[1])

    def pose(self, q: Any) -> tuple[Array, Array, bool] | None:
        """Position (m,) and orientation (3, 3) in the sensor's frame, and whether there are."""
        found = self._vector(self._calls["pose"], q, 12)
        if found is None:
            return None
        return found[0][: self._outputs], found[0][3:].reshape(3, 3), found[1]

    def bound(self, q: Any, which: str) -> tuple[float, bool] | None:
        """95 % bound, ``"bound"`` or ``"model_bound"``, and whether there is one."""
        found = self._vector(self._calls[which], q, 1)
        return None if found is None else (found[0][0], found[1])

    def _vector(self, call: Any, q: Any, size: int) -> tuple[Array, bool] | None:
        kept = self._asked(q)
        if kept is None:
            return None
        good = call(kept.address) == 1
        if not good and not math.isfinite(sum(kept.joints)):
            return None
        return kept.all[_ASKED : _ASKED + size].copy(), good

    def inverse(self, x: Any, near: Any) -> Array | None:
        """Joints (dof,) that reach a position, on the branch that is surely the nearest."""
        kept = self._asked(near)
        if kept is None:
            return None
        try:
            if len(x) != self._outputs:
                return None
            kept.asked[:] = x
        except (TypeError, ValueError):
            return None
        return kept.found[0].copy() if self._inverse(kept.address) == 1 else None

    def inverse_pose(self, x: Array, rotation: Array, near: Any) -> Array | None:
        """Joints (dof,) that reach a pose (3,), (3, 3) of the sensor's frame, as `inverse`."""
        kept = self._asked(near)
        if kept is None:
            return None
        kept.all[16:19], kept.all[19:28] = x, rotation.ravel()
        sure = self._calls["inverse_pose"](kept.address) == 1
        return kept.found[0].copy() if sure else None

    def correct(self, q: Any) -> tuple[Array, Array] | None:
        """Joints (1, dof) as they were given, and those that bring the tip to where it should be.

        None if none do.
        """
        kept = self._asked(q)
        if kept is None or self._calls["correct"](kept.address) != 1:
            return None
        return kept.joints[None].copy(), kept.found.copy()


class _Buffers(NamedTuple):
    """What one thread passes and gets: joints, what is asked, joints that answer."""

    all: Array
    joints: Array  # (dof,)
    asked: Array  # (m,)
    found: Array  # (1, dof)
    address: int

    @staticmethod
    def of(dof: int, outputs: int) -> _Buffers:
        whole = np.zeros(_FOUND + 6 * _MOST_JOINTS)
        asked, found = whole[_ASKED : _ASKED + outputs], whole[None, _FOUND : _FOUND + dof]
        return _Buffers(whole, whole[:dof], asked, found, int(whole.ctypes.data))


def compiler() -> list[str] | None:
    """The C compiler's command; None where there is none, or the user wants none."""
    if os.environ.get(OFF, "0") not in ("", "0"):
        return None
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    return command if shutil.which(command[0]) else None


def compile_source(text: str, words: dict[str, object], dof: int, outputs: int) -> Compiled | str:
    """The library of a header's text; where it cannot be made, why.

    words : "placed" and "corrected", which functions the header has
    """
    from .source import c_source

    command = compiler()
    if command is None:
        off = os.environ.get(OFF, "0") not in ("", "0")
        return f"{OFF} is set" if off else "no C compiler was found"
    if dof > _MOST_JOINTS:
        return f"more than {_MOST_JOINTS} joints"
    # a folder of this user alone, removed with the object or at exit
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    made, path = Path(folder.name) / "kernel.c", Path(folder.name) / "kernel.so"
    made.write_text(text + c_source(_CALLS, words, "calib_", single=False), encoding="ascii")
    level = _SPATIAL if outputs > 2 else _PLANAR
    try:
        subprocess.run(  # noqa: S603
            [*command, level, *_FLAGS, "-o", str(path), str(made), "-lm"],
            check=True, capture_output=True, timeout=_MOST, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        return Compiled(ctypes.CDLL(str(path)), folder, dof, outputs)
    except subprocess.CalledProcessError as error:
        said = error.stderr.decode(errors="replace").strip().splitlines()
        return f"{command[0]} failed" + (f": {said[0][:120]}" if said else "")
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{command[0]} failed: {type(error).__name__}"
