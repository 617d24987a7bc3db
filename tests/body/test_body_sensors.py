"""Several sensors of one arm: one fit, one belief, frames and noises of their own."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import OptionError
from calib.arm.arm import Arm
from calib.body.body_fit import fit_sensors
from calib.body.layout import joined
from calib.body.planar import planar_structure
from calib.body.rows import Rows
from calib.body.spatial import structure_of

NOISE = 5e-5  # [m]


def joints(arm: Arm, n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(arm.lower, arm.upper, (n, len(arm.lower)))


def test_two_sensors_see_a_planar_arm_from_both_sides():
    arm = calib.load_arm("two_link")
    rng = np.random.default_rng(0)
    logs: dict[str, Rows] = {}
    structures = {}
    for name, mirror in (("front", 1.0), ("back", -1.0)):
        q = joints(arm, 40, rng)
        z = arm.forward(q) * (1.0, mirror) + (0.1, mirror)
        z = z + rng.normal(0.0, NOISE, z.shape)
        logs[name] = Rows(q, z)
        structures[name] = planar_structure(z, arm.joint_names, arm.revolute)
    both = fit_sensors(structures, logs)
    fresh = joints(arm, 100, rng)
    sides = {name: found.body.structure.viewpoint.mirror for name, found in both.items()}
    assert sides == {"front": 1, "back": -1}
    for name, mirror in (("front", 1.0), ("back", -1.0)):
        expected = arm.forward(fresh) * (1.0, mirror) + (0.1, mirror)
        missed = np.linalg.norm(both[name].body.predict(fresh) - expected, axis=1)
        assert missed.max() < 1e-4


def test_sensors_of_different_arms_are_refused():
    space = structure_of(calib.load_arm("spatial_three"), "rigid")
    z = np.random.default_rng(0).normal(size=(20, 2))
    plane = planar_structure(z, ("a", "b"), (True, True))
    with pytest.raises(OptionError, match="planar arm"):
        joined({"left": space, "right": replace(plane)})
