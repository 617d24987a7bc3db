"""Ranges of an arm's joints: limits, turns, locked values."""

import numpy as np
import pytest
from chains import ENDLESS, SLIDE, chain_urdf, turning
from hypothesis import given
from hypothesis import strategies as st

import calib
from calib.arm.loading import arm_from_urdf


def test_a_range_narrows_one_joint_and_is_clipped_into_its_limits():
    arm = calib.load_arm("two_link", ranges={"elbow": (0.5, 1.0), "shoulder": (0, 1.5708)})
    np.testing.assert_array_equal([arm.lower, arm.upper], [[0, 0.5], [np.pi / 2, 1.0]])
    again = arm.with_range({"elbow": (0.3, 2.0)})  # limits are the joint's, not the last range
    assert again.lower[1] == 0.3


TURNING = {
    "twice": turning(lower="-6.3", upper="6.3"),
    "endless": turning(more=ENDLESS),
    "boundless": turning(lower="-1e16", upper="INF"),
}


@pytest.mark.parametrize("kind", TURNING)
def test_more_than_one_turn_becomes_one_turn_said_aloud(kind):
    arm = arm_from_urdf(chain_urdf(TURNING[kind], turning()))
    assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi)
    assert any("'j1'" in note and "turn" in note for note in arm.notes)
    # another turn than the one around 0 may be asked for
    other = arm.with_range({"j1": (3.0, 3.0 + np.pi)})
    assert other.upper[0] - other.lower[0] == pytest.approx(np.pi)


@given(st.floats(-50, 50), st.floats(2e-3, 50))
def test_one_turn_lies_within_its_range_as_near_to_zero_as_it_can(lower, excess):
    upper = lower + 2 * np.pi + excess
    arm = arm_from_urdf(chain_urdf(turning(lower=repr(lower), upper=repr(upper)), turning()))
    first, last = arm.lower[0], arm.upper[0]
    assert last - first == pytest.approx(2 * np.pi)
    assert lower - 1e-9 <= first < last <= upper + 1e-9
    nearest = np.clip(0.0, lower + np.pi, upper - np.pi)
    assert (first + last) / 2 == pytest.approx(nearest, abs=1e-9)


def test_a_range_mends_limits_that_are_missing_or_unusable():
    text = chain_urdf(turning(), turning(lower="2", upper="-2"))
    with pytest.raises(calib.RobotError, match=r"2 to -2 rad are unusable.*ranges=.*j2"):
        arm_from_urdf(text)
    assert arm_from_urdf(text, ranges={"j2": (-2, 2)}).upper[1] == 2
    text = chain_urdf(*[turning().split("<limit")[0]] * 2)
    with pytest.raises(calib.RobotError, match=r"j1' .*no limits.*j2' .*no limits"):
        arm_from_urdf(text)
    arm = arm_from_urdf(text, ranges={"j1": (-1, 1), "j2": (0, 1)})
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-1, 0], [1, 1]])


def test_a_slides_range_is_a_travel_that_can_be_and_a_turns_is_one_turn():
    endless = turning(axis="1 0 0", lower="-1e9", upper="1e9")
    text = chain_urdf(turning(lower="-1e9", upper="1e9"), endless + SLIDE)
    with pytest.raises(calib.OptionError, match=r"j2.*2000.*at most 1000 m apart"):
        arm_from_urdf(text, ["j1", "j2"], ranges={"j2": (0, 2000)})
    arm = arm_from_urdf(text, ["j1", "j2"], ranges={"j2": (-500, 500), "j1": (-5000, 5000)})
    np.testing.assert_allclose([arm.lower, arm.upper], [[-np.pi, -500], [np.pi, 500]])
    with pytest.raises(calib.RobotError, match=r"m are unusable.*ranges=.*j2"):
        arm_from_urdf(text, ["j1", "j2"])
