"""URDF text that is accepted: what is read from it, and what is mended aloud."""

import numpy as np
import pinocchio as pin
import pytest
from reference import random_joints

from calib.arm.description import parse_robot
from calib.arm.loading import arm_from_urdf
from calib.arm.posture import posture_of
from calib.arm.robots import resolve_robot
from calib.arm.urdf import read_urdf

TWO = """<robot name="two">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="j1" type="revolute"><parent link="a"/><child link="b"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="b"/><child link="c"/>
    <origin xyz="0.3 0 0" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j3" type="fixed"><parent link="c"/><child link="d"/>
    <origin xyz="0.2 0 0"/></joint>
</robot>"""


def test_a_mimic_of_nothing_is_mended_aloud():
    urdf = parse_robot(TWO.replace('<origin xyz="0.2 0 0"/>', '<mimic joint="no"/>'))
    (note,) = urdf.notes
    assert "'no', which does not exist" in note
    assert set(posture_of(urdf, {}).frames) == {"a", "b", "c", "d"}


def test_a_missing_axis_is_x_as_in_pinocchio():
    text = TWO.replace('<axis xyz="0 0 1"/>', "")
    assert all(joint.axis == (1, 0, 0) for joint in parse_robot(text).joints)
    assert any("no <axis>" in note for note in parse_robot(text).notes)
    original = pin.buildModelFromXML(text)
    assert [joint.shortname() for joint in original.joints][1] == "JointModelRX"


def test_expanded_xacro_may_keep_its_namespace():
    text = TWO.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert parse_robot(text).joints == parse_robot(TWO).joints


def test_a_byte_order_mark_and_an_encoding_are_no_obstacle(tmp_path):
    path = tmp_path / "bom.urdf"
    path.write_bytes(b"\xef\xbb\xbf" + b'<?xml version="1.0" encoding="utf-8"?>' + TWO.encode())
    assert parse_robot(read_urdf(path)).name == "two"


@pytest.mark.parametrize("what", ["base", "upper_arm", "elbow", "tip"])
@pytest.mark.parametrize("name", ["universe", "root_joint"])
def test_names_that_mean_something_to_pinocchio_are_only_names(what, name):
    text = read_urdf(resolve_robot("two_link"))
    arm, renamed = arm_from_urdf(text), arm_from_urdf(text.replace(f'"{what}"', f'"{name}"'))
    q = random_joints(arm, 10)
    np.testing.assert_array_equal(renamed.forward(q), arm.forward(q))
