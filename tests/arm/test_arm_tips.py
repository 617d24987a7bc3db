"""Which tip of a robot is followed, and which like arms are named beside it."""

from __future__ import annotations

import pytest
from chains import NO_TIP, branching, turning

from calib.arm.finding import find_tip
from calib.arm.loading import arm_from_urdf, load_arm
from calib.arm.urdf import parse_urdf
from calib.errors import RobotError


def test_at_a_branching_a_tools_name_is_followed_or_else_the_only_way_with_joints():
    far = '<origin xyz="0.1 0 0"/>'
    plain = parse_urdf(branching(far, "camera", kind="fixed"))
    assert find_tip(plain, "l1") == "tip"  # the usual name of a tip
    odd = branching(far, "camera", kind="fixed").replace('"tip"', '"lamp"')
    assert find_tip(parse_urdf(odd), "l1") == "l2"  # neither is better
    assert find_tip(parse_urdf(odd.replace("camera_link", "my_TCP")), "l0") == "my_TCP"
    two = odd.replace("camera_link", "left_tool0").replace('"lamp"', '"right_tool0"')
    assert find_tip(parse_urdf(two), "l0") == "l2"
    # a cover beside the one link that goes on moving
    onward = branching(turning(), "wrist").replace('"tip"', '"cover"')
    assert find_tip(parse_urdf(onward), "l0") == "wrist_link"
    # a fixed part that carries a joint counts as well as a joint does
    mounted = parse_urdf(
        odd.replace(
            "</robot>",
            '<link name="end"/><joint name="j" type="revolute"><parent link="camera_link"/>'
            f'<child link="end"/>{turning()}</joint></robot>',
        )
    )
    assert find_tip(mounted, "l0") == "end"


USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert find_tip(parse_urdf(text.replace(*order)), "l0") == name


@pytest.mark.parametrize("name", ["tool0_cover", "tips", "end_effectors", "see_through"])
def test_a_name_that_only_holds_a_usual_one_is_none(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    assert find_tip(parse_urdf(text.replace("camera_link", name)), "l0") == "l2"


def test_a_tip_on_the_axis_is_told_with_those_that_are_off_it():
    with pytest.raises(RobotError) as caught:
        load_arm("two_link", ["shoulder", "elbow"], "forearm")
    assert str(caught.value).endswith("choose a tip off the axis from tip")
    text = NO_TIP.replace("tip", "end")
    with pytest.raises(RobotError, match=r"does not move the tip 'end'.*or add a tip link"):
        arm_from_urdf(text, ["j1", "j2"], "end")


def test_the_same_is_told_where_no_joints_were_named():
    for tip in (None, "tip"):
        with pytest.raises(RobotError, match=r"^joint 'j2' does not move the tip 'tip'"):
            arm_from_urdf(NO_TIP, tip=tip)
