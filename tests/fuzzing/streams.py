"""Streams: commands whose standard streams are closed, full, broken, narrow or of few letters.

Most cases run in children of a process that has imported the program, a few after one another, with
streams made anew for each as the interpreter makes them; one of fifty runs in a shell, as users run
it.
"""

from __future__ import annotations

import csv
import io
import multiprocessing
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import calib
from calib.samples.tables import write_table

from .guard import SECONDS, Violation
from .honest import RAW
from .kinds import Kind

EACH = 40
"""Cases that one child runs."""

HANG = 200.0
"""Time after which a process that does not end is a failure [s]; it shares its processors."""

COMMANDS = (
    "info M",
    "info M --json",
    "query inverse M 0.1 0.4",
    "query inverse M 0.1 0.4 --json",
    "query inverse M 0.1 0.4 --all",
    "query forward M 9 9",
    "query forward M --input Q",
    "query forward M --input -",
    "query forward M --input /dev/stdin",
    "query forward M --input Q --json",
    "correct M --input Q",
    "correct M --input - --json",
    "evaluate none --json",
    "evaluate M --data L",
    "check M --data L",
    "robots",
    "robots --json",
    "train two_link --lock \u00e9\u4e16=1",
    "query --help",
    "no-such",
)
ENCODINGS = ("ascii", "latin-1", "utf-8", "cp1252")
WIDTHS = ("1", "20", "80", "0", "-5", "x")

# what a stream is, and how a shell says it
_IN = {"closed": "<&-", "empty": "</dev/null", "rows": "<q.csv", "pipe": "", "folder": "<."}
_OUT = {"file": "", "closed": ">&-", "full": ">/dev/full", "broken": "| true"}
_PRELOADED = ["__main__", "fuzzing.preload", "typer.rich_utils", "rich.table", "scipy.spatial",
              "scipy.optimize", "scipy.sparse.csgraph", "scipy.special"]  # fmt: skip
_ERR = {"file": "", "closed": "2>&-", "full": "2>/dev/full"}


@dataclass(frozen=True)
class StreamCase:
    """A command line and its streams."""

    args: tuple[str, ...]
    stdin: str
    stdout: str
    stderr: str
    encoding: str
    columns: str
    shell: bool


class Streams(Kind):
    """Commands whose standard streams are not what they usually are."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        arm = calib.load_arm("two_link")
        calib.train(calib.babble(arm, 300, seed=0), size=4).save(folder / "m.calib")
        log = calib.babble(arm, 60, seed=1)
        write_table(
            folder / "l.csv",
            dict(zip(("shoulder", "elbow", "x", "y"), [*log.q.T, *log.x.T], strict=True)),
        )
        (folder / "q.csv").write_text("shoulder,elbow\n0.5,1.0\n")
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(_PRELOADED)
        self.child: Any = None
        self.pipe: Any = None
        self.left = 0

    def close(self) -> None:
        """End the child."""
        if self.child is not None:
            self.child.kill()
            self.child.join()
            self.child = None

    def make(self, rng: Random) -> StreamCase:
        """Choose a command, its streams, an encoding and a width."""
        names = {"M": "m.calib", "Q": "q.csv", "L": "l.csv"}
        words = tuple(names.get(word, word) for word in rng.choice(COMMANDS).split())
        return StreamCase(
            words,
            rng.choice([*_IN, "rows", "pipe"]),
            rng.choice([*_OUT, "file", "file"]),
            rng.choice([*_ERR, "file"]),
            rng.choice(ENCODINGS),
            rng.choice((*WIDTHS, str(rng.randint(1, 300)))),
            rng.random() < 0.02,
        )

    def judge(self, case: StreamCase) -> str:
        """Run it; look at its exit code, at what it printed, and at numbers that are known."""
        paths = [self.folder / "out.txt", self.folder / "err.txt"]
        for path in paths:
            path.unlink(missing_ok=True)
        code = self._in_shell(case, paths) if case.shell else self._as_child(case, paths)
        out, err = (p.read_bytes().decode(case.encoding) if p.exists() else "" for p in paths)
        for text in (out, err):
            if "Traceback" in text or "internal error" in text or RAW & set(text):
                raise Violation(f"{case}: {text[-300:]!r}")
        lost = case.shell and case.stdout == "broken"  # the shell tells of `true`
        if code not in (0, 1, 2, 3) and not (code == 120 or lost):
            raise Violation(f"{case}: exit code {code}")
        if code == 0 and case.stdout == "file" and not out:
            raise Violation(f"{case}: no answer and no error")
        if code == 0 and case.stdout == "full" and err == "" and case.stderr == "file":
            raise Violation(f"{case}: what was not written is not told")
        if code == 0 and out and "forward" in case.args and "--json" not in case.args:
            row = next(csv.DictReader(io.StringIO(out)))
            end = 0.30 * np.exp(0.5j) + 0.25 * np.exp(1.5j)
            if abs(float(row["x"]) + 1j * float(row["y"]) - end) > 1e-3:
                raise Violation(f"{case}: another answer than the closed form: {out!r}")
        return f"{'shell' if case.shell else 'child'} exit {code}"

    def _in_shell(self, case: StreamCase, paths: list[Path]) -> int:
        out, err = (
            {**kinds, "file": f"{sign}{path}"}[how]
            for kinds, sign, path, how in (
                (_OUT, ">", paths[0], case.stdout),
                (_ERR, "2>", paths[1], case.stderr),
            )
        )
        before = "cat q.csv | " if case.stdin == "pipe" else ""
        program = f"{sys.executable} -m calib_cli {' '.join(case.args)}"
        line = f"{before}{program} {_IN[case.stdin]} {err} {out}"
        done = subprocess.run(
            ["sh", "-c", line], timeout=HANG, check=False, cwd=self.folder,
            env={**os.environ, "PYTHONIOENCODING": case.encoding, "COLUMNS": case.columns},
        )  # fmt: skip
        return done.returncode

    def _as_child(self, case: StreamCase, paths: list[Path]) -> int:
        if self.child is None or not self.left:
            self.close()
            self.pipe, other = self.context.Pipe()
            self.child = self.context.Process(target=_serve, args=(other, str(self.folder)))
            self.child.start()
            other.close()
            self.left = EACH
        self.left -= 1
        self.pipe.send((case, paths))
        try:
            if self.pipe.poll(HANG):
                code, seconds = self.pipe.recv()
                if seconds > SECONDS:
                    raise Violation(f"{case}: {seconds:.1f} s of processor time")
                return int(code)
            why = f"did not end within {HANG:g} s"
        except EOFError:
            why = "the process ended without an exit code"
        self.close()
        raise Violation(f"{case}: {why}")


def _serve(pipe: Any, folder: str) -> None:
    """Run cases one after another; answer with the exit code and the processor time of each."""
    os.chdir(folder)
    while True:
        try:
            case, paths = pipe.recv()
        except EOFError:
            os._exit(0)
        started = time.process_time()
        code = _run(case, paths)
        pipe.send((code, time.process_time() - started))


def _run(case: StreamCase, paths: list[Path]) -> int:
    """Make the streams as a shell and an interpreter do, and run the program."""
    os.environ.update(PYTHONIOENCODING=case.encoding, COLUMNS=case.columns)
    sys.argv = ["calib", *case.args]
    kinds = (case.stdin, case.stdout, case.stderr)
    made = [_opened(how, fd, paths) for fd, how in enumerate(kinds)]
    for fd, (how, handle) in enumerate(zip(kinds, made, strict=True)):
        if handle != fd:
            os.dup2(handle, fd)
        if handle > 2:
            os.close(handle)
        if how == "closed":
            os.close(fd)
    errors = ("strict", "strict", "backslashreplace")
    for fd, name in enumerate(("stdin", "stdout", "stderr")):
        closed = kinds[fd] in ("closed", "folder")  # Python has no stream of a folder either
        stream = None if closed else open(  # noqa: SIM115
            fd, "w" if fd else "r", encoding=case.encoding, errors=errors[fd], closefd=False
        )  # fmt: skip
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    return _program()


def _program() -> int:
    """Run the program and return its exit code, 120 where its last words are lost."""
    from calib_cli import main

    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except (OSError, ValueError):
            code = 120
    return code


def _opened(how: str, fd: int, paths: list[Path]) -> int:
    """Return a handle of what a stream leads to."""
    if how in ("pipe", "broken"):
        read, write = os.pipe()
        if how == "pipe":
            os.write(write, Path("q.csv").read_bytes())
        os.close(read if how == "broken" else write)
        return write if how == "broken" else read
    names = {"rows": "q.csv", "folder": ".", "full": "/dev/full"}
    name = str(paths[fd - 1]) if how == "file" else names.get(how, os.devnull)
    return os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC if fd else os.O_RDONLY, 0o600)
