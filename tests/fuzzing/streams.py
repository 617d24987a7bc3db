"""Streams: commands in a shell whose standard streams are closed, full, broken, narrow or in few
letters.
"""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

import calib
from calib.samples.tables import write_table

from .guard import Violation
from .honest import RAW
from .kinds import Kind

HANG = 200.0
"""Time after which a process that does not end is a failure [s]; it shares its processors."""

COMMANDS = (
    "info m.calib",
    "info m.calib --json",
    "query inverse m.calib 0.1 0.4",
    "query inverse m.calib 0.1 0.4 --json",
    "query inverse m.calib 0.1 0.4 --all",
    "query forward m.calib 9 9",
    "query forward m.calib --input q.csv",
    "query forward m.calib --input -",
    "query forward m.calib --input /dev/stdin",
    "query forward m.calib --input q.csv --json",
    "correct m.calib --input q.csv",
    "correct m.calib --input - --json",
    "evaluate none --json",
    "evaluate m.calib --data l.csv",
    "check m.calib --data l.csv",
    "robots",
    "robots --json",
    "train two_link --lock \u00e9\u4e16=1",
    "query --help",
    "no-such",
)
ENCODINGS = ("ascii", "latin-1", "utf-8", "cp1252")
WIDTHS = ("1", "20", "80", "0", "-5", "x", "7", "300")

# what a stream is, and how a shell says it
_IN = {"closed": "<&-", "empty": "</dev/null", "rows": "<q.csv", "pipe": "", "folder": "<."}
_OUT = {"file": ">out", "closed": ">&-", "full": ">/dev/full", "broken": "| true"}
_ERR = {"file": "2>err", "closed": "2>&-", "full": "2>/dev/full"}


@dataclass(frozen=True)
class StreamCase:
    """A command line and its streams."""

    command: str
    stdin: str
    stdout: str
    stderr: str
    encoding: str
    columns: str


class Streams(Kind):
    """Commands whose standard streams are not what they usually are."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        arm = calib.load_arm("two_link")
        calib.train(calib.babble(arm, 300, seed=0), size=4).save(folder / "m.calib")
        log = calib.babble(arm, 60, seed=1)
        columns = zip(("shoulder", "elbow", "x", "y"), [*log.q.T, *log.x.T], strict=True)
        write_table(folder / "l.csv", dict(columns))
        (folder / "q.csv").write_text("shoulder,elbow\n0.5,1.0\n")

    def make(self, rng: Random) -> StreamCase:
        """Choose a command, its streams, an encoding and a width."""
        choices = (COMMANDS, [*_IN, "rows"], [*_OUT, "file"], [*_ERR, "file"], ENCODINGS, WIDTHS)
        return StreamCase(*(rng.choice(several) for several in choices))

    def judge(self, case: StreamCase) -> str:
        """Run it; what is said has to be an answer that is right, or an error in order."""
        paths = [self.folder / "out", self.folder / "err"]
        for path in paths:
            path.write_bytes(b"")
        before = "cat q.csv | " if case.stdin == "pipe" else ""
        streams = f"{_IN[case.stdin]} {_ERR[case.stderr]} {_OUT[case.stdout]}"
        line = f"{before}{sys.executable} -m calib_cli {case.command} {streams}"
        surroundings = {"PYTHONIOENCODING": case.encoding, "COLUMNS": case.columns}
        code = subprocess.run(
            ["sh", "-c", line], timeout=HANG, check=False, cwd=self.folder,
            env={**os.environ, **surroundings},
        ).returncode  # fmt: skip
        out, err = (path.read_bytes().decode(case.encoding) for path in paths)
        for text in (out, err):
            if "Traceback" in text or "internal error" in text or RAW & set(text):
                raise Violation(f"{case}: {text[-300:]!r}")
        if code not in (0, 1, 2, 3) and case.stdout != "broken":  # there the shell tells of `true`
            raise Violation(f"{case}: exit code {code}")
        if code == 0 and case.stdout == "file" and not out:
            raise Violation(f"{case}: no answer and no error")
        if code == 0 and case.stdout == "full" and case.stderr == "file" and not err:
            raise Violation(f"{case}: what was not written is not told")
        if code == 0 and out and "forward" in case.command and "--json" not in case.command:
            row = next(csv.DictReader(io.StringIO(out)))
            end = 0.30 * np.exp(0.5j) + 0.25 * np.exp(1.5j)
            if abs(float(row["x"]) + 1j * float(row["y"]) - end) > 1e-3:
                raise Violation(f"{case}: another answer than the closed form: {out!r}")
        return f"exit {code}"
