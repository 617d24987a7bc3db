"""Streams: pipes as logs, small alphabets and narrow terminals; see also tests/hostile."""

import os
import threading

import numpy as np
import pytest

import calib

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes with a name are POSIX")


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
