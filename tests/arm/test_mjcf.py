"""MuJoCo models: as MuJoCo itself moves them, through the whole of calib, and written back."""

from pathlib import Path

import numpy as np
import pytest
from reference import random_joints, table

import calib
from calib.arm.loading import arm_from_urdf
from calib.arm.rotations import matrix_of

DATA = Path(__file__).parents[1] / "data"
EVERY_FORM = (DATA / "every_form.xml").read_text()
UR5E = (DATA / "ur5e.xml").read_text()


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
        np.testing.assert_allclose(place, site.xpos, atol=1e-12)
        np.testing.assert_allclose(matrix_of(quaternion), site.xmat.reshape(3, 3), atol=1e-12)
    for name, limits in zip(arm.joint_names, arm.limits, strict=True):
        np.testing.assert_allclose(model.joint(name).range, limits, atol=1e-12)


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
        np.testing.assert_allclose(arm.forward(q), data.site_xpos[0], atol=1e-12)


@pytest.mark.parametrize(("mass", "total"), [("", 0), ('mass="0"', 4)])
def test_masses_count_where_every_moving_body_states_its_own(mass, total):
    """MuJoCo weighs a body without <inertial> by its geoms: the others' masses are half a load."""
    heavy = '<inertial pos="0 0 0.05" mass="2" diaginertia=".01 .01 .01"/>'
    stated = arm_from_urdf(EVERY_FORM).chain.masses
    assert stated.sum() == pytest.approx(6)
    assert EVERY_FORM.count(heavy) == 3
    last = f'<geom size=".1" {mass}/>'.join(EVERY_FORM.rsplit(heavy, 1))
    assert arm_from_urdf(last).chain.masses.sum() == pytest.approx(total, abs=0)
