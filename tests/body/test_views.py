"""Kinds of sensors: their lenses bend by their own law, and slopes are differences."""

import numpy as np
import pytest

from calib import load_arm
from calib.body.planar import planar_structure
from calib.body.spatial import structure_of
from calib.errors import OptionError
from calib.inverse.pixel import undistorted

Z = np.random.default_rng(0).uniform(200, 800, (20, 2))


def in_plane():
    structure = planar_structure(Z, ("a", "b"), (True, True), None, "homography", "px", False)
    beta = structure.neutral()
    for group, value in {
        "view.scale": 6.0, "view.shift": (500, 400), "view.tilt": (0.1, -0.2),
        "lens": (0.2, 0.1, -0.1), "offset": (0, 0.7), "view.shear": (0.02, -0.01),
    }.items():  # fmt: skip
        beta[structure.groups[group]] = value
    return structure, beta


def in_space():
    structure = structure_of(load_arm("six_axis"), "pinhole", unit="px", lens=(900, 320, 240, 0.2))
    beta = structure.neutral()
    beta[structure.groups["view.shift"]] = 0.1, 0.2, 2.5
    return structure, beta


@pytest.mark.parametrize("kind", [in_plane, in_space])
def test_slopes_are_differences(kind):
    structure, beta = kind()
    q = np.random.default_rng(1).uniform(-1, 1, (5, structure.dof))
    z, by_beta = structure.linearise(q, beta)
    np.testing.assert_allclose(z, structure.predict(q, beta), rtol=1e-12)
    h = 1e-6
    for group in ("view.rotation", "view.shift", "view.tilt", "view.shear", "lens", "offset"):
        for k in structure.groups.get(group, ()):
            step = np.zeros(structure.size)
            step[k] = h
            rise = structure.predict(q, structure.retract(beta, step))
            rise = rise - structure.predict(q, structure.retract(beta, -step))
            np.testing.assert_allclose(by_beta[:, :, k], rise / (2 * h), rtol=1e-4, atol=1e-3)


def test_a_pixel_is_undistorted_by_the_lens_that_bent_it():
    ideal = np.random.default_rng(0).uniform(-0.4, 0.4, (9, 2))
    bent = ideal * (1 + 0.1 * (ideal**2).sum(axis=1, keepdims=True))
    lens = np.array([900.0, 320.0, 240.0, 0.1])
    np.testing.assert_allclose(undistorted(900.0 * bent + (320, 240), lens), ideal, atol=1e-12)


def test_an_unknown_kind_is_refused():
    with pytest.raises(OptionError, match="'fisheye', expected one of auto, base"):
        planar_structure(Z, ("a", "b"), (True, True), None, "fisheye", "px", False)
