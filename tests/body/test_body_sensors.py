"""Several sensors of one arm: one fit, one belief, frames and noises of their own."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.arm.arm import Arm
from calib.body.body_fit import fit, fit_sensors
from calib.body.layout import joined
from calib.body.planar import planar_structure
from calib.body.rows import Rows
from calib.body.spatial import structure_of
from calib.errors import OptionError

NOISE = 5e-5  # [m]
MARKER = np.array([0.03, -0.02, 0.01])  # [m], of the right sensor's marker beside the left one's


def joints(arm: Arm, n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(arm.lower, arm.upper, (n, len(arm.lower)))


def test_two_trackers_tell_more_of_one_arm_than_one():
    arm = calib.load_arm("spatial_three")
    structure = structure_of(arm, "rigid")
    rng = np.random.default_rng(1)
    truth = structure.neutral()
    truth[structure.shifts] = rng.normal(0.0, 5e-4, structure.shifts.shape)
    truth[structure.groups["tool"]] = rng.normal(0.0, 1e-2, 3)
    places = {"left": truth.copy(), "right": truth.copy()}
    places["right"][structure.groups["view.rotation"]] = (0.3, -1.0, 2.0)
    places["right"][structure.groups["view.shift"]] = (1.0, 0.2, -0.5)
    places["right"][structure.groups["tool"]] += MARKER
    logs: dict[str, Rows] = {}
    for name, beta in places.items():
        q = joints(arm, 25, rng)
        z = structure.predict(q, beta)
        logs[name] = Rows(q, z + rng.normal(0.0, NOISE, z.shape))
    alone = fit(structure, [logs["left"]]).body
    both = fit_sensors(dict.fromkeys(logs, structure), logs)
    fresh = joints(arm, 200, rng)
    for name, found in both.items():
        missed = np.linalg.norm(
            found.body.predict(fresh) - structure.predict(fresh, places[name]), axis=1
        )
        assert np.mean(missed <= found.body.bound(fresh, noise=False)) > 0.9
        assert len(found.held_out) == 25
        if name == "left":
            before = np.linalg.norm(alone.predict(fresh) - structure.predict(fresh, truth), axis=1)
            assert missed.mean() < 0.85 * before.mean()
    left, right = both["left"].body, both["right"].body
    assert np.shares_memory(left.beta, right.beta)
    assert np.shares_memory(left.root, right.root)
    marker = right.beta[right.structure.groups["marker"]]
    np.testing.assert_allclose(marker, MARKER, atol=3e-4)
    assert {"right.marker.x", "right.view.shift.x"} <= {p.name for p in left.parameters()}


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
