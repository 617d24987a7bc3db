"""Ctrl-C and SIGTERM, at every stage: no traceback, no result, nothing left, the old file whole."""

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")

# A command line that sends itself a signal when the function that is named is first called.
AT = """
import importlib, os, signal, sys
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
main()
"""

STAGES = [
    "import calib_cli.app",
    "import scipy.spatial",
    "calib.training.train.select",
    "os.fsync",
    "os.replace",
]


def at(stage, number, folder):
    command = ["train", "two_link", "--size", "6", "-n", "300", "-o", "two_link.calib"]
    return subprocess.run(
        [sys.executable, "-c", AT, str(int(number)), stage, *command],
        capture_output=True,
        cwd=folder,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize(
    ("stage", "number", "code", "told"),
    [(stage, signal.SIGINT, 130, b"error: interrupted\n") for stage in STAGES]
    + [(STAGES[2], signal.SIGTERM, 143, b"")],
)
def test_a_signal_at_any_stage_leaves_the_old_file_whole(stage, number, code, told, tmp_path):
    (tmp_path / "two_link.calib").write_bytes(b"old")
    done = at(stage, number, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (code, b"", told)
    assert [path.name for path in tmp_path.iterdir()] == ["two_link.calib"]
    assert (tmp_path / "two_link.calib").read_bytes() == b"old"
