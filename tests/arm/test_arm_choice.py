"""Which arm of a robot is chosen, and what is told where none can be."""

import numpy as np
import pytest
from chains import SLIDE, branching, chain_urdf, turning

from calib.arm.description import parse_robot
from calib.arm.finding import find_tip
from calib.arm.loading import arm_from_urdf, load_arm
from calib.errors import RobotError


def test_the_order_of_the_joints_does_not_matter():
    arm = load_arm("three_link", ["wrist", "shoulder", "elbow"])
    assert arm.joint_names == ("shoulder", "elbow", "wrist")
    assert load_arm("three_link", "elbow,shoulder").joint_names == ("shoulder", "elbow")


def test_other_joints_are_locked_at_neutral_or_where_told():
    arm = load_arm("three_link", ["shoulder", "wrist"])
    assert arm.locked == {"elbow": pytest.approx(np.deg2rad(15))}  # 0 clipped into its limits
    assert any("elbow=0.2618" in note for note in arm.notes)
    told = load_arm("three_link", ["shoulder", "wrist"], lock={"elbow": 1.0})
    assert told.locked == {"elbow": 1.0}
    full = load_arm("three_link")
    expected = full.forward([0.3, 1.0, -0.2])
    np.testing.assert_allclose(told.forward([0.3, -0.2]), expected, atol=1e-15)


def test_a_follower_is_held_where_its_leader_is():
    mimic = '<mimic joint="j2" multiplier="-2" offset="0.1"/>'
    text = chain_urdf(turning(), turning(), turning(more=mimic), turning())
    arm = arm_from_urdf(text, ["j1", "j4"], lock={"j2": 0.2})
    assert arm.locked == {"j2": 0.2, "j3": pytest.approx(-0.3)}


def test_two_slides_make_a_plane():
    arm = arm_from_urdf(chain_urdf(turning(axis="1 0 0") + SLIDE, turning(axis="0 2 0") + SLIDE))
    assert arm.revolute == (False, False)
    np.testing.assert_allclose(arm.forward([0.1, 0.2]), [0.6 + 0.2 + 0.1, 0.2], atol=1e-15)
    np.testing.assert_allclose(arm.jacobian([0.1, 0.2]), np.eye(2), atol=1e-15)


def test_what_had_to_be_chosen_is_said_aloud():
    text = chain_urdf(turning(), turning(), turning(axis="0 1 0"))
    assert arm_from_urdf(text, ["j1", "j2"]).notes == (
        "locked at neutral: j3=0 (`lock` changes it)",
    )
    assert arm_from_urdf(text, ["j1", "j2"], "tip", lock={"j3": 9}).notes == (
        "`lock={'j3': 9}` lies outside the joint's limits -1:1 [rad]",
    )
    assert load_arm("two_link", ["shoulder", "elbow"]).notes == ()


def test_a_tip_may_be_named_by_its_joint():
    assert load_arm("two_link", tip="tip_mount").tip == "tip"


@pytest.mark.parametrize(("angle", "planar"), [(0.9e-4, True), (1.1e-4, False)])
def test_axes_may_differ_by_a_ten_thousandth(angle, planar):
    text = chain_urdf(turning(), turning(axis=f"{np.sin(angle)} 0 {-np.cos(angle)}"))
    if planar:
        assert arm_from_urdf(text, ["j1", "j2"]).joint_names == ("j1", "j2")
    else:
        assert arm_from_urdf(text, ["j1", "j2"]).outputs == 3
        with pytest.raises(RobotError, match="not planar"):
            arm_from_urdf(text, ["j1", "j2"], planar=True)


USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert find_tip(parse_robot(text.replace(*order)), "l0") == name
