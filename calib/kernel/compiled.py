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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..errors import OptionError

# leaves the compiler alone where it is set to anything but 0
OFF = "CALIB_NO_CC"


class Flag(IntEnum):
    """How certain an answer of the compiled C is."""

    NONE = 0  # there is none
    CERTAIN = 1  # no other is nearer
    UNSURE = 2  # another one might be nearer
    UNREACHABLE = 3  # nothing reaches the position


@dataclass(frozen=True)
class Compiler:
    """How the source is compiled."""

    flags: tuple[str, ...] = (
        "-O2",
        "-std=c99",
        "-fPIC",
        "-shared",
        "-fvisibility=hidden",
        "-fno-math-errno",
    )
    # where the compiler knows them: a bound of six joints takes 3 us for 5; without the first four
    # a step to a position takes 1.4 times as long
    quick: tuple[str, ...] = (
        "-ffp-contract=fast",
        "-fno-trapping-math",
        "-fno-signed-zeros",
        "-freciprocal-math",
        "-O3",
        "-march=native",
        "-fno-inline-small-functions",
        "-fno-inline-functions",
        "-fno-tree-pre",
    )
    most: float = 120.0  # [s] that it may take
    joints: int = 16  # most joints of an arm


COMPILER = Compiler()


# where the further arguments of a query begin, after its joints, see ``c/many.h``
PARTS = (16, 20, 24, 27)
# from how many rows on two threads share them: one takes a millisecond or more
SHARED_ROWS = 1000


@dataclass(frozen=True)
class MostWays:
    """How many answers of one row there is room for."""

    most_ways: int = 32  # of a pose: six joints have 16 at most
    branches: int = 8  # of a position without spare joints


MOST = MostWays()


@dataclass(frozen=True)
class Question:
    """What a function of the C source answers to one row."""

    function: str
    answer: tuple[int, ...] = ()  # its shape
    sizes: tuple[int, ...] = ()  # of the further arguments


@dataclass(frozen=True)
class Buffers:
    """Buffers of a thread's single queries of one kind: views of their parts."""

    call: Callable[[int, int], int]
    addresses: tuple[int, int]  # of question and answer
    joints: Array  # (dof,)
    arguments: tuple[Array, ...]  # besides joints
    answer: Array


class Library:
    """A shared library that answers queries; every thread has its own buffers."""

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
        place = (outputs,)
        # position, quaternion; the free axis or -1, how far starts are apart, their number
        pose = (3, 4, 3)
        self._questions = {
            "forward": Question("forward", place),
            "jacobian": Question("jacobian", (outputs, dof)),
            "bounds": Question("expected_error"),
            "model_bounds": Question("model_error"),
            "pose": Question("pose_row", (7,)),
            "inverse": Question("inverse_row", (dof,), place),
            "inverse_all": Question("inverse_all_row", (MOST.branches, dof)),
            "poses": Question("poses_row", (dof,), pose),
            "poses_all": Question("poses_all_row", (MOST.most_ways, dof), pose),
            "correct": Question("correct", (1, dof)),
        }

    def has(self, name: str) -> bool:
        """Whether it answers a kind of single query."""
        function = self._questions[name].function
        return hasattr(self._library, f"calib_{function}")

    def ask(
        self, name: str, joints: ArrayLike, *arguments: ArrayLike
    ) -> tuple[Array, int] | None:
        """The answer at joints (dof,) and arguments, and how certain it is, see ``c/many.h``.

        None where these are no question: the batch refuses them in words.
        """
        try:
            buffers: Buffers = getattr(self._local, name)
        except AttributeError:
            if not self.has(name):
                return None
            buffers = self._new_buffers(name)
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
        sure = buffers.call(*buffers.addresses)
        if sure != Flag.CERTAIN:
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

    def refusal(self, value: Array, reason: str) -> Array:
        """Return NaN in place of a value, and leave the reason to :attr:`reason`."""
        self._local.reason = reason
        return np.full_like(value, np.nan)

    def _new_buffers(self, name: str) -> Buffers:
        """Buffers of one kind of query, for the thread that asks."""
        question = self._questions[name]
        call = getattr(self._library, f"calib_{question.function}")
        call.argtypes = (ctypes.c_void_p, ctypes.c_void_p)
        call.restype = ctypes.c_int
        row = np.zeros(PARTS[-1])
        parts = tuple(
            row[begin : begin + size]
            for begin, size in zip(PARTS, question.sizes, strict=False)
        )
        answer = np.zeros(question.answer)
        addresses = row.ctypes.data, answer.ctypes.data
        return Buffers(
            call,
            addresses,
            row[: self._dof],
            parts,
            answer,
        )

    def rows(
        self, name: str, joints: Array, *arguments: Array
    ) -> tuple[Array, NDArray[np.int8]]:
        """The answers to many rows (n, ...), and a flag of each (n,), see ``c/many.h``.

        joints : (n, dof), of the question, or those that answers should be near to; of all ways
            to positions these, (n, outputs)
        arguments : (n, k) each, see ``c/many.h``
        """
        n = len(joints)
        questions = np.asarray(joints, dtype=float)
        if arguments:
            width = PARTS[len(arguments) - 1] + arguments[-1].shape[1]
            questions = np.zeros((n, width))
            questions[:, : self._dof] = joints
            for begin, values in zip(PARTS, arguments, strict=False):
                questions[:, begin : begin + values.shape[1]] = values
        questions = np.ascontiguousarray(questions)
        question = self._questions[name]
        answers = np.empty((n, *question.answer))
        flags = np.zeros(n, dtype=np.int8)
        call = self._library.calib_many
        row = getattr(self._library, f"calib_{question.function}")
        passed = (
            ctypes.c_void_p(questions.ctypes.data),
            questions.shape[1],
            ctypes.c_void_p(answers.ctypes.data),
            math.prod(answers.shape[1:]),
            ctypes.c_void_p(flags.ctypes.data),
        )

        def answer(first: int, last: int) -> None:
            call(
                row,
                ctypes.c_long(first),
                ctypes.c_long(last),
                *passed,
            )

        if n < SHARED_ROWS or os.cpu_count() == 1:
            answer(0, n)
        else:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(2) as pool:
                half = n // 2
                list(pool.map(answer, (0, half), (half, n)))
        return answers, flags


def compile_source(text: str, dof: int, outputs: int) -> Library:
    """The library that the C compiler (``$CC``, else ``cc``) makes of a header's text.

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
    exported = '#define CALIB_API __attribute__((visibility("default")))\n'
    code = path.with_suffix(".c")
    code.write_text(exported + text, encoding="ascii")
    files = ("-o", str(path), str(code), "-lm")
    complaint = ""
    for flags in ((*COMPILER.flags, *COMPILER.quick), COMPILER.flags):
        complaint = _complaint([*command, *flags, *files])
        if not complaint:
            return Library(
                path,
                folder,
                dof,
                outputs,
            )
    raise OptionError(f"{command[0]} failed: {complaint}")


def _complaint(command: Sequence[str]) -> str:
    """A compiler's message where it fails; nothing where it does not."""
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
