"""Streams: pipes as logs, small alphabets and narrow terminals; see also tests/hostile."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

import calib

CALIB = [sys.executable, "-m", "calib_cli"]

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes with a name are POSIX")


def shell(command, **env):
    return subprocess.run(
        ["sh", "-c", command, "sh", *CALIB],
        capture_output=True,
        timeout=60,
        check=False,
        env={**os.environ, **env},
    )


def test_a_named_pipe_is_read_like_a_file(tmp_path, log):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    content = log.read_bytes()
    thread = threading.Thread(target=lambda: pipe.write_bytes(content))
    thread.start()
    read = calib.read_log(pipe, joints=["shoulder", "elbow"])
    thread.join(5.0)
    direct = calib.read_log(log, joints=["shoulder", "elbow"])
    np.testing.assert_array_equal(read.q, direct.q)
    np.testing.assert_array_equal(read.x, direct.x)


def test_a_device_without_end_is_refused():
    with pytest.raises(calib.LogError, match="is a device"):
        calib.read_log("/dev/zero", joints=["a", "b"])


def test_names_beyond_the_alphabet_of_a_terminal(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "log.csv"
    q = rng.uniform(0.2, 1.4, (60, 2))
    x = np.stack([np.cos(q[:, 0]) + np.cos(q.sum(1)), np.sin(q[:, 0]) + np.sin(q.sum(1))], axis=1)
    calib.write_log(
        calib.Samples(q, x, ("Schulter", "肘é"), q.min(0), q.max(0), (True, True)), path
    )
    done = shell(
        f'"$@" train --data "{path}" --joints "Schulter,肘é" --size 5 -o "{tmp_path}/m.calib"',
        PYTHONIOENCODING="ascii",
        PYTHONUTF8="0",
    )
    assert done.returncode == 0, done.stderr
    assert "\\u8098" in done.stdout.decode("ascii")
