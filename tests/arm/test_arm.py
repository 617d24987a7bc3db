"""Planar arms: kinematics against closed forms, Pinocchio and finite differences."""

import numpy as np
import pytest
from chains import SLIDE, chain_urdf, turning
from hypothesis import given
from hypothesis import strategies as st
from models import two_link
from reference import pinocchio_forward, random_joints

from calib.arm.loading import arm_from_urdf, load_arm
from calib.arm.robots import list_robots

BUNDLED = [
    entry.name
    for entry in list_robots()
    if entry.name not in ("six_axis", "spatial_three", "so101")
]


ANGLE = st.floats(-np.pi, np.pi)


@given(ANGLE, ANGLE)
def test_two_links_follow_the_closed_form(q1, q2):
    expected = two_link(np.array([q1, q2]))
    np.testing.assert_allclose(load_arm("two_link").forward([q1, q2]), expected, atol=1e-15)


@pytest.mark.parametrize("name", BUNDLED)
def test_forward_agrees_with_pinocchio(name):
    arm = load_arm(name)
    q = random_joints(arm, 500)
    assert np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max() <= 1e-12


@pytest.mark.parametrize("name", BUNDLED)
def test_the_jacobian_agrees_with_finite_differences(name):
    arm = load_arm(name)
    q, step = random_joints(arm, 50), 1e-6
    numeric = np.stack(
        [
            (arm.forward(q + step * unit) - arm.forward(q - step * unit)) / (2 * step)
            for unit in np.eye(arm.dof)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(arm.jacobian(q), numeric, atol=1e-9)


def test_a_nearly_parallel_axis_is_computed_as_it_is():
    text = chain_urdf(turning(), turning(axis="0.00005 0 1"), tip="0.2 0 0.1")
    arm = arm_from_urdf(text)
    q = random_joints(arm, 200)
    assert np.abs(arm.forward(q) - pinocchio_forward(arm, q)).max() <= 1e-12


def test_a_longer_link_is_longer_and_nothing_else_changes():
    arm = load_arm("three_link")
    longer = arm.with_link_length("elbow", 0.30)
    assert longer.link_lengths == pytest.approx({"shoulder": 0.3, "elbow": 0.3, "wrist": 0.15})
    q = random_joints(arm, 50)
    angle = q[:, 0] + q[:, 1]
    shift = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(longer.forward(q) - arm.forward(q), shift, atol=1e-14)
    assert arm.link_lengths["elbow"] == pytest.approx(0.25)  # the old arm is left as it was


def test_a_slides_link_is_what_it_carries():
    arm = load_arm("polar").with_link_length("slide", 0.2)
    np.testing.assert_allclose(arm.forward([0, 0.1]), [0.15 + 0.1 + 0.2, 0], atol=1e-15)


BENT = chain_urdf(turning(), turning(), tip="0.12 0.16 0")  # the last link is 0.2 m, bent


SLIDING_TIP = chain_urdf(turning(), turning(axis="1 0 0") + SLIDE, tip="0 0 0")


@pytest.mark.parametrize("text", [BENT, *(load_arm(name).urdf for name in BUNDLED)])
def test_a_moved_tip_is_told_by_the_last_link_wherever_that_points(text):
    arm = arm_from_urdf(text)
    q = random_joints(arm, 20)
    motion = arm.chain.motion(q)
    link = arm.plane.project((motion.position - motion.places[-1]).T + arm.plane.origin)
    if not arm.revolute[-1]:  # its zero posture's link, which the slide's travel is not part of
        link = link / np.linalg.norm(link, axis=1, keepdims=True)
    along = link / np.linalg.norm(link, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    moved = arm.with_tip_offset(0.03, -0.02).forward(q) - arm.forward(q)
    np.testing.assert_allclose(moved, 0.03 * along - 0.02 * left, atol=1e-14)


def test_a_tip_on_its_slide_is_moved_along_the_planes_axes():
    arm = arm_from_urdf(SLIDING_TIP)
    moved = arm.with_tip_offset(0.03, -0.02).forward([0.0, 0.1]) - arm.forward([0.0, 0.1])
    np.testing.assert_allclose(moved, [0.03, -0.02], atol=1e-15)
