"""Command lines: good and bad values of every command and option, in one process or in many."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import unicodedata
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from random import Random
from unittest.mock import patch

from .arms import random_arm
from .guard import LONGEST, Violation, guarded
from .kinds import Kind
from .mutate import NAMES, NUMBERS, damaged

CODES = (0, 1, 2, 3)
BAD_NUMBERS = (*NUMBERS, "1e1000000", "9" * 5000, "nan(1)", "0b1", "１e5", "- 1", "0.1,0.2", "a")
HUGE = ("9223372036854775807", "9223372036854775808", "10" * 40, "1" * 5000, "1e9", "-1", "0",
        "1.5", "", "nan", "１２", "1_000", "4294967296x4294967296", "2000001x2", "0x10", "x", "1x1",
        "3x", "x3", "3xx3", "99999999999999999999", "7x7x7x7x7x7x7x7x7x7")  # fmt: skip

COMMANDS: dict[str, tuple[str, ...]] = {
    "robots": (),
    "train": ("robot?", "--data", "-o!", "--joints", "--tip", "--lock", "--range", "--map",
              "--motor-size", "--sensory-size", "--rule", "--epochs", "--sigma", "--noise",
              "--seed", "--motion", "--change", "--columns", "--unit", "--prismatic"),
    "query forward": ("model", "numbers", "--readout", "--input", "--output"),
    "query inverse": ("model", "numbers", "--readout", "--near", "--all", "--input", "--output"),
    "query path": ("model", "--input!", "--output", "--from", "--step"),
    "evaluate": ("model", "--data", "--columns"),
    "check": ("model", "--data!", "--columns", "--unit"),
    "adapt": ("model", "--data!", "-o", "--method", "--columns", "--unit"),
    "correct": ("model", "--input!", "--output"),
    "urdf": ("model", "-o!"),
    "babble": ("robot", "-o!", "--samples!", "--joints", "--tip", "--lock", "--range", "--noise",
               "--seed", "--motion", "--change"),
    "log": ("bag", "-o!", "--joints-topic", "--tip-topic", "--joints", "--max-gap", "--still",
            "--time-offset"),
    "preview": ("model", "--html!", "--data", "--columns", "--meshes", "--port"),
    "info": ("model",),
    "nodes": ("model", "--output"),
    "plan": ("either", "-o!", "--poses!", "--joints", "--tip", "--lock", "--range", "--margin",
             "--from", "--keep", "--data", "--columns", "--seed"),
}  # fmt: skip
RARE = {"report": ("model", "-o!", "--data"), "reproduce": ("subject", "-o!", "--seed")}
LONG = {"report": 20.0, "reproduce": 60.0}  # s; a dozen figures are work and no hang
WORKING = ("train", "train", "babble", "query inverse", "query forward", "query path", "adapt")
OF_LOGS = ("--data", "--columns", "--unit", "--prismatic")
NO_DEGREES = ("robots", "nodes", "urdf", "log", "preview", "reproduce", "report")


@dataclass(frozen=True)
class Line:
    """A command line, what is on its standard input, and two damaged files that it may name."""

    args: tuple[str, ...]
    stdin: str
    files: tuple[bytes, bytes, bytes]


class Commands(Kind):
    """Command lines within this process."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        from calib_cli.app import app

        self.app = app
        self.home = folder / "work"
        self.home.mkdir()
        (self.home / "folder").mkdir()
        os.chdir(self.home)
        for args in (
            ("train", "two_link", "--size", "5", "-n", "300", "-o", "m.calib"),
            ("train", "polar", "--size", "4", "-n", "200", "-o", "p.calib"),
            ("train", "two_link_full", "--size", "4", "-n", "200", "-o", "f.calib"),
            ("train", "three_link", "--motor-size", "3", "--sensory-size", "4", "-n", "200", "-o",
             "t.calib"),
            ("babble", "two_link", "-n", "60", "-o", "log.csv"),
            ("babble", "two_link", "-n", "30", "-o", "log.parquet"),
            ("babble", "two_link", "-n", "40", "--change", "elbow.length=+20%", "-o", "bent.csv"),
            ("train", "--data", "log.csv", "--joints", "shoulder,elbow", "--size", "4", "-o",
             "l.calib"),
        ):  # fmt: skip
            code, _, err = self.run(args, "")
            assert code == 0, err
        (self.home / "q.csv").write_text("shoulder,elbow\n0.5,1\n1,2\n-9,0\n")
        (self.home / "x.csv").write_text("x,y\n0.3,0.3\n0.3,0.31\n")
        (self.home / "far.csv").write_text("x,y\n0.3,0.3\n1e308,-1e308\nnan,1\na,b\n")
        (self.home / "r.urdf").write_bytes(random_arm(Random(5)).text.encode())
        self.kept = {path.name: path.read_bytes() for path in self.home.iterdir() if path.is_file()}

    def close(self) -> None:
        """Leave the folder."""
        os.chdir("/")

    def make(self, rng: Random) -> Line:
        """Make a command line; the sizes that it asks for are small or impossible."""
        command = rng.choice([*COMMANDS, *WORKING] if rng.random() < 0.995 else list(RARE))
        parts = {**COMMANDS, **RARE}[command]
        args = command.split()
        # all good, so that the command gets to work; one bad value; or several
        bad = rng.choice((0.0, 0.0, 1.0, 1.0, 1.0, 0.5))
        wild = bad == 0.5
        if command == "train" and not wild:  # options of logs and of babbling exclude each other
            measured = rng.random() < 0.3
            left_out = ("--noise", "--motion", "--change") if measured else OF_LOGS
            parts = tuple(part for part in parts if part not in left_out)
            parts = tuple({"--data": "--data!", "robot?": "robot"}.get(p, p) for p in parts)
            if measured:
                parts = tuple(part for part in parts if part != "--prismatic")
        one = rng.choice(parts) if parts else ""
        for part in parts:
            careful = part != one if bad == 1.0 else rng.random() > bad
            if part.startswith("-"):
                needed = part.endswith("!") or (part == one and bad == 1.0)
                if rng.random() < (0.97 if needed else 0.12):
                    args += self._option(rng, part.rstrip("!"), careful)
            elif part != "robot?" or rng.random() < 0.7:
                args += self._argument(rng, part, careful)
        if command == "train":
            args += ["--size", rng.choice(("3", *HUGE) if wild else ("3", "4", "3x4"))]
            if "--data" not in args:
                args += ["-n", rng.choice(("50", *HUGE, *NUMBERS) if wild else ("100", "60"))]
        if rng.random() < 0.3:
            args.append("--json")
        if rng.random() < 0.15 and command not in NO_DEGREES:
            args.append("--degrees")
        if wild and rng.random() < 0.5:
            self._spoil(rng, args)
        if command == "reproduce":
            args.append("--quick")  # whole experiments take minutes, which is no hang
        args = [arg.replace("\0", "") if rng.random() < 0.9 else arg for arg in args]
        stdin = rng.choice(("", "x,y\n0.3,0.3\n", "shoulder,elbow\n0.1,0.5\n", "\0\n", "a"))
        files = (
            damaged(rng, self.kept["m.calib"], 2),
            damaged(rng, self.kept["log.csv"], 2),
            damaged(rng, self.kept["r.urdf"], 2),
        )
        return Line(tuple(args), stdin, files)

    def judge(self, case: Line) -> str:
        """Run it, look at what it printed and at the files that it had no business with."""
        for name, data in zip(("bad.calib", "bad.csv", "bad.urdf"), case.files, strict=True):
            (self.home / name).write_bytes(data)
        named = (*case.args, *(arg.partition("=")[2] for arg in case.args))
        seconds = [s for command, s in LONG.items() if command in case.args]
        with guarded(self.home, named, max(seconds, default=None)):
            code, out, err = self.run(case.args, case.stdin)
        judge_output(case.args, code, out, err)
        written = set(case.args)
        for name, data in self.kept.items():
            path = self.home / name
            if not path.exists() or path.read_bytes() != data:
                # named as an output it may be replaced, but by no error
                assert code in (0, 1, 3), f"{name} changed, exit code {code}"
                assert any(name in arg for arg in written), f"{name} changed"
                path.write_bytes(data)
        for path in self.home.iterdir():
            if path.is_file() and path.name not in self.kept:
                assert not path.name.endswith(".tmp"), f"{path.name} was left behind"
                path.unlink()
        return f"{case.args[0] if case.args else ''} exit {code}"

    def run(self, args: tuple[str, ...], stdin: str) -> tuple[int, str, str]:
        """Run a command line; servers and browsers are not started."""
        out, err, before = io.StringIO(), io.StringIO(), sys.stdin
        sys.stdin = io.StringIO(stdin)
        try:
            with (
                redirect_stdout(out),
                redirect_stderr(err),
                patch("calib_cli.commands.preview._serve", lambda *_, **__: print("served")),
            ):
                try:
                    self.app(list(args), prog_name="calib")
                except SystemExit as end:
                    code = end.code if isinstance(end.code, int) else 0
        finally:
            sys.stdin = before
        return code, out.getvalue(), err.getvalue()

    def _argument(self, rng: Random, part: str, careful: bool) -> list[str]:
        if part == "numbers":
            count = 2 if careful else rng.choice((0, 1, 2, 2, 3, 40))
            good = ("0.3", "0.25", "1.0", "-0.1", "0.5")
            return [rng.choice(good if careful else (*good, *BAD_NUMBERS)) for _ in range(count)]
        if part == "subject":
            return [rng.choice(("", "table3", *NAMES[:9]))]
        good = {
            "model": ("m.calib", "m.calib", "p.calib", "f.calib", "t.calib", "l.calib"),
            "either": ("two_link", "polar", "r.urdf", "m.calib", "l.calib"),
            "bag": ("log.csv", "none.bag", "folder"),
        }.get(part, ("two_link", "two_link", "two_link_full"))
        return [rng.choice(good if careful else (*good, *FILES, *NAMES))]

    def _option(self, rng: Random, option: str, careful: bool) -> list[str]:
        good, bad = VALUES[option]
        if option == "--all":
            return [option]
        value = rng.choice(good if careful or rng.random() < 0.5 else bad)
        return [f"{option}={value}"] if rng.random() < 0.1 and option[1] == "-" else [option, value]

    def _spoil(self, rng: Random, args: list[str]) -> None:
        """Leave out, double, exchange or add an argument."""
        # without them a training would take its usual size
        places = [k for k in range(1, len(args)) if not {"--size", "-n"} & set(args[k - 1 : k + 1])]
        if not places:
            return
        k, what = rng.choice(places), rng.randrange(4)
        if what == 0:
            del args[k]
        elif what == 1:
            args.insert(k, args[k])
        elif what == 2:
            args[k] = rng.choice((*NAMES, *NUMBERS, "--", "-h", "--help", "--version", "--no-such"))
        else:
            args.append(rng.choice((*NAMES, "--", "-x", "--json", "--near", "--html", "-n")))


class Processes(Commands):
    """Command lines in processes of their own, as a shell would start them."""

    def run(self, args: tuple[str, ...], stdin: str) -> tuple[int, str, str]:
        """Run a command line as a process."""
        if any("\0" in arg for arg in args):  # no system can pass these on
            return super().run(args, stdin)
        if args[0] == "preview" and not any(arg.startswith("--html") for arg in args):
            return super().run(args, stdin)  # it would wait for Ctrl-C
        limit = (
            "import resource, sys; resource.setrlimit(resource.RLIMIT_CPU, (20, 20));"
            "from calib_cli import main; main()"
        )
        encoded = [os.fsencode(arg) if _encodable(arg) else b"?" for arg in args]
        done = subprocess.run(
            [sys.executable.encode(), b"-c", limit.encode(), *encoded],
            input=stdin.encode(), capture_output=True, check=False, timeout=200,
        )  # fmt: skip
        return done.returncode, done.stdout.decode(), done.stderr.decode()

    def judge(self, case: Line) -> str:
        """Judge what is printed; the process itself is limited by the system."""
        for name, data in zip(("bad.calib", "bad.csv", "bad.urdf"), case.files, strict=True):
            (self.home / name).write_bytes(data)
        code, out, err = self.run(case.args, case.stdin)
        judge_output(case.args, code, out, err)
        for name, data in self.kept.items():
            (self.home / name).write_bytes(data)
        return f"{case.args[0]} exit {code}"


_TOLD = (
    "not all values are numbers, no answer",
    "left out of the path",
)  # of a batch, the others answered


def judge_output(args: tuple[str, ...], code: int, out: str, err: str) -> None:
    """Check the exit code, what is said, and the JSON document.

    Raises
    ------
    Violation
        If one of them is not as the README says.
    """
    if code not in CODES:
        raise Violation(f"exit code {code}: {err[-500:]}")
    for text in (out, err):
        if "Traceback" in text or "internal error" in text or "Warning" in text:
            raise Violation(text[-1500:])
        odd = {c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp") and c not in "\n"}
        if odd:
            raise Violation(f"{sorted(odd)!r} printed: {text[:300]!r}")
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    if any(len(line) > LONGEST for line in lines):
        raise Violation(f"a line of {max(map(len, lines))} characters")
    others = [line for line in lines if not line.startswith("note: ")]
    asked = "--json" in args and "--" not in args
    if asked and code in (1, 2) and errors:  # the error is the document
        try:
            out = "" if set(json.loads(out, parse_constant=_no_constant)) == {"error"} else out
        except ValueError as error:
            raise Violation(f"no JSON error ({error}): {out[:300]!r}") from None
    if code == 2 and (len(others) != 1 or len(errors) != 1 or out):
        raise Violation(f"wrong usage told in other than one line: {out[:200]!r} {err[:500]!r}")
    if code == 1 and not (lines and len(errors) <= 1):
        raise Violation(f"an error told in other than one line: {err[:500]!r}")
    if code == 1 and not errors and not any(words in err for words in _TOLD):
        raise Violation(f"exit code 1 without an error: {err[:500]!r}")
    if code in (0, 3) and errors:
        raise Violation(f"an error and exit code {code}: {err[:300]!r}")
    if code == 3 and not lines and not out:
        raise Violation("no answer and no word")
    helps = {"--help", "--version", "-h"} & set(args)
    if "--json" in args and "--" not in args and code in (0, 3) and not helps:
        try:
            json.loads(out, parse_constant=_no_constant)
        except ValueError as error:
            raise Violation(f"no JSON ({error}): {out[:300]!r}") from None


def _no_constant(name: str) -> None:
    raise ValueError(name)


def _encodable(text: str) -> bool:
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return False
    return True


FILES = ("polar", "scara", "three_link", "bad.calib", "bad.csv", "bad.urdf", "m.calib", "log.csv", "log.parquet", "x.csv", "q.csv",  # noqa: E501
         "far.csv", "r.urdf", "folder", "none", "/dev/null", "/dev/full", "/dev/zero", "-",
         "folder/none/x", "/proc/self/mem", "/nonexistent/x.csv", "x" * 250 + ".csv")  # fmt: skip
_LOGS = ("log.csv", "log.csv", "bent.csv", "log.parquet", "bad.csv")
_OUT = ("out.csv", "out.calib", "new.parquet", "folder/out.html", "out.urdf", "m.calib", "log.csv")
_BAD_OUT = ("/dev/full", "folder", "none/x", "/proc/x", "", "x" * 300, "\0", "-", "/", "bad.csv",
            "~/x", "a\nb", "out.CSV", "CON", "/dev/null", ".", "folder/")  # fmt: skip
_PAIRS = ("0.5,1", "1,1", "0.5,1.0,0.2", "0.1,0.1")
VALUES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "--data": (_LOGS, FILES),
    "--input": (("q.csv", "x.csv", "far.csv", "log.csv", "-"), FILES),
    "--output": (_OUT, _BAD_OUT),
    "-o": (_OUT, _BAD_OUT),
    "--html": (("p.html",), _BAD_OUT),
    "--joints": (("shoulder,elbow", "elbow,shoulder"), ("a", "a,a", ",", *NAMES)),
    "--tip": (("tip", "forearm"), NAMES),
    "--lock": (("elbow=1.5", "shoulder=1"), ("elbow=nan", "=", "a=b=1", "elbow=1e308", *NAMES)),
    "--range": (("elbow=0.5:1.5", "shoulder=0.1:1.1"),
                ("elbow=1:0", "elbow=nan:1", "elbow=-1e308:1e308", "elbow=1:1", "elbow=0.5:inf",
                 "=1:2", "elbow=0.5:0.5000000001", "a=1:2", *NAMES)),
    "--map": (("vdsom", "som", "dsom", "gng", "vdsom:error"), ("vdsom:", "vdsom:x", ":", *NAMES)),
    "--motor-size": (("3", "4x3"), HUGE),
    "--sensory-size": (("3", "4x3"), HUGE),
    "--rule": (("batch", "online"), NAMES),
    "--epochs": (("1", "2"), HUGE),
    "--sigma": (("2:0.5", "1:1"), ("1e308:1e-308", "1:0", "nan:1", "1", ":", "1:2:3", "1e-320:1",
                                   "0.1:1e308", *NUMBERS)),
    "--noise": (("0", "0.001"), BAD_NUMBERS),
    "--seed": (("0", "7"), HUGE),
    "--samples": (("20", "5"), (*HUGE, *NUMBERS)),
    "--poses": (("5", "3"), (*HUGE, *NUMBERS)),
    "--margin": (("0.1", "5%"), (*BAD_NUMBERS, "50%", "1e308%", "-1%", "nan%")),
    "--keep": (("x=-0.5:0.5", "y=0.1:0.5"), ("x=1:0", "z=0:1", "x=nan:1", "x=1e308:1e309", *NAMES)),
    "--motion": (("uniform", "halton", "sobol", "smooth"), NAMES),
    "--change": (("elbow.length=+20%", "sensor.rotate=0.1", "shoulder.offset=0.05",
                  "sensor.mirror=x", "sensor.shift=0.1,0.2", "sensor.outliers=0.1",
                  "elbow.backlash=0.01", "elbow.noise=0.01"),
                 ("elbow.length=1e308", "sensor.scale=1e308", "sensor.scale=1e-320",
                  "sensor.shift=1e308,1e308", "elbow.gear=1e308", "elbow.noise=1e308", "a.b=c",
                  "elbow.length=nan", "elbow.length=+-20%", "elbow.length=-100%", "=", ".=", *NAMES,
                  "sensor.outliers=1e-320", "tip.offset=1e308,0", "elbow.gear=1e-320",
                  "shoulder.offset=1e308", "elbow.length=+1e308%", "elbow.lock=1.0")),
    "--columns": (("x=x,y=y",), ("x=y", "x=", "=x", "x=x,x=y", "q=x", "x=y,y=x", *NAMES)),
    "--unit": (("m", "mm", "px"), NAMES),
    "--prismatic": (("elbow",), NAMES),
    "--readout": (("local", "activity", "winner"), NAMES),
    "--near": (_PAIRS, (*BAD_NUMBERS, "nan,1", "1e308,1e308", ",", "1,2,3,4")),
    "--from": (_PAIRS, (*BAD_NUMBERS, "nan,1", "1e308,1e308", ",", "1,2,3,4")),
    "--step": (("0.01", "0.1", "inf"), BAD_NUMBERS),
    "--all": ((), ()),
    "--method": (("few-shot", "online"), NAMES),
    "--joints-topic": (("/joint_states",), NAMES),
    "--tip-topic": (("/tip",), NAMES),
    "--max-gap": (("0.1",), BAD_NUMBERS),
    "--still": (("0.1",), BAD_NUMBERS),
    "--time-offset": (("0.1",), BAD_NUMBERS),
    "--meshes": (("folder",), NAMES),
    "--port": (("0", "8080"), HUGE),
}  # fmt: skip
