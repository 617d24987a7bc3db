"""The command as a process: help, imports, streams and signals."""

import json
import os
import signal
import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "pinocchio", "polars", "rich", "safetensors", "yourdfpy", "meshcat"}
IMPORTS = """
import json, sys
from calib_cli import main
for line in json.loads(sys.argv[1]):
    sys.argv[1:] = line.split()
    try:
        main()
    except SystemExit:
        pass
print(json.dumps(list(sys.modules)))
"""
KINEMATICS = {"pinocchio", "yourdfpy", "meshcat", "polars", "rich"}
pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
# A command line that sends itself a signal when the function that is named is first called.
AT = """
import atexit, importlib, os, signal, sys
number, where = int(sys.argv[1]), sys.argv[2]
sys.argv[1:] = sys.argv[3:]
from calib_cli import main

def send(*args, **options):
    os.kill(os.getpid(), number)
    return original(*args, **options)

if where.startswith("import "):
    class Finder:
        @staticmethod
        def find_spec(name, path=None, target=None):
            if name == where.split()[1]:
                sys.meta_path.remove(Finder)
                os.kill(os.getpid(), number)
    sys.meta_path.insert(0, Finder)
else:
    module, _, name = where.rpartition(".")
    place = importlib.import_module(module)
    original = getattr(place, name)
    setattr(place, name, send)
    # a thread that went on computing crashed a process whose modules were taken apart: -11, not 130
    atexit.register(print, "taken apart")
main()
"""
STAGES = [
    "import calib_cli.app",
    "import scipy.spatial",
    "calib.training.train.select",
    "os.fsync",
    "os.replace",
]
STREAMS = [  # what a shell runs as "$@", with its code
    ('cat q.csv | "$@" query forward m.calib --input -', 0),
    ('"$@" query forward m.calib --input - <&-', 1),
    ('"$@" query inverse m.calib 0.1 0.4 >/dev/full', 1),
    ('"$@" info m.calib --json | true', 0),
    ('COLUMNS=1 PYTHONIOENCODING=ascii "$@" info m.calib 2>/dev/full', 0),
    ('PYTHONIOENCODING=ascii "$@" train two_link --lock é世=1 >&-', 1),
]
LIGHT = [
    (("--help", "train --help", "query inverse --help", "babble --help", "robots"), HEAVY),
    (("info MODEL",), KINEMATICS),
    (("query inverse MODEL 0.1 0.4", "query forward MODEL 0.1 0.4"), KINEMATICS | {"scipy"}),
]


@pytest.mark.parametrize(("lines", "heavy"), LIGHT)
def test_light_commands_import_nothing_heavy(model, lines, heavy):
    words = json.dumps([line.replace("MODEL", str(model)) for line in lines])
    script = [sys.executable, "-c", IMPORTS, words]
    done = subprocess.run(script, capture_output=True, text=True, check=True, timeout=60)
    assert heavy & set(json.loads(done.stdout.splitlines()[-1])) == set()


def test_the_main_job_needs_no_pinocchio(run, tmp_path, monkeypatch):
    """It has no wheel for Windows: all but collisions works without."""
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    for robot, target in (("two_link", "0.3 0.3"), ("six_axis", "0.4 0.1 0.5")):
        path = tmp_path / f"{robot}.calib"
        assert run("train", robot, "--size", "8", "-n", "400", "-o", path).code == 0
        assert run("query", "inverse", path, *target.split(), "--json").document["reachable"]
    planned = run.done("plan", "six_axis", "-n", "5", "-o", tmp_path / "poses.csv")
    assert "collision are not checked" in planned.err


@pytest.mark.parametrize(
    ("stage", "number", "code", "told"),
    [(stage, signal.SIGINT, 130, b"error: interrupted\n") for stage in STAGES]
    + [(STAGES[2], signal.SIGTERM, 143, b"")],
)
def test_a_signal_at_any_stage_leaves_the_old_file_whole(stage, number, code, told, tmp_path):
    (tmp_path / "two_link.calib").write_bytes(b"old")
    train = ["train", "two_link", "--size", "6", "-n", "300", "-o", "two_link.calib"]
    words = [sys.executable, "-c", AT, str(int(number)), stage, *train]
    done = subprocess.run(words, capture_output=True, cwd=tmp_path, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, b"", told)
    assert [path.name for path in tmp_path.iterdir()] == ["two_link.calib"]
    assert (tmp_path / "two_link.calib").read_bytes() == b"old"


@pytest.mark.parametrize(("line", "code"), STREAMS)
def test_streams_that_are_closed_full_or_narrow_end_in_order(model, tmp_path, line, code):
    (tmp_path / "m.calib").write_bytes(model.read_bytes())
    (tmp_path / "q.csv").write_text("shoulder,elbow\n0.5,1.0\n")
    words = ["sh", "-c", line, "sh", sys.executable, "-m", "calib_cli"]
    done = subprocess.run(words, capture_output=True, check=False, cwd=tmp_path, timeout=100)
    assert done.returncode == code
    assert b"Traceback" not in done.stderr
    assert not code or done.stderr


@pytest.mark.parametrize("command", ["robots", "--help", "train --help", "--version"])
def test_a_reader_who_leaves_is_no_error(command):
    """Typer ended with 1, and nothing said why."""
    words = [sys.executable, "-m", "calib_cli", *command.split()]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, timeout=60, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")
