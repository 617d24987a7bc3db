"""The compiled kernel: what a C compiler makes of a model's source, and its calls."""

from __future__ import annotations

import ctypes
import math
import os
import shlex
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..errors import OptionError
from .source import c_source, source

# leaves the compiler alone where it is set to anything but 0
OFF = "CALIB_NO_CC"
CERTAIN = 1  # flag of an answer: no other is nearer
NOTHING = 3  # flag of a position that nothing reaches


@dataclass(frozen=True)
class Compiler:
    """How the source is compiled."""

    flags: tuple[str, ...] = (
        *("-O2", "-std=c99", "-fPIC", "-shared", "-fvisibility=hidden"),
        *("-ffp-contract=off", "-fno-math-errno"),
    )
    # where the compiler knows them: a bound of six joints takes 16 us for 41
    quick: tuple[str, ...] = (
        *("-march=native", "-ftree-vectorize", "-fvect-cost-model=dynamic"),
        *("-fno-inline-small-functions", "-fno-tree-pre"),
    )
    # niceness beside another thread, where a control loop may run
    patience: int = 10
    most: float = 120.0  # [s] that it may take
    joints: int = 16  # most joints of an arm


COMPILER = Compiler()


@dataclass(frozen=True)
class Layout:
    """Where the parts of a single query stand in its buffer, as in ``c/calls.h``."""

    question: int = 16  # what is asked beside joints
    part: int = 4  # numbers of each part of it
    answer: int = 32
    size: int = 128


LAYOUT = Layout()


@dataclass(frozen=True)
class Rows:
    """How many answers of a row have room, and from how many rows on threads share them."""

    ways: int = 32  # of a pose: six joints have 16 at most
    branches: int = 8  # of a position without spare joints
    shared: int = 1000  # one thread takes a millisecond or more for them


ROWS = Rows()


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
        path: Path,
        folder: tempfile.TemporaryDirectory[str],
        dof: int,
        outputs: int,
    ) -> None:
        self._folder = folder  # is removed with the library
        self._library = ctypes.CDLL(str(path))
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
            "inverse_pose": ((3, 4, 1), (dof,)),  # and the free axis, or -1
            "correct": ((), (1, dof)),
        }
        self.poses = self.has("pose")  # whether it knows poses in space
        if self.poses:
            self._library.called_table.restype = ctypes.c_void_p
            self._table = ctypes.c_void_p(self._library.called_table())

    def has(self, name: str) -> bool:
        """Whether it answers a kind of single query."""
        return hasattr(self._library, f"called_{name}")

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
                for part, values in zip(
                    buffers.arguments, arguments, strict=True
                ):
                    if len(values) != len(part):  # type: ignore[arg-type]
                        return None
                    part[:] = values
        except (TypeError, ValueError):
            return None
        sure = buffers.call(buffers.address)
        if sure != CERTAIN:
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
        whole = np.zeros(LAYOUT.size)
        parts = []
        for k, size in enumerate(sizes):
            begin = LAYOUT.question + k * LAYOUT.part
            parts.append(whole[begin : begin + size])
        answer = whole[
            LAYOUT.answer : LAYOUT.answer + math.prod(shape)
        ].reshape(shape)
        address = int(whole.ctypes.data)
        return Buffers(call, address, whole[: self._dof], tuple(parts), answer)

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
        q = np.empty((len(x), ROWS.branches, self._dof))
        return q, self._rows("inverse_all", len(x), x, ROWS.branches, q)

    def inverse_poses(
        self, p: Array, rotation: Array, near: Array, free: int | None
    ) -> tuple[Array, Array]:
        """Joints (n, dof) of poses (n, 3), (n, 3, 3) of the sensor's frame, and how sure (n,).

        The turn about an axis of the tip, `free` 0 to 2, may be left open.
        """
        q = np.empty((len(p), self._dof))
        return q, self._rows("poses", len(p), p, rotation, _axis(free), near, q)

    def inverse_poses_far(
        self,
        p: Array,
        rotation: Array,
        near: Array,
        free: int | None,
        starts: Array,
        q: Array,
        sure: Array,
    ) -> tuple[Array, Array]:
        """The same where `inverse_poses` is not sure of its `q`, from starts (n, k, dof), too.

        NaN is no start; without any (k = 0) a table of postures has them.
        """
        q = q.copy()
        sure = sure.copy()
        arguments = (
            p,
            rotation,
            _axis(free),
            starts.shape[1],
            starts,
            self._table,
        )
        return q, self._rows(
            "poses_far", len(p), *arguments, near, q, flags=sure
        )

    def inverse_poses_all(
        self, p: Array, rotation: Array, starts: Array, free: int | None
    ) -> list[Array]:
        """All ways (k, dof) to each pose (n, 3), (n, 3, 3) of the sensor's frame, from starts."""
        q = np.empty((len(p), ROWS.ways, self._dof))
        arguments = (
            p,
            rotation,
            _axis(free),
            starts.shape[1],
            starts,
            self._table,
        )
        count = self._rows("poses_all", len(p), *arguments, ROWS.ways, q)
        return [rows[:k] for rows, k in zip(q, count.tolist(), strict=True)]

    def _rows(
        self,
        name: str,
        n: int,
        *arguments: Array | int | ctypes.c_void_p,
        flags: Array | None = None,
    ) -> Array:
        """Call a function for n rows, by two threads where there are two cores; its flags (n,)."""
        call = getattr(self._library, f"calib_{name}_many")
        flags = np.zeros(n, dtype=np.int8) if flags is None else flags
        arrays = []
        passed: list[object] = []
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                array = np.ascontiguousarray(argument, dtype=float)
                arrays.append(array)  # alive while the call runs
                passed.append(ctypes.c_void_p(array.ctypes.data))
            elif isinstance(argument, int):
                passed.append(ctypes.c_int(argument))
            else:
                passed.append(argument)
        passed.append(ctypes.c_void_p(flags.ctypes.data))

        def answer(first: int, last: int) -> None:
            call(ctypes.c_long(first), ctypes.c_long(last), *passed)

        if n < ROWS.shared or os.cpu_count() == 1:
            answer(0, n)
        else:
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(answer, (0, n // 2), (n // 2, n)))
        return flags


def _axis(free: int | None) -> int:
    """A free axis as the C source has it."""
    return -1 if free is None else free


def compile_source(
    text: str, words: Mapping[str, object], dof: int, outputs: int
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
    if dof > COMPILER.joints:
        raise OptionError(f"more than {COMPILER.joints} joints")
    # a folder of this user alone, removed with the object or at exit
    folder = tempfile.TemporaryDirectory(prefix="calib-")
    path = Path(folder.name) / "kernel.so"
    calls = c_source(source("calls"), words, "calib_", single=False)
    exported = '#define CALIB_API __attribute__((visibility("default")))\n'
    path.with_suffix(".c").write_text(exported + text + calls, encoding="ascii")
    beside = threading.current_thread() is not threading.main_thread()
    if beside and shutil.which("nice"):
        command = ["nice", "-n", str(COMPILER.patience), *command]
    files = ("-o", str(path), str(path.with_suffix(".c")), "-lm")
    complaint = ""
    for flags in ((*COMPILER.flags, *COMPILER.quick), COMPILER.flags):
        complaint = _complaint([*command, *flags, *files])
        if not complaint:
            return Compiled(path, folder, dof, outputs)
    raise OptionError(f"{command[-1]} failed: {complaint}")


def _complaint(command: Sequence[str]) -> str:
    """What a compiler says where it fails; nothing where it does not."""
    try:
        done = subprocess.run(  # noqa: S603
            command,
            capture_output=True,
            timeout=COMPILER.most,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise OptionError(
            f"{command[0]} failed: {type(error).__name__}"
        ) from error
    if done.returncode == 0:
        return ""
    lines = done.stderr.decode(errors="replace").split()
    return " ".join(lines)[:120] or "without a word"
