"""Spatial arms: what is chosen, and kinematics that agree with Pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from chains import FOLLOWED, MIXED, joint, robot
from hypothesis import given
from hypothesis import strategies as st
from reference import random_joints

from calib.arm.gravity import GRAVITY, Loads
from calib.arm.loading import PlanarArm, SpatialArm, arm_from_urdf, load_arm
from calib.arm.rotations import exponential, logarithm, matrix_of, quaternion_of
from calib.arm.spatial_chain import SpatialChain
from calib.errors import RobotError

SPATIAL = ("spatial_three", "six_axis")


def pinocchio_pose(arm, q):
    """Positions, orientations and Jacobians by Pinocchio, one row at a time."""
    model = pin.buildModelFromXML(arm.urdf)
    data, frame = model.createData(), model.getFrameId(arm.tip, pin.FrameType.BODY)
    places, turns, slopes = [], [], []
    for row in q:
        values = np.zeros(model.nv)
        for name, value in {**arm.locked, **dict(zip(arm.joint_names, row, strict=True))}.items():
            values[model.joints[model.getJointId(name)].idx_v] = value
        full = pin.integrate(model, pin.neutral(model), values)
        pin.framesForwardKinematics(model, data, full)
        pin.computeJointJacobians(model, data, full)
        whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        columns = [model.joints[model.getJointId(name)].idx_v for name in arm.joint_names]
        places.append(data.oMf[frame].translation.copy())
        turns.append(data.oMf[frame].rotation.copy())
        slopes.append(whole[:, columns])
    return np.array(places), np.array(turns), np.array(slopes)


@pytest.mark.parametrize("source", [*SPATIAL, "mixed"])
def test_pose_and_jacobian_agree_with_pinocchio(source):
    arm = arm_from_urdf(MIXED) if source == "mixed" else load_arm(source)
    assert isinstance(arm, SpatialArm)
    q = random_joints(arm, 50)
    places, turns, slopes = pinocchio_pose(arm, q)
    positions, quaternions = arm.pose(q)
    assert np.abs(arm.forward(q) - places).max() <= 1e-12
    assert np.abs(positions - places).max() <= 1e-12
    assert np.abs(matrix_of(quaternions) - turns).max() <= 1e-12
    assert np.abs(arm.jacobian(q) - slopes).max() <= 1e-12


def test_a_planar_arms_pose_is_its_frame_in_space():
    for name in ("two_link", "tilted", "polar"):
        arm = load_arm(name)
        assert isinstance(arm, PlanarArm)
        q = random_joints(arm, 20)
        places, turns, _ = pinocchio_pose(arm, q)
        positions, quaternions = arm.pose(q)
        assert np.abs(positions - places).max() <= 1e-12
        assert np.abs(matrix_of(quaternions) - turns).max() <= 1e-12
        assert np.abs(arm.plane.project(positions) - arm.forward(q)).max() <= 1e-12


def test_a_mimic_joint_follows_and_is_no_joint_of_its_own():
    arm = arm_from_urdf(FOLLOWED)
    assert arm.joint_names == ("turn", "lift")
    assert arm.locked == {}
    free = arm_from_urdf(FOLLOWED.replace("<mimic", "<!--").replace('offset="0.3"/>', "-->"))
    assert free.joint_names == ("turn", "lift", "copy")
    q = random_joints(arm, 20)
    own = np.column_stack([q, -0.5 * q[:, 1] + 0.3])
    np.testing.assert_allclose(arm.forward(q), free.forward(own), atol=1e-15)
    slopes = free.jacobian(own)
    expected = np.stack([slopes[..., 0], slopes[..., 1] - 0.5 * slopes[..., 2]], axis=-1)
    np.testing.assert_allclose(arm.jacobian(q), expected, atol=1e-15)


def test_a_chosen_spatial_arm_names_the_planar_one_that_it_holds():
    arm = load_arm("six_axis")
    assert any("planar=True" in note for note in arm.notes)
    flat = load_arm("six_axis", planar=True)
    assert isinstance(flat, PlanarArm)
    assert flat.joint_names == ("shoulder_lift", "elbow", "wrist_1")
    named = load_arm("six_axis", ["elbow", "shoulder_lift"], "wrist_1")
    assert isinstance(named, PlanarArm)
    assert named.joint_names == ("shoulder_lift", "elbow")


def test_columns_of_a_log_choose_the_joints():
    arm = load_arm("six_axis", columns=["shoulder_pan", "shoulder_lift", "elbow", "x", "y", "z"])
    assert arm.joint_names == ("shoulder_pan", "shoulder_lift", "elbow")
    assert sorted(arm.locked) == ["wrist_1", "wrist_2", "wrist_3"]
    assert any("the log has no columns for them" in note for note in arm.notes)
    with pytest.raises(RobotError, match="columns"):
        load_arm("six_axis", columns=["elbow", "x", "y", "z"])


def two_arms(length):
    return robot(
        joint("l1", "base", "la", "0 0.1 0", "0 0 1"),
        joint("l2", "la", "lb", "0.3 0 0", "0 1 0"),
        joint("l3", "lb", "left", "0.3 0 0", "1 0 0", "fixed"),
        joint("r1", "base", "ra", "0 -0.1 0", "0 0 1"),
        joint("r2", "ra", "rb", "0.3 0 0", "0 1 0"),
        joint("r3", "rb", "right", f"{length} 0 0", "1 0 0", "fixed"),
    )


def test_equal_arms_are_told_and_a_log_must_choose():
    arm = arm_from_urdf(two_arms(0.3))
    assert arm.joint_names == ("l1", "l2")
    assert any("(others: `joints=['r1', 'r2']` `tip='right'`)" in note for note in arm.notes)
    with pytest.raises(RobotError) as caught:
        arm_from_urdf(two_arms(0.3), columns=["l1", "l2", "r1", "r2"])
    both = "`joints=['l1', 'l2']` `tip='left'`; `joints=['r1', 'r2']` `tip='right'`"
    assert both in str(caught.value)
    assert arm_from_urdf(two_arms(0.3), columns=["r1", "r2"]).joint_names == ("r1", "r2")
    further = arm_from_urdf(two_arms(0.4))
    assert further.joint_names == ("r1", "r2")
    assert not any("l1" in note for note in further.notes)


def test_an_arm_ends_before_its_fingers():
    hand = robot(
        joint("one", "base", "a", "0 0 0.1", "0 0 1"),
        joint("two", "a", "b", "0.3 0 0", "0 1 0"),
        joint("three", "b", "palm", "0.3 0 0", "1 0 0"),
        joint("f1", "palm", "thumb", "0.05 0.02 0", "0 1 0"),
        joint("f2", "palm", "index", "0.05 -0.02 0", "0 1 0"),
        joint("f3", "index", "nail", "0.05 0 0", "0 1 0", "fixed"),
    )
    arm = arm_from_urdf(hand)
    assert (arm.joint_names, arm.tip) == (("one", "two", "three"), "palm")


def test_torques_are_pinocchios():
    arm = load_arm("six_axis")
    model = pin.buildModelFromXML(arm.urdf)
    data, q = model.createData(), random_joints(arm, 10)
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    expected = [-pin.computeGeneralizedGravity(model, data, row) for row in q]
    levers = Loads.of_masses(arm.chain).levers(q)
    torques = np.einsum("exn,x->ne", levers, GRAVITY)
    np.testing.assert_allclose(torques, expected, atol=1e-11)


def test_a_changed_link_and_tip_are_those_lengths():
    arm = load_arm("six_axis")
    longer = arm.with_link_length("elbow", 0.5)
    assert longer.link_lengths["elbow"] == pytest.approx(0.5)
    others = {name: value for name, value in longer.link_lengths.items() if name != "elbow"}
    assert others == pytest.approx({k: v for k, v in arm.link_lengths.items() if k != "elbow"})
    q = random_joints(arm, 5)
    moved = arm.with_tip_offset(0.01, 0.02, -0.03)
    positions, quaternions = arm.pose(q)
    expected = positions + matrix_of(quaternions) @ np.array([0.01, 0.02, -0.03])
    np.testing.assert_allclose(moved.forward(q), expected, atol=1e-14)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_rotations_go_round(vector):
    v = np.array(vector)
    length = np.linalg.norm(v)
    matrix = exponential(v)
    assert np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-12
    back = logarithm(matrix)
    if length < np.pi - 1e-6:
        np.testing.assert_allclose(back, v, atol=1e-9)
    np.testing.assert_allclose(exponential(back), matrix, atol=1e-9)
    np.testing.assert_allclose(matrix_of(quaternion_of(matrix)), matrix, atol=1e-12)


def test_any_masses_are_a_sum_of_unit_weights():
    """A mass on a link at the joints' own origins and ends."""
    arm = load_arm("six_axis")
    q = random_joints(arm, 20)
    ends = np.vstack([arm.chain.points[1:], arm.chain.tip])
    chain = replace(arm.chain, centres=ends)
    units = Loads.of_unit_weights(chain)
    torques = np.zeros((6, 3, 20))
    np.add.at(
        torques,
        units.joints,
        units.levers(q) * chain.masses[units.links[units.weights.argmax(1)], None, None],
    )
    np.testing.assert_allclose(torques, Loads.of_masses(chain).levers(q), atol=1e-12)


@pytest.mark.parametrize("loads_of", [Loads.of_masses, Loads.of_unit_weights])
def test_loads_change_as_their_differences_do(loads_of):
    """Of turning, sliding and following joints."""
    rng, step = np.random.default_rng(0), 1e-6
    axes = rng.normal(size=(4, 3))
    chain = SpatialChain(
        axes / np.linalg.norm(axes, axis=1, keepdims=True), rng.normal(size=(4, 3)),
        rng.normal(size=3), np.eye(3), (True, False, True, True),
        coupling=np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -0.5]]), bias=np.zeros(4),
        masses=rng.uniform(1, 3, 4), centres=rng.normal(size=(4, 3)),
    )  # fmt: skip
    q = rng.normal(size=(3, 3))
    loads = loads_of(chain)
    gravity = np.array([1.0, -2.0, -9.0])
    ahead, behind = (
        np.stack([gravity @ loads.levers(q + way * one) for one in np.eye(3)], axis=1)
        for way in (step, -step)
    )
    np.testing.assert_allclose(loads.slopes(q, gravity), (ahead - behind) / 2 / step, atol=1e-6)
