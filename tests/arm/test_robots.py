"""The bundled robots: what issue and tables promise about them."""

import numpy as np
import pytest

from calib.arm.loading import load_arm
from calib.arm.robots import list_robots, resolve_robot

PROMISED = {
    "two_link": (("shoulder", "elbow"), [(0, 90), (15, 150)], [0.30, 0.25]),
    "two_link_full": (("shoulder", "elbow"), [(0, 90), (-150, 150)], [0.30, 0.25]),
    "three_link": (
        ("shoulder", "elbow", "wrist"),
        [(0, 90), (15, 150), (-90, 90)],
        [0.30, 0.25, 0.15],
    ),
    "scara": (("shoulder", "elbow"), [(-120, 120), (-140, 140)], [0.35, 0.35]),
    "tilted": (("shoulder", "elbow"), [(0, 90), (15, 150)], [0.30, 0.25]),
}
SPATIAL = {
    "spatial_three": (("shoulder_pan", "shoulder_lift", "elbow"), [0.08, 0.301496, 0.25]),
    "six_axis": (
        ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
        [0.12, 0.420476, 0.38, 0.1, 0.09, 0.08],
    ),
    "so101": (
        ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
        [0.064775, 0.116, 0.135, 0.063725, 0.098445],
    ),
}


def test_the_catalogue_holds_what_was_promised():
    assert {entry.name for entry in list_robots()} == {*PROMISED, "polar", *SPATIAL}


@pytest.mark.parametrize("entry", list_robots(), ids=lambda entry: entry.name)
def test_every_entry_is_what_its_file_says(entry):
    arm = load_arm(entry.name)
    assert arm.name == entry.name
    assert arm.joint_names == entry.joints
    assert arm.dof == entry.dof
    assert entry.description
    assumed = [
        note for note in arm.notes if not note.startswith("the arm moves in space; `planar=True`")
    ]
    assert not assumed
    assert arm.locked == {}
    assert "<visual>" in arm.urdf


@pytest.mark.parametrize("name", PROMISED)
def test_joints_ranges_and_lengths(name):
    joints, degrees, lengths = PROMISED[name]
    arm = load_arm(name)
    assert arm.joint_names == joints
    assert all(arm.revolute)
    np.testing.assert_array_equal(arm.lower, np.deg2rad([low for low, _ in degrees]))
    np.testing.assert_array_equal(arm.upper, np.deg2rad([high for _, high in degrees]))
    np.testing.assert_allclose(list(arm.link_lengths.values()), lengths, atol=1e-15)


@pytest.mark.parametrize("name", SPATIAL)
def test_spatial_arms_have_their_joints_lengths_and_masses(name):
    joints, lengths = SPATIAL[name]
    arm = load_arm(name)
    assert arm.joint_names == joints
    assert arm.outputs == 3
    np.testing.assert_allclose(list(arm.link_lengths.values()), lengths, atol=1e-6)
    if name != "so101":  # whose file states none
        assert (arm.chain.masses > 0).all()


def test_polar_turns_and_slides():
    arm = load_arm("polar")
    assert arm.joint_names == ("shoulder", "slide")
    assert arm.revolute == (True, False)
    angle, out = 0.7, 0.2
    expected = 0.45 * np.array([np.cos(angle), np.sin(angle)])  # 0.15 + 0.20 + 0.10 m
    np.testing.assert_allclose(arm.forward([angle, out]), expected, atol=1e-15)


def test_a_name_or_a_path_is_resolved(tmp_path):
    entry = list_robots()[0]
    assert resolve_robot(entry.name) == entry.path
    copy = tmp_path / "mine.urdf"
    copy.write_text(entry.path.read_text())
    assert resolve_robot(str(copy)) == copy
    assert load_arm(copy).joint_names == entry.joints
