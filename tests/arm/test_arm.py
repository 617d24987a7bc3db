"""Arms: kinematics against closed forms, Pinocchio, differences and MuJoCo; the bundled ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from chains import FOLLOWED, MIXED, chain_urdf, turning
from numpy.testing import assert_allclose, assert_array_equal
from reference import pinocchio_pose, random_joints, table

import calib
from calib.arm.gravity import GRAVITY, Loads
from calib.arm.loading import arm_from_urdf
from calib.arm.rotations import exponential, logarithm, matrix_of, quaternion_of, similarity

BUNDLED = [entry.name for entry in calib.list_robots()]
ASKEW = chain_urdf(turning(), turning(axis="0.00005 0 1"), tip="0.2 0 0.1")
TWO = "shoulder elbow"
SIX = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3"
SO101 = "shoulder_pan shoulder_lift elbow_flex wrist_flex wrist_roll"
PROMISED = {  # joints, limits [deg, m] where they are promised, lengths of the links [m]
    "two_link": (TWO, [(0, 90), (15, 150)], [0.30, 0.25]),
    "two_link_full": (TWO, [(0, 90), (-150, 150)], [0.30, 0.25]),
    "three_link": ("shoulder elbow wrist", [(0, 90), (15, 150), (-90, 90)], [0.30, 0.25, 0.15]),
    "scara": (TWO, [(-120, 120), (-140, 140)], [0.35, 0.35]),
    "tilted": (TWO, [(0, 90), (15, 150)], [0.30, 0.25]),
    "polar": ("shoulder slide", None, None),
    "spatial_three": ("shoulder_pan shoulder_lift elbow", None, [0.08, 0.301496, 0.25]),
    "six_axis": (SIX, None, [0.12, 0.420476, 0.38, 0.1, 0.09, 0.08]),
    "so101": (SO101, None, [0.064775, 0.116, 0.135, 0.063725, 0.098445]),
}
DATA = Path(__file__).parents[1] / "data"
EVERY_FORM = (DATA / "every_form.xml").read_text()
UR5E = (DATA / "ur5e.xml").read_text()


@pytest.mark.parametrize("source", [*BUNDLED, MIXED, ASKEW])
def test_pose_and_jacobian_agree_with_pinocchio(source):
    arm = (arm_from_urdf if "<" in source else calib.load_arm)(source)
    q = random_joints(arm, 50)
    places, turns, slopes = pinocchio_pose(arm, q)
    positions, quaternions = arm.pose(q)
    assert np.abs(positions - places).max() <= 1e-12
    assert np.abs(matrix_of(quaternions) - turns).max() <= 1e-12
    bound = 1e-12
    if arm.outputs == 2:
        places, slopes = arm.plane.project(places), arm.plane.basis[:2] @ slopes[:, :3]
        bound = 1e-9
    assert np.abs(arm.forward(q) - places).max() <= 1e-12
    assert np.abs(arm.jacobian(q) - slopes).max() <= bound


def test_a_moved_tip_in_space_is_told_in_the_tips_frame():
    arm = calib.load_arm("six_axis")
    q = random_joints(arm, 5)
    positions, quaternions = arm.pose(q)
    expected = positions + matrix_of(quaternions) @ np.array([0.01, 0.02, -0.03])
    assert_allclose(arm.with_tip_offset(0.01, 0.02, -0.03).forward(q), expected, atol=1e-14)


def test_a_mimic_joint_follows_and_is_no_joint_of_its_own():
    arm = arm_from_urdf(FOLLOWED)
    assert arm.joint_names == ("turn", "lift")
    assert arm.locked == {}
    free = arm_from_urdf(FOLLOWED.replace("<mimic", "<!--").replace('offset="0.3"/>', "-->"))
    q = random_joints(arm, 20)
    own = np.column_stack([q, -0.5 * q[:, 1] + 0.3])
    assert_allclose(arm.forward(q), free.forward(own), atol=1e-15)
    slopes = free.jacobian(own)
    expected = np.stack([slopes[..., 0], slopes[..., 1] - 0.5 * slopes[..., 2]], axis=-1)
    assert_allclose(arm.jacobian(q), expected, atol=1e-15)


def test_rotations_go_round():
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(200, 3))
    vectors *= (rng.uniform(0, 3.1, 200) / np.linalg.norm(vectors, axis=1))[:, None]
    for v in (*vectors, np.zeros(3), 1e-9 * vectors[0]):
        matrix = exponential(v)
        assert np.abs(matrix - pin.exp3(v)).max() < 1e-12
        assert_allclose(logarithm(matrix), v, atol=1e-9)
        assert_allclose(matrix_of(quaternion_of(matrix)), matrix, atol=1e-12)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_similarity_is_a_rotation_unless_it_may_mirror(mirrored):
    a = np.random.default_rng(0).normal(size=(20, 3))
    turn, shift, scale = similarity(a, 2.0 * a * (1, 1, -1) + 0.3, mirrored=mirrored)
    assert np.linalg.det(turn) == pytest.approx(-1.0 if mirrored else 1.0)
    if mirrored:
        assert scale == pytest.approx(2.0)
        assert_allclose(shift, 0.3, atol=1e-12)


def test_torques_are_pinocchios_and_any_masses_are_a_sum_of_unit_weights():
    arm = calib.load_arm("six_axis")
    model = pin.buildModelFromXML(arm.urdf)
    data, q = model.createData(), random_joints(arm, 10)
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    expected = [-pin.computeGeneralizedGravity(model, data, row) for row in q]
    torques = np.einsum("exn,x->ne", Loads.of_masses(arm.chain).levers(q), GRAVITY)
    assert_allclose(torques, expected, atol=1e-11)
    # a mass on a link at the joints' own origins and ends
    chain = replace(arm.chain, centres=np.vstack([arm.chain.points[1:], arm.chain.tip]))
    units = Loads.of_unit_weights(chain)
    share = chain.masses[units.links[units.weights.argmax(1)], None, None]
    levers = np.zeros((6, 3, 10))
    np.add.at(levers, units.joints, units.levers(q) * share)
    assert_allclose(levers, Loads.of_masses(chain).levers(q), atol=1e-12)


@pytest.mark.parametrize("name", sorted({*PROMISED, *BUNDLED}))
def test_every_entry_of_the_catalogue_is_what_was_promised(name):
    joints, degrees, lengths = PROMISED[name]
    (entry,) = (entry for entry in calib.list_robots() if entry.name == name)
    arm = calib.load_arm(name)
    assert arm.joint_names == entry.joints == tuple(joints.split())
    assert (arm.name, arm.dof, arm.locked) == (entry.name, entry.dof, {})
    assert all(arm.revolute) == (entry.name != "polar")
    assert [note for note in arm.notes if "planar=True" not in note] == []
    assert entry.description
    assert "<visual>" in arm.urdf
    assert calib.load_arm(entry.path).joint_names == entry.joints
    if degrees:
        assert_array_equal(np.stack([arm.lower, arm.upper], 1), np.deg2rad(degrees))
    if lengths:
        assert_allclose(list(arm.link_lengths.values()), lengths, atol=1e-6)
    if entry.name == "six_axis":
        assert (arm.chain.masses > 0).all()


@pytest.mark.parametrize("text", [EVERY_FORM, UR5E], ids=["every form", "ur5e"])
def test_arms_move_as_mujoco_moves_them(text):
    mujoco = pytest.importorskip("mujoco")
    arm = arm_from_urdf(text)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    q = random_joints(arm, 20)
    for row, place, quaternion in zip(q, *arm.pose(q), strict=True):
        for name, value in zip(arm.joint_names, row, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        site = data.site(arm.tip)
        assert_allclose(place, site.xpos, atol=1e-12)
        assert_allclose(matrix_of(quaternion), site.xmat.reshape(3, 3), atol=1e-12)
    for name, limits in zip(arm.joint_names, arm.limits, strict=True):
        assert_allclose(model.joint(name).range, limits, atol=1e-12)


def test_a_model_is_trained_from_an_mjcf_and_written_back(run, tmp_path):
    """Its joints' offsets are put into the bodies' places."""
    file = tmp_path / "arm.xml"
    file.write_text(UR5E)
    arm = calib.load_arm(file)
    offsets = np.radians([0.0, 0.5, -0.4, 0.3, 0.2, 0.0])
    q = random_joints(arm, 120)
    x = arm.forward(q + offsets)
    log = table(tmp_path / "log.csv", [*arm.joint_names, *"xyz"], np.hstack([q, x]))
    model, out = tmp_path / "m.calib", tmp_path / "corrected.xml"
    run.done("train", file, "--data", log, "--view", "base", "--size", "3", "-o", model)
    run.done("urdf", model, "-o", out)
    assert out.read_text().count("<body") == UR5E.count("<body")
    robots = (calib.load_arm(out), arm)
    after, before = (np.linalg.norm(each.forward(q) - x, axis=1).mean() for each in robots)
    assert after < 0.02 * before


def test_a_joint_that_follows_another_follows_it_in_the_mjcf_that_is_written(run, tmp_path):
    file, model, out = (tmp_path / name for name in ("arm.urdf", "m.calib", "arm.xml"))
    file.write_text(FOLLOWED)
    run.done("train", file, "-n", "60", "--size", "3", "-o", model)
    run.done("export", model, "--mjcf", out)
    arm, again = calib.load_arm(file), calib.load_arm(out)
    q = random_joints(arm, 20)
    assert again.joint_names == arm.joint_names
    assert_allclose(again.forward(q), arm.forward(q), atol=1e-6)


def test_a_joint_that_an_equality_ties_to_another_follows_it():
    """MuJoCo's own constraint is at rest there: a_0, a_1 and both joints' ref are in it."""
    mujoco = pytest.importorskip("mujoco")
    tied = EVERY_FORM.replace(
        "</mujoco>",
        '<equality><joint joint1="c" joint2="b" polycoef="0.1 -0.5"/>'
        '<joint joint1="e" joint2="a" active="false"/></equality></mujoco>',
    )
    arm = arm_from_urdf(tied, tip="tool")
    assert arm.joint_names == ("a", "b", "d", "e")
    model = mujoco.MjModel.from_xml_string(tied)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(-0.1, 0.1, (20, 4)):
        data.qpos[[0, 1, 3, 4]] = q
        data.qpos[2] = model.qpos0[2] + 0.1 - 0.5 * (q[1] - model.qpos0[1])
        mujoco.mj_forward(model, data)
        assert abs(data.efc_pos[0]) < 1e-12
        assert_allclose(arm.forward(q), data.site_xpos[0], atol=1e-12)


@pytest.mark.parametrize(("mass", "total"), [("", 0), ('mass="0"', 4)])
def test_masses_count_where_every_moving_body_states_its_own(mass, total):
    """MuJoCo weighs a body without <inertial> by its geoms: the others' masses are half a load."""
    heavy = '<inertial pos="0 0 0.05" mass="2" diaginertia=".01 .01 .01"/>'
    assert arm_from_urdf(EVERY_FORM).chain.masses.sum() == pytest.approx(6)
    assert EVERY_FORM.count(heavy) == 3
    last = f'<geom size=".1" {mass}/>'.join(EVERY_FORM.rsplit(heavy, 1))
    assert arm_from_urdf(last).chain.masses.sum() == pytest.approx(total, abs=0)
