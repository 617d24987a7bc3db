"""The URDF that is written of a spatial arm is the fitted geometry, and nothing else changes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from chains import FOLLOWED, MIXED
from models import in_pixels, in_space
from scipy.spatial.transform import Rotation
from test_arm import pinocchio_pose

import calib
from calib import load_arm
from calib.arm.loading import arm_from_urdf
from calib.body.spatial import structure_of
from calib.use.geometry import Geometry
from calib.use.geometry_fit import fit_geometry
from calib.use.urdf import corrected_urdf

LOCKED = MIXED.replace('name="lift"', 'name="held"')


def moved_somehow(arm):
    """A geometry with every parameter of the chain off; the probe is at the tip."""
    structure, rng = structure_of(arm, "base"), np.random.default_rng(1)
    beta = structure.neutral()
    for group in ("placement", "offset"):
        beta[structure.groups[group]] = rng.normal(0, 0.05, len(structure.groups[group]))
    zero = np.zeros((structure.size, structure.size))
    return Geometry(arm, structure, beta, zero, False, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("source", ["six_axis", "spatial_three", "mixed", "followed", "locked"])
def test_pinocchio_reads_the_fitted_geometry(source):
    texts = {"mixed": MIXED, "followed": FOLLOWED, "locked": LOCKED}
    lock = {"held": 0.4} if source == "locked" else {}
    arm = arm_from_urdf(texts[source], lock=lock) if source in texts else load_arm(source)
    geometry = moved_somehow(arm)
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20, arm.dof))
    points, turns = geometry.structure.pose(q, geometry.beta)
    again = arm_from_urdf(corrected_urdf(geometry), arm.joint_names, arm.tip, lock=arm.locked)
    if source == "followed":  # Pinocchio alone does not know what follows what
        places, matrices = again.chain.poses(q)
    else:
        places, matrices, _ = pinocchio_pose(again, q)
    np.testing.assert_allclose(places, points, atol=1e-9)
    np.testing.assert_allclose(matrices, turns, atol=1e-9)


def test_the_tip_stays():
    arm = load_arm("spatial_three")
    text = corrected_urdf(moved_somehow(arm))
    last = arm.urdf.index('<joint name="tip')
    line = arm.urdf[last:].split("<origin", 1)[1].split("/>", 1)[0]
    assert line in text


def test_a_fit_beats_the_drawing_and_holds_the_first_joint(tmp_path, run):
    model = in_space()
    geometry = fit_geometry(model)
    assert geometry.free
    assert geometry.residual < 0.5 * geometry.before
    structure = geometry.structure
    assert not geometry.beta[structure.shifts[0]].any()
    assert geometry.origins[1][0].interval.all()
    model.save(tmp_path / "m.calib")
    done = run("urdf", tmp_path / "m.calib", "-o", tmp_path / "c.urdf", "--json")
    assert done.code == 0
    assert done.document["places"]["shoulder_pan"]["shift"]["interval"][0] == 0.0
    assert done.document["residual"] == pytest.approx(geometry.residual)
    told = run("urdf", tmp_path / "m.calib", "-o", tmp_path / "c.urdf")
    assert "sensed point, not written" in told.out
    before, after = model.about.urdf.splitlines(), (tmp_path / "c.urdf").read_text().splitlines()
    changed = [a for a, b in zip(before, after, strict=True) if a != b]
    assert changed
    assert all("<origin" in line for line in changed)


def test_what_is_not_this_arm_is_refused(tmp_path, run):
    model = in_space()
    far = replace(model, rows=replace(model.rows, x=model.rows.x[::-1] * [1, 1, -1]))
    far.save(tmp_path / "m.calib")
    done = run("urdf", tmp_path / "m.calib", "-o", tmp_path / "c.urdf")
    assert done.code == 3
    assert not (tmp_path / "c.urdf").exists()


def test_pixels_tell_offsets():
    geometry = fit_geometry(in_pixels())
    assert geometry.unit == "px"
    assert geometry.residual < 0.6 < 2.0 < geometry.before
    offsets = [float(offset.value) for offset in geometry.offsets().values()]
    assert offsets[1:] == pytest.approx([0.03, -0.02], abs=3e-3)


def test_poses_turn_the_wrist_too():
    """Of a log of poses the URDF was fitted to positions alone: the tool was .1 deg off."""
    arm = calib.load_arm("six_axis")
    rng = np.random.default_rng(0)
    q = rng.uniform(0.6 * arm.lower, 0.6 * arm.upper, (200, 6))
    offsets = np.array([0.0, 0.0, -0.003, 0.0, 0.004, 0.0])
    position, quaternion = arm.pose(q + offsets)
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    mount = Rotation.from_rotvec([0.02, 0.1, -0.05])
    noise = Rotation.from_rotvec(rng.normal(0.0, 2e-4, (200, 3)))
    seen = turn.apply(position) + rng.normal(0.0, 5e-5, position.shape)
    turned = (turn * Rotation.from_quat(quaternion) * mount * noise).as_quat()
    known = arm.joint_names, arm.lower, arm.upper
    log = calib.Samples(q[:80], seen[:80], *known, arm=arm, orientation=turned[:80])
    corrected = arm_from_urdf(corrected_urdf(fit_geometry(calib.train(log, size=3))))
    truth = Rotation.from_quat(quaternion)
    fitted = Rotation.from_quat(corrected.pose(q)[1])
    # what stands before the base and behind the tip is the sensor's
    base = (fitted * truth.inv()).mean()
    tip = (truth.inv() * base.inv() * fitted).mean()
    left = (base * truth * tip).inv() * fitted
    assert np.degrees(left.magnitude().mean()) < 0.03


def test_a_zero_is_one_number_with_an_interval_that_holds(tmp_path, run):
    """`info`, `urdf` and `export` told three: -.2 +- 1.1, -2.63 +- 1.22, and -3.0 was true."""
    arm = load_arm("six_axis")
    log = calib.babble(arm, 100, noise=1e-4, changes=["elbow.offset=-0.05"], seed=1)
    log = calib.Samples(log.q, log.x, log.joint_names, log.lower, log.upper, arm=arm)
    calib.train(log, size=4).save(tmp_path / "m.calib")
    motors = {"homing_offset": 0, "range_min": 800, "range_max": 3200}
    (tmp_path / "old.json").write_text(json.dumps(dict.fromkeys(arm.joint_names, motors)))
    zero = run("urdf", tmp_path / "m.calib", "-o", tmp_path / "c.urdf", "--json")
    zero = zero.document["offsets"]["elbow"]
    assert abs(zero["value"] + 0.05) < zero["interval"] < 0.02
    words = ("export", tmp_path / "m.calib", "--lerobot", tmp_path / "old.json", "--json")
    written = run(*words, "-o", tmp_path / "new.json").document
    assert written["offsets"]["elbow"] == pytest.approx(zero["value"])
    assert written["intervals"]["elbow"] == pytest.approx(zero["interval"])
    told = run("info", tmp_path / "m.calib", "--json").document["body"]["parameters"]
    (entry,) = (part for part in told if part["name"] == "elbow.offset")
    assert entry["value"] == pytest.approx(zero["value"])
    assert entry["high"] - entry["value"] == pytest.approx(zero["interval"])
