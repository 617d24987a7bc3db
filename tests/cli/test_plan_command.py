"""The command `calib plan`."""

import numpy as np
import pytest

import calib


@pytest.fixture(scope="module")
def arm():
    return calib.load_arm("two_link")


# --- the command --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["poses.csv", "poses.parquet"])
def test_command_writes_what_python_plans(run, tmp_path, arm, name):
    path = tmp_path / name
    done = run("plan", "two_link", "-n", "20", "--seed", "3", "--from", "0.5,1", "-o", path)
    assert done.code == 0, done.err
    assert "joints travel" in done.out
    log = calib.read_log(path, arm, columns={"x": "expected_x", "y": "expected_y"})
    np.testing.assert_array_equal(log.q, calib.plan(arm, 20, seed=3, start=[0.5, 1.0]).q)


def test_command_completes_a_log(run, log, tmp_path, arm):
    done = run("plan", "two_link", "-n", "6", "--data", log, "-o", "-")
    assert done.code == 0
    assert "beside the 400 measured ones" in done.err
    rows = [[float(v) for v in line.split(",")[:2]] for line in done.out.splitlines()[1:]]
    expected = calib.plan(arm, 6, measured=calib.read_log(log, arm)).q
    np.testing.assert_array_equal(rows, expected)


@pytest.mark.parametrize(
    ("args", "code", "part"),
    [
        (["two_link"], 2, "-o"),
        (["two_link", "-n", "5000"], 2, "at most 1000"),
        (["two_link", "--margin", "-1"], 2, "zero or more"),
        (["two_link", "--from", "1"], 2, "2 values"),
        (["two_link", "--from", "1,9"], 1, "elbow = 9"),
        (["two_linc"], 1, "did you mean two_link"),
        (["MODEL", "--tip", "t"], 2, "--tip is for ROBOT"),
        (["MODEL", "--range", "elbow=0:9"], 1, "limits"),
    ],
)
def test_command_errors_are_one_line_and_write_nothing(run, model, tmp_path, args, code, part):
    path = tmp_path / "p.csv"
    words = [str(model) if arg == "MODEL" else arg for arg in args]
    output = [] if part == "-o" else ["-o", str(path)]
    done = run("plan", *words, *output)
    assert done.code == code
    assert part in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert done.out == ""
    assert not path.exists()
