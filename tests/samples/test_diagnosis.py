"""What a log of a known robot shows to be wrong: units, columns, mirrors, lags, planes, poses."""

import numpy as np
import pytest
from conftest import refused
from hypothesis import given, settings
from hypothesis.strategies import floats
from reference import write_columns

import calib
from calib.arm.rotations import exponential, matrix_of, quaternion_of

TWO_LINK = calib.load_arm("two_link")
FULL = calib.load_arm("two_link_full")
SIX = calib.load_arm("six_axis")
POSE = (*"xyz", "qx", "qy", "qz", "qw")
MISREAD = {  # of a planar log: joints, positions, what the refusal says
    "pixels": (lambda q, x: (q, 640 + 450 * x), "unit='px'"),
    "exchanged": (lambda q, x: (q[:, ::-1], x), "exchanged"),
    "exchanged beyond limits": (lambda q, x: (drawn()[0][:, ::-1], drawn()[1]), "of this joint"),
    "negative": (lambda q, x: (q * [1.0, -1.0], x), "its sign"),
    "degrees": (lambda q, x: (np.degrees(q), x), "degrees=True"),
}


def drawn(arm=TWO_LINK, n=120, seed=0):
    """Joints (n, dof), not beyond 1.5 rad where an arm may turn further, and what they reach."""
    lower, upper = arm.lower, arm.upper
    if arm is not TWO_LINK:
        lower, upper = np.maximum(lower, -1.5), np.minimum(upper, 1.5)
    q = np.random.default_rng(seed).uniform(lower, upper, (n, arm.dof))
    return q, arm.forward(q)


@pytest.fixture
def read(tmp_path):
    """Read a log that is written with these columns."""

    def read(arm, q, x, about=None, **options):
        columns = dict(zip((*arm.joint_names, *POSE), np.hstack([q, x]).T, strict=False))
        write_columns(tmp_path / "log.csv", columns, about=about)
        return calib.read_log(tmp_path / "log.csv", arm, **options)

    return read


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("um", 1e6), ("in", 39.37)])
def test_other_units_of_length_are_recognised(read, tmp_path, unit, factor):
    q, x = drawn()
    caught = refused(calib.LogError, f"unit='{unit}'", read, TWO_LINK, q, factor * x)
    assert caught.parameter == "unit"
    assert read(TWO_LINK, q, factor * x, unit=unit).unit == unit
    if unit == "mm":  # without a robot an arm of three hundred metres is doubted
        notes = calib.read_log(tmp_path / "log.csv", joints=list(TWO_LINK.joint_names)).notes
        assert any("unit='mm'" in note for note in notes)
    with pytest.raises(calib.LogError, match="states that its positions are in m"):
        read(TWO_LINK, q, x, about={"unit": "m"}, unit=unit)
    # metres that are said to be in it: a model of links of .3 mm was written, without a word
    assert refused(calib.LogError, "unit='m'", read, TWO_LINK, q, x, unit=unit).value == unit


@pytest.mark.parametrize("arm", [TWO_LINK, SIX])
def test_radians_that_are_said_to_be_degrees_are_told(read, arm):
    refused(calib.LogError, "leave out `degrees`", read, arm, *drawn(arm), degrees=True)


@pytest.mark.parametrize("case", MISREAD)
def test_a_planar_log_that_was_misread_is_refused_with_the_remedy(read, case):
    change, words = MISREAD[case]
    t = np.linspace(0.0, 6.0, 300)
    q = np.stack([0.9 + 0.6 * np.sin(t), 1.4 + 0.9 * np.sin(1.7 * t + 1)], axis=1)
    q = np.clip(q, 0.3, 1.5) if case == "exchanged" else q
    refused(calib.LogError, words, read, TWO_LINK, *change(q, TWO_LINK.forward(q)))


def test_mirrors_and_reversed_joints_of_a_planar_arm_are_notes_and_one_lost_row_is_no_unit(read):
    q, x = drawn(FULL)
    assert read(FULL, q, x).notes == ()
    for seen in (x, x * [-1.0, 1.0]):
        assert "the other way" in " ".join(read(FULL, q * [1.0, -1.0], seen).notes)
    q, x = drawn()
    assert "mirrored" in " ".join(read(TWO_LINK, q, x * [1.0, -1.0]).notes)
    # one lost row was told as 257 times the size, "for pixels give --unit px"
    x[40] = [1000.0, 0.0]
    assert read(TWO_LINK, q, x).notes == ()


@pytest.mark.parametrize("joint", [3, 4, 5])
def test_a_joint_in_space_that_counts_the_other_way_is_named(read, joint):
    """Behind an unknown tool, too: a wrist trained without a word to 9 mm."""
    q, x = drawn(SIX, seed=7)
    x = x + matrix_of(SIX.pose(q)[1]) @ [0.03, -0.02, 0.04]
    x += np.random.default_rng(1).normal(0.0, 5e-4, x.shape)
    assert read(SIX, q, x).notes == ()
    turned = q * np.where(np.arange(SIX.dof) == joint, -1.0, 1.0)
    refused(calib.LogError, f"{SIX.joint_names[joint]}.*the other way", read, SIX, turned, x)


@settings(max_examples=40)
@given(floats(-3.1, 3.1), floats(-5, 5), floats(0.8, 1.25), floats(-0.15, 0.15), floats(0.9, 1.1))
def test_a_sound_log_in_any_frame_is_not_doubted(read, angle, shift, stretch, offset, length):
    """Whatever the sensor's frame; links and offsets may differ by a tenth."""
    q, _ = drawn(n=80)
    changed = TWO_LINK.with_link_length("elbow", 0.25 * length)
    x = stretch * changed.forward(q + np.array([0.0, offset]))
    c, s = np.cos(angle), np.sin(angle)
    assert read(TWO_LINK, q, x @ np.array([[c, -s], [s, c]]).T + shift).notes == ()


def test_positions_that_leave_the_plane_are_refused(read):
    q, x = drawn()
    plane = np.array([[0.8, 0.6, 0.0], [-0.36, 0.48, 0.8]])
    space = x @ plane + 1.0
    assert read(TWO_LINK, q, space).plane is not None
    normal = np.cross(*plane)
    space[17] += 0.2 * normal
    space[40:80] += 0.03 * normal
    refused(calib.LogError, r"row 18 by 0\.1.*joints", read, TWO_LINK, q, space)


def test_poses_that_are_none_are_told_with_the_remedy(read, tmp_path):
    """adapt said "tool turned by 171 deg", exit 0."""
    q, x = drawn(SIX, seed=3)
    turns = SIX.pose(q)[1]
    with pytest.raises(calib.LogError, match="order w, x, y, z") as caught:
        read(SIX, q, np.hstack([x, turns[:, [3, 0, 1, 2]]]))
    remedy = {"qx": "qy", "qy": "qz", "qz": "qw", "qw": "qx"}
    assert str(remedy) in caught.value.hint
    log = calib.read_log(tmp_path / "log.csv", SIX, columns=remedy)
    np.testing.assert_allclose(np.abs((log.orientation * turns).sum(axis=1)), 1.0, atol=1e-12)
    frame = exponential(np.array([[0.3, -0.2, 0.9]]))[0]
    seen, place = frame @ matrix_of(turns), x @ frame.T + [0.5, 1.0, -0.2]
    inverted = np.hstack([place, quaternion_of(np.swapaxes(seen, 1, 2))])
    refused(calib.LogError, "orientations are inverted", read, SIX, q, inverted)
    assert read(SIX, q, np.hstack([place, quaternion_of(seen)])).notes == ()
