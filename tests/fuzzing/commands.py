"""Command lines: good and bad values of every command and option."""

from __future__ import annotations

import io
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from random import Random
from unittest.mock import patch

from .arms import random_arm
from .guard import guarded
from .kinds import Kind
from .mutate import NAMES, NUMBERS, damaged
from .options import (
    BAD_NUMBERS,
    COMMANDS,
    FILES,
    HUGE,
    LONG,
    NO_DEGREES,
    OF_LOGS,
    RARE,
    VALUES,
    WORKING,
)
from .printed import judge_output


class _NoServer:
    """In the place of the preview's server: takes no port and ends at once."""

    url = "served"

    def __init__(self, *_: object) -> None:
        pass

    def __enter__(self) -> _NoServer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def serve_forever(self, **_: float) -> None:
        """Serve nobody."""


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
        if command == "train" and rng.random() < 0.8:  # a log's options and babbling's exclude each
            measured = rng.random() < 0.3  # other, which wild ones may try
            left_out = ("--noise", "--motion", "--change", "--prismatic") if measured else OF_LOGS
            parts = tuple(part for part in parts if part not in left_out)
            parts = tuple({"--data": "--data!", "robot?": "robot"}.get(p, p) for p in parts)
        # all good, so that the command gets to work; one bad value; or several
        way = rng.choice(("good", "good", "one", "one", "one", "wild"))
        wild = way == "wild"
        bad = {"good": (), "wild": [p for p in parts if rng.random() < 0.5]}.get(
            way, [rng.choice(parts)] if parts else ()
        )
        for part in parts:
            if part.startswith("-"):
                needed = part.endswith("!") or (part in bad and not wild)
                if rng.random() < (0.97 if needed else 0.12):
                    args += self._option(rng, part.rstrip("!"), part not in bad)
            elif part != "robot?" or rng.random() < 0.7:
                args += self._argument(rng, part, part not in bad)
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
                patch("calib.show.preview.server.PreviewServer", _NoServer),
                patch("webbrowser.open", lambda _: True),
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
