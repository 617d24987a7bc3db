"""What a log of a known robot shows to be wrong: units, columns, mirrors, lags, planes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calib
from calib.arm.rotations import exponential, matrix_of, quaternion_of
from calib.samples.diagnosis import diagnose, rows_behind
from calib.samples.tables import write_table

ARM = calib.load_arm("two_link")
SPACE = np.array([[0.8, 0.6, 0.0], [-0.36, 0.48, 0.8]])


def samples(n=120, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(ARM.lower, ARM.upper, (n, 2))
    return q, ARM.forward(q)


def path(n=300):
    t = np.linspace(0.0, 6.0, n)
    q = np.stack([0.8 + 0.6 * np.sin(t), 1.4 + 0.9 * np.sin(1.7 * t + 1)], axis=1)
    return q, ARM.forward(q)


def findings(arm, q, x, **more):
    pose = arm.pose if arm.outputs == 3 else None
    return diagnose(arm.forward, q, x, arm.joint_names, arm.revolute, pose=pose, **more)


def write(tmp_path, q, x, **others):
    file = tmp_path / "log.csv"
    write_table(file, {"shoulder": q[:, 0], "elbow": q[:, 1], **dict(zip("xyz", x.T)), **others})  # noqa: B905
    return file


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("cm", 1e2), ("in", 39.37)])
def test_other_units_of_length_are_recognised(tmp_path, unit, factor):
    q, x = samples()
    file = write(tmp_path, q, factor * x)
    with pytest.raises(calib.LogError, match=f"unit='{unit}'") as caught:
        calib.read_log(file, ARM)
    assert caught.value.parameter == "unit"
    assert calib.read_log(file, ARM, unit=unit).unit == unit


def test_pixels_are_recognised(tmp_path):
    q, x = samples()
    with pytest.raises(calib.LogError, match="unit='px'"):
        calib.read_log(write(tmp_path, q, 640 + 450 * x), ARM)


def test_exchanged_columns_are_recognised(tmp_path):
    q, x = path()
    q[:, 0] = np.clip(q[:, 0], 0.3, 1.5)
    x = ARM.forward(q)
    (found,) = findings(ARM, q[:, ::-1], x)
    assert found.kind == "exchanged"
    assert found.mistake
    assert found.hint.count("shoulder") == 2


def test_a_mirrored_axis_is_said(tmp_path):
    q, x = samples()
    log = calib.read_log(write(tmp_path, q, x * [1.0, -1.0]), ARM)
    assert any("mirrored" in note for note in log.notes)
    assert not any("mirrored" in n for n in calib.read_log(write(tmp_path, q, x), ARM).notes)


@pytest.mark.parametrize("lag", [-7, -1, 0, 2, 11])
def test_a_lag_is_counted(lag):
    q, x = path()
    x = x @ np.array([[0.6, -0.8], [0.8, 0.6]]) + np.random.default_rng(0).normal(0, 1e-4, x.shape)
    assert rows_behind(ARM.forward, q, np.roll(x, lag, axis=0)) == lag


@pytest.mark.parametrize("lag", [-2, 1])
def test_shifted_rows_of_poses_in_any_order_are_counted(lag):
    q, x = samples()
    assert rows_behind(ARM.forward, q, np.roll(x, lag, axis=0)) == lag


def test_a_joint_of_an_arm_in_space_that_counts_the_other_way_is_named():
    arm = calib.load_arm("spatial_three")
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (60, 3))
    turned = q * [1.0, -1.0, 1.0]
    assert findings(arm, q, arm.forward(q)) == ()
    (found,) = findings(arm, turned, arm.forward(q))
    assert (found.kind, found.value, found.mistake) == ("reversed", [arm.joint_names[1]], True)


@settings(max_examples=40)
@given(
    turn=st.floats(-3.1, 3.1),
    shift=st.floats(-5, 5),
    stretch=st.floats(0.8, 1.25),
    offset=st.floats(-0.15, 0.15),
    length=st.floats(0.9, 1.1),
)
def test_a_sound_log_in_any_frame_is_not_doubted(turn, shift, stretch, offset, length):
    """Whatever the sensor's frame; links and offsets may differ by a tenth."""
    q, _ = samples(80)
    changed = ARM.with_link_length("elbow", 0.25 * length)
    x = stretch * changed.forward(q + np.array([0.0, offset]))
    c, s = np.cos(turn), np.sin(turn)
    seen = x @ np.array([[c, -s], [s, c]]).T + shift
    assert findings(ARM, q, seen) == ()


def test_positions_that_leave_the_plane_are_refused(tmp_path):
    q, x = samples()
    space = x @ SPACE + 1.0
    assert calib.read_log(write(tmp_path, q, space), ARM).plane is not None
    normal = np.cross(*SPACE)
    space[17] += 0.2 * normal
    space[40:80] += 0.03 * normal
    with pytest.raises(calib.LogError, match=r"row 18 by 0\.1.*joints"):
        calib.read_log(write(tmp_path, q, space), ARM)


def test_a_locked_joint_that_moved_is_refused_and_a_wrong_reading_is_not(tmp_path):
    from calib.samples.joint_values import locked_from_log

    pan = np.full(200, 0.25)
    pan[7] = 0.6
    write_table(tmp_path / "log.csv", {"pan": pan})
    values, notes = locked_from_log(tmp_path / "log.csv", ["pan"])
    assert values == {"pan": 0.25}
    assert "moved by up to" in notes[0]
    pan[50:90] += np.linspace(0.0, 0.5, 40)
    write_table(tmp_path / "log.csv", {"pan": pan})
    with pytest.raises(calib.LogError, match=r"pan is locked but moved.*row 90.*joints"):
        locked_from_log(tmp_path / "log.csv", ["pan"])


def test_a_joint_of_a_planar_arm_that_counts_the_other_way_is_noted(tmp_path):
    arm = calib.load_arm("two_link_full")
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (120, 2))
    q[:, 1] = np.clip(q[:, 1], -1.5, 1.5)
    for seen in (arm.forward(q), arm.forward(q) * [-1.0, 1.0]):
        (found,) = findings(arm, q * [1.0, -1.0], seen)
        assert found.kind == "reversed"
        assert not found.mistake
    assert findings(arm, q, arm.forward(q)) == ()


def test_a_reversed_wrist_is_found_behind_an_unknown_tool():
    """It trained without a word to 9 mm where the arm's own errors are .1 mm."""
    arm = calib.load_arm("six_axis")
    rng = np.random.default_rng(7)
    q = rng.uniform(np.maximum(arm.lower, -1.5), np.minimum(arm.upper, 1.5), (150, 6))
    place, turn = arm.pose(q)
    v, w = turn[:, :3], turn[:, 3:]
    tool = np.array([0.03, -0.02, 0.04])
    across = np.cross(v, tool) + w * tool
    seen = place + tool + 2.0 * np.cross(v, across) + rng.normal(0.0, 5e-4, place.shape)
    for k in (3, 4, 5):
        wrong = q.copy()
        wrong[:, k] *= -1.0
        (found,) = findings(arm, wrong, seen)
        assert (found.kind, found.value) == ("reversed", [arm.joint_names[k]])
    assert findings(arm, q, seen) == ()


def test_a_value_beyond_the_limits_is_not_taken_for_degrees_within_one_turn(tmp_path):
    """Exchanged columns of 0 to 2.6 rad were told to be degrees."""
    q, x = samples()
    with pytest.raises(calib.LogError, match="check that the column is of this joint") as caught:
        calib.read_log(write(tmp_path, q[:, ::-1], x), ARM)
    assert caught.value.parameter == "ranges"
    with pytest.raises(calib.LogError, match="its sign"):
        calib.read_log(write(tmp_path, q * [1.0, -1.0], x), ARM)
    with pytest.raises(calib.LogError, match="degrees=True"):
        calib.read_log(write(tmp_path, np.degrees(q), x), ARM)


def poses(robot="six_axis", n=120, seed=3):
    arm = calib.load_arm(robot)
    rng = np.random.default_rng(seed)
    q = rng.uniform(np.maximum(arm.lower, -1.5), np.minimum(arm.upper, 1.5), (n, arm.dof))
    return arm, q, *arm.pose(q)


def written_poses(path, arm, q, x, turns):
    names = (*arm.joint_names, *"xyz", "qx", "qy", "qz", "qw")
    write_table(path, dict(zip(names, np.hstack([q, x, turns]).T, strict=True)))
    return path


def test_quaternions_that_begin_with_w_are_told_with_the_remedy(tmp_path):
    """adapt said "tool turned by 171 deg", exit 0."""
    arm, q, x, turns = poses()
    file = written_poses(tmp_path / "a.csv", arm, q, x, turns[:, [3, 0, 1, 2]])
    with pytest.raises(calib.LogError, match="order w, x, y, z") as caught:
        calib.read_log(file, arm)
    remedy = {"qx": "qy", "qy": "qz", "qz": "qw", "qw": "qx"}
    assert str(remedy) in caught.value.hint
    assert calib.read_log(file, arm, columns=remedy).orientation is not None


def test_inverted_poses_are_told(tmp_path):
    """They got "the robot does not explain the positions" alone."""
    arm, q, x, turns = poses()
    frame = exponential(np.array([[0.3, -0.2, 0.9]]))[0]
    seen, place = frame @ matrix_of(turns), x @ frame.T + [0.5, 1.0, -0.2]
    back = np.swapaxes(seen, 1, 2)
    inverse = -(back @ place[:, :, None])[:, :, 0]
    file = written_poses(tmp_path / "a.csv", arm, q, inverse, quaternion_of(back))
    with pytest.raises(calib.LogError, match="poses are inverted"):
        calib.read_log(file, arm)
    file = written_poses(tmp_path / "b.csv", arm, q, place, quaternion_of(back))
    with pytest.raises(calib.LogError, match="orientations are inverted"):
        calib.read_log(file, arm)
    assert (
        calib.read_log(
            written_poses(tmp_path / "c.csv", arm, q, place, quaternion_of(seen)), arm
        ).notes
        == ()
    )


def test_one_lost_row_is_no_unit(tmp_path):
    """One row of x = 1000 was told as 257 times the size, "for pixels give --unit px"."""
    q, x = samples()
    x[40] = [1000.0, 0.0]
    assert calib.read_log(write(tmp_path, q, x), ARM).notes == ()


def test_an_arm_of_three_hundred_metres_is_told(tmp_path):
    """A log in mm without a robot was learned without a note."""
    q, x = samples()
    file = write(tmp_path, q, 1e3 * x)
    names = list(ARM.joint_names)
    assert any("unit='mm'" in note for note in calib.read_log(file, joints=names).notes)
    assert calib.read_log(file, joints=names, unit="mm").notes == ()


def test_a_unit_against_what_the_log_states_is_refused(tmp_path):
    q, x = samples()
    columns = {"shoulder": q[:, 0], "elbow": q[:, 1], "x": x[:, 0], "y": x[:, 1]}
    write_table(tmp_path / "log.csv", columns, about={"unit": "m"})
    with pytest.raises(calib.LogError, match="states that its positions are in m") as caught:
        calib.read_log(tmp_path / "log.csv", ARM, unit="mm")
    assert caught.value.parameter == "unit"
