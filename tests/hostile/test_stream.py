"""Standard streams that are closed, full, broken, narrow or in few letters."""

import csv
import io
import os
import subprocess
import sys

import numpy as np
import pytest
from models import trained

import calib
from hostile.guard import RAW

# what a stream is, and how a shell says it
IN = {"closed": "<&-", "empty": "</dev/null", "rows": "<q.csv", "pipe": "", "folder": "<."}
OUT = {"file": ">out", "closed": ">&-", "full": ">/dev/full", "broken": "| true"}
ERR = {"file": "2>err", "closed": "2>&-", "full": "2>/dev/full"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("streams")
    trained("two_link", 300, 4).save(folder / "m.calib")
    calib.write_log(calib.babble(calib.load_arm("two_link"), 60, seed=1), folder / "l.csv")
    (folder / "q.csv").write_text("shoulder,elbow\n0.5,1.0\n")
    return folder


def judge(folder, command, stdin, stdout, stderr, encoding, columns):
    """Run it; what is said has to be an answer that is right, or an error in order."""
    for name in ("out", "err"):
        (folder / name).write_bytes(b"")
    before = "cat q.csv | " if stdin == "pipe" else ""
    line = (
        f"{before}{sys.executable} -m calib_cli {command} {IN[stdin]} {ERR[stderr]} {OUT[stdout]}"
    )
    env = {**os.environ, "PYTHONIOENCODING": encoding, "COLUMNS": columns}
    code = subprocess.run(
        ["sh", "-c", line], timeout=200, check=False, cwd=folder, env=env
    ).returncode
    out, err = ((folder / name).read_bytes().decode(encoding) for name in ("out", "err"))
    for text in (out, err):
        assert "Traceback" not in text
        assert "internal error" not in text
        assert not RAW & set(text)
    assert code in (0, 1, 2, 3) or stdout == "broken"  # there the shell tells of `true`
    assert code or out or stdout != "file", "no answer and no error"
    assert code or err or stdout != "full" or stderr != "file", "what was not written is not told"
    if code == 0 and out and "forward" in command and "--json" not in command:
        row = next(csv.DictReader(io.StringIO(out)))
        end = 0.30 * np.exp(0.5j) + 0.25 * np.exp(1.5j)
        assert abs(float(row["x"]) + 1j * float(row["y"]) - end) < 1e-3
    return f"exit {code}"


@pytest.mark.parametrize(
    "case",
    [
        "query forward m.calib --input -;pipe;file;file;utf-8;80",
        "query forward m.calib --input -;closed;file;file;utf-8;80",
        "query inverse m.calib 0.1 0.4 --all;rows;full;file;utf-8;80",
        "info m.calib --json;rows;broken;file;utf-8;80",
        "info m.calib;rows;file;full;ascii;1",
        "train two_link --lock é世=1;empty;closed;file;ascii;20",
    ],
)
def test_streams_that_once_broke_a_command(folder, case):
    judge(folder, *case.split(";"))
