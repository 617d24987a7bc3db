"""The bundled robots: what issue and tables promise about them."""

import numpy as np
import pytest

import calib

TWO = "shoulder elbow"
SIX = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3"
PROMISED = {  # joints, limits [deg, m] where they are promised, lengths of the links [m]
    "two_link": (TWO, [(0, 90), (15, 150)], [0.30, 0.25]),
    "two_link_full": (TWO, [(0, 90), (-150, 150)], [0.30, 0.25]),
    "three_link": ("shoulder elbow wrist", [(0, 90), (15, 150), (-90, 90)], [0.30, 0.25, 0.15]),
    "scara": (TWO, [(-120, 120), (-140, 140)], [0.35, 0.35]),
    "tilted": (TWO, [(0, 90), (15, 150)], [0.30, 0.25]),
    "polar": ("shoulder slide", None, None),
    "spatial_three": ("shoulder_pan shoulder_lift elbow", None, [0.08, 0.301496, 0.25]),
    "six_axis": (SIX, None, [0.12, 0.420476, 0.38, 0.1, 0.09, 0.08]),
    "so101": (
        "shoulder_pan shoulder_lift elbow_flex wrist_flex wrist_roll",
        None,
        [0.064775, 0.116, 0.135, 0.063725, 0.098445],
    ),
}


def test_the_catalogue_holds_what_was_promised():
    assert {entry.name for entry in calib.list_robots()} == set(PROMISED)


@pytest.mark.parametrize("entry", calib.list_robots(), ids=lambda entry: entry.name)
def test_every_entry_is_what_its_file_says(entry):
    joints, degrees, lengths = PROMISED[entry.name]
    arm = calib.load_arm(entry.name)
    assert arm.joint_names == entry.joints == tuple(joints.split())
    assert (arm.name, arm.dof, arm.locked) == (entry.name, entry.dof, {})
    assert all(arm.revolute) == (entry.name != "polar")
    assert [note for note in arm.notes if "planar=True" not in note] == []
    assert entry.description
    assert "<visual>" in arm.urdf
    assert calib.load_arm(entry.path).joint_names == entry.joints
    if degrees:
        np.testing.assert_array_equal(np.stack([arm.lower, arm.upper], 1), np.deg2rad(degrees))
    if lengths:
        np.testing.assert_allclose(list(arm.link_lengths.values()), lengths, atol=1e-6)
    if entry.name == "six_axis":
        assert (arm.chain.masses > 0).all()
