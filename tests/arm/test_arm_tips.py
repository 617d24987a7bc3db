"""Which tip of a robot is followed, and which like arms are named beside it."""

import pytest
from chains import branching

from calib.arm.finding import find_tip
from calib.arm.urdf import parse_urdf

USUAL = ("tool0", "tcp", "tool", "tip", "ee_link", "ee", "end_effector", "gripper_frame_link")


@pytest.mark.parametrize("name", [form for n in USUAL for form in (n, f"left_{n.upper()}")])
def test_every_usual_name_of_a_tip_is_followed(name):
    text = branching('<origin xyz="0.1 0 0"/>', "camera", kind="fixed").replace('"tip"', '"lamp"')
    for order in (("camera_link", name), ("lamp", name)):
        assert find_tip(parse_urdf(text.replace(*order)), "l0") == name
