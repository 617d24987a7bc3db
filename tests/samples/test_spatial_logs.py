"""Logs of arms that move in space: x, y, z and an orientation."""

import numpy as np
import pytest

from calib import LogError, load_arm, read_log, write_log
from calib.arm.rotations import exponential, matrix_of

NAMES = ("shoulder_pan", "shoulder_lift", "elbow")


def poses(n=40, seed=0):
    arm = load_arm("spatial_three")
    q = np.random.default_rng(seed).uniform(arm.lower, arm.upper, (n, 3))
    return arm, q, *arm.pose(q)


def written(path, columns):
    names = list(columns)
    rows = np.column_stack([columns[name] for name in names])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return path


def columns_of(q, x, **more):
    return {**dict(zip(NAMES, q.T, strict=True)), **dict(zip("xyz", x.T, strict=True)), **more}


def test_positions_and_quaternions_are_read_and_written(tmp_path):
    arm, q, x, turns = poses()
    more = dict(zip(("qx", "qy", "qz", "qw"), -turns.T, strict=True))  # the same orientations
    log = read_log(written(tmp_path / "a.csv", columns_of(q, x, **more)), arm)
    np.testing.assert_array_equal(log.x, x)
    np.testing.assert_allclose(log.orientation, turns, atol=1e-15)
    assert log.plane is None
    write_log(log, tmp_path / "b.csv")
    again = read_log(tmp_path / "b.csv", arm)
    np.testing.assert_array_equal(again.x, log.x)
    np.testing.assert_allclose(again.orientation, log.orientation, atol=1e-15)
    assert again.take([3, 5]).orientation.shape == (2, 4)


def test_roll_pitch_and_yaw_turn_as_in_a_urdf(tmp_path):
    arm, q, x, _ = poses()
    angles = np.random.default_rng(1).uniform(-1, 1, (len(q), 3))
    more = dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))
    log = read_log(written(tmp_path / "a.csv", columns_of(q, x, **more)), arm)
    roll, pitch, yaw = (exponential(angles[0, k] * np.eye(3)[k]) for k in range(3))
    np.testing.assert_allclose(matrix_of(log.orientation[0]), yaw @ pitch @ roll, atol=1e-12)


def test_quaternions_that_are_none_are_told_in_one_line(tmp_path):
    arm, q, x, turns = poses()
    turns[7:30] = (0.5, 0.5, 0.0, 0.0)
    more = dict(zip(("qx", "qy", "qz", "qw"), turns.T, strict=True))
    path = written(tmp_path / "a.csv", columns_of(q, x, **more))
    log = read_log(path, arm)
    assert len(log) == log.left_out - 6 == 17
    assert "length 0.7071, expected 1; left out: rows 8, 9" in log.notes[0]


def test_without_an_arm_positions_off_any_plane_stay_in_space(tmp_path):
    _, q, x, _ = poses()
    log = read_log(written(tmp_path / "a.csv", columns_of(q, x)), joints=NAMES)
    assert log.x.shape == (40, 3)
    flat = x * (1, 1, 1e-4)
    log = read_log(written(tmp_path / "b.csv", columns_of(q, flat)), joints=NAMES)
    assert log.x.shape == (40, 2)
    assert log.plane is not None


def test_positions_in_a_plane_stay_in_space_for_a_model_of_an_arm_in_space(tmp_path):
    arm = load_arm("spatial_three")
    q = np.stack([1e-3 * np.sin(np.arange(30)), *np.linspace([0.1, 0.2], 1.0, 30).T], axis=1)
    path = tmp_path / "flat.csv"
    rows = np.column_stack([q, arm.forward(q)])
    np.savetxt(path, rows, delimiter=",", header=f"{','.join(arm.joint_names)},x,y,z", comments="")
    assert read_log(path, joints=arm.joint_names).x.shape == (30, 2)
    read = read_log(path, joints=arm.joint_names, outputs=3)
    np.testing.assert_allclose(read.x, arm.forward(q), atol=1e-12)
    text = path.read_text().replace("x,y,z", "x,y,height")
    path.write_text(text)
    with pytest.raises(LogError, match="x and y alone"):
        read_log(path, joints=arm.joint_names, outputs=3)
