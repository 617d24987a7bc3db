"""Honest: input that looks sound and is not; a wrong answer without a word is the failure."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np
import polars as pl

import calib
from calib.errors import CalibError
from calib.samples.tables import write_table

from .guard import Violation, guarded, one_line
from .kinds import Kind
from .mutate import NAMES

_UNITS = {"m": 1.0, "mm": 1e3, "cm": 1e2, "in": 39.3700787, "px": 640.0}
RAW = {chr(c) for c in (*range(9), *range(11, 32), *range(127, 160), *range(0x202A, 0x202F))}


@dataclass(frozen=True)
class UnitCase:
    """A log of a known arm: what it is in, and what is said of it."""

    seed: int
    unit: str
    said: str
    degrees: bool
    said_degrees: bool
    exchanged: bool


class Units(Kind):
    """Logs in other units than is said of them: refused, noted, or read as they are."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.arm = calib.load_arm("two_link")

    def make(self, rng: Random) -> UnitCase:
        """Choose units and words."""
        unit = rng.choice(list(_UNITS))
        said = unit if rng.random() < 0.4 else "m"
        degrees = rng.random() < 0.4
        told = degrees if rng.random() < 0.5 else not degrees
        return UnitCase(rng.randrange(10**6), unit, said, degrees, told, rng.random() < 0.2)

    def judge(self, case: UnitCase) -> str:
        """Read the log; what is read without a word has to be the truth."""
        rng = np.random.default_rng(case.seed)
        q = rng.uniform(self.arm.lower, self.arm.upper, (int(rng.integers(12, 80)), 2))
        turn = rng.uniform(-np.pi, np.pi)
        c, s = np.cos(turn), np.sin(turn)
        x = _UNITS[case.unit] * (
            self.arm.forward(q) @ np.array([[c, s], [-s, c]]) + rng.normal(size=2)
        )
        typed = np.degrees(q) if case.degrees else q
        columns = typed[:, ::-1] if case.exchanged else typed
        path = self.folder / "log.csv"
        write_table(
            path, {"shoulder": columns[:, 0], "elbow": columns[:, 1], "x": x[:, 0], "y": x[:, 1]}
        )
        try:
            with guarded(self.folder):
                log = calib.read_log(path, self.arm, degrees=case.said_degrees, unit=case.said)
        except CalibError as error:
            one_line(str(error))
            return type(error).__name__
        right = case.degrees == case.said_degrees and not case.exchanged
        if right and not np.allclose(log.q, q, atol=1e-9):
            raise Violation("joint values differ from the log's")
        if case.said == "m" and case.unit != "m":
            raise Violation(f"{case.unit} were read as m without a word")
        if not right and not log.notes:
            raise Violation(f"read without a word: {case}")
        return "read" if right else "noted"


class NamedColumns(Kind):
    """Joint values as arrays and tables: the closed form, or one line."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.arm = calib.load_arm("two_link")
        self.model = calib.train(calib.babble(self.arm, 300, seed=0), size=4)

    def make(self, rng: Random) -> tuple[int, str, bool]:
        """Choose a container, and whether the joints are in order."""
        kinds = ("dict", "polars", "record", "masked", "date", "list", "missing", "extra", "array")
        return rng.randrange(10**6), rng.choice(kinds), rng.random() < 0.5

    def judge(self, case: tuple[int, str, bool]) -> str:
        """Compare the arm's and the model's answers with the textbook."""
        seed, kind, ordered = case
        rng = np.random.default_rng(seed)
        q = rng.uniform(self.arm.lower, self.arm.upper, (int(rng.integers(1, 6)), 2))
        table = dict(zip(self.arm.joint_names, q.T, strict=True))
        if not ordered:
            table = dict(reversed(table.items()))
        given: object = table
        if kind == "polars":
            given = pl.DataFrame(table)
        elif kind == "record":
            record = np.zeros(len(q), dtype=[(name, float) for name in table])
            for name, values in table.items():
                record[name] = values
            given = record
        elif kind == "masked":
            given = np.ma.masked_array(q, mask=rng.random(q.shape) < 0.5)
        elif kind == "date":
            given = q.astype("datetime64[s]")
        elif kind == "missing":
            table.pop(rng.choice(list(table)))
        elif kind == "extra":
            given = {"time": np.arange(len(q)), **table}
        elif kind in ("list", "array"):
            given = q.tolist() if kind == "list" else q
        told = 0
        ends = 0.30 * np.exp(1j * q[:, 0]) + 0.25 * np.exp(1j * q.sum(axis=1))
        for answer, most in ((self.arm.forward, 1e-12), (self.model.forward, 1e-3)):
            try:
                with guarded(self.folder):
                    x = answer(given)
            except CalibError as error:
                one_line(str(error))
                told += 1
                continue
            if np.nanmax(np.abs(x[..., 0] + 1j * x[..., 1] - ends)) > most:
                raise Violation(f"{kind}: another answer than the closed form")
        return f"{kind} {'refused' if told else 'answered'}"


class HostileNames(Kind):
    """Names of joints, columns and files that a terminal would obey."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from calib_cli.app import app

        self.app = app
        self.model = folder / "m.calib"
        s = calib.babble(calib.load_arm("two_link"), 300, seed=0)
        calib.train(s, size=4).save(self.model)

    def make(self, rng: Random) -> tuple[str, str, str]:
        """Make a name and choose where it goes."""
        odd = ["\x1b]0;x\x07", "\x1b[2J", "\u202e", "\n", "\r", "\x9b2J", "$\\foo$", "\t", *NAMES]
        name = "".join(rng.choice(odd) for _ in range(rng.randint(1, 4)))
        return name, rng.choice(("column", "joint", "file", "lock")), rng.choice(("csv", "json"))

    def judge(self, case: tuple[str, str, str]) -> str:
        """Run a command line; nothing that a terminal would obey may be printed."""
        name, where, form = case
        table = self.folder / "q.csv"
        write_table(table, {"shoulder": [0.4], "elbow": [1.0], name or "a": [1.0]})
        args = {
            "column": ["query", "forward", str(self.model), "--input", str(table), "--output",
                       str(self.folder / "o.csv")],
            "joint": ["train", "two_link", "--joints", f"shoulder,{name}"],
            "file": ["info", str(self.folder / "none") + name],
            "lock": ["train", "two_link", "--lock", f"{name}=1"],
        }[where]  # fmt: skip
        out, err = io.StringIO(), io.StringIO()
        code = 0
        try:
            with guarded(self.folder), redirect_stdout(out), redirect_stderr(err):
                self.app([*args, *(["--json"] if form == "json" else [])], prog_name="calib")
        except SystemExit as end:
            code = int(end.code or 0)
        for text in (out.getvalue(), err.getvalue()):
            if RAW & set(text) or "Traceback" in text or "internal error" in text:
                raise Violation(f"{where} {name!r} printed {text[:200]!r}")
        return f"{where} exit {code}"
