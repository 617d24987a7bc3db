"""Kinds of sensors: their lenses bend by their own law, and slopes are differences."""

from __future__ import annotations

import numpy as np
import pytest

from calib import load_arm
from calib.body.fitting import planar_structure
from calib.body.spatial import structure_of
from calib.errors import OptionError
from calib.inverse.pixel import undistorted
<<<<<<< HEAD
=======
from calib.model_file.contents import FORMAT
>>>>>>> main

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


<<<<<<< HEAD
def in_space():
    structure = structure_of(load_arm("six_axis"), "pinhole", unit="px", lens=(900, 320, 240, 0.2))
=======
@pytest.fixture
def fisheye(monkeypatch):
    monkeypatch.setitem(PLANAR, "fisheye", replace(PLANAR["homography"], bend=division))
    monkeypatch.setitem(SPATIAL, "fisheye", replace(SPATIAL["pinhole"], bend=division))


def seen(rng, n):
    """Joints (n, 2), and pixels (n, 2) of an arm under the law of `division`."""
    q = rng.uniform(0.2, 2.4, (n, 2))
    x = 0.3 * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
    x += 0.25 * np.stack([np.cos(q.sum(axis=1)), np.sin(q.sum(axis=1))], axis=1)
    y = x - x.mean(axis=0)
    pixels = 900.0 * y / (1 + 8.0 * (y**2).sum(axis=1, keepdims=True))
    return q, pixels + rng.normal(0, 0.2, (n, 2))


def assert_slopes(structure, q, beta, h=1e-6):
    z, by_beta = structure.linearise(q, beta)
    np.testing.assert_allclose(z, structure.predict(q, beta), rtol=1e-12)
    for k in np.concatenate([structure.groups[g] for g in LENS if g in structure.groups]):
        step = np.zeros(structure.size)
        step[k] = h
        rise = structure.predict(q, beta + step) - structure.predict(q, beta - step)
        np.testing.assert_allclose(by_beta[:, :, k], rise / (2 * h), rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("law", [cubic, division])
def test_a_pixel_is_undistorted_by_the_law_that_bent_it(law):
    lens = np.array([900.0, 320.0, 240.0, 0.1])
    ideal = np.random.default_rng(0).uniform(-0.4, 0.4, (9, 2))
    slope, ratio, _ = law(lens[3], (ideal**2).sum(axis=1))
    pixels = lens[0] * ideal * (1 + slope * ratio)[:, None] + lens[1:3]
    np.testing.assert_allclose(undistorted(pixels, lens, law), ideal, atol=1e-12)


@pytest.mark.parametrize("law", [cubic, division])
def test_a_law_is_neutral_at_0_and_its_slopes_are_its_own(law):
    r2, h = np.linspace(0.01, 1.0, 9), 1e-6

    def bend(k, r2):
        slope, ratio, _ = law(k, r2)
        return slope * ratio

    assert (bend(0.0, r2) == 0.0).all()
    slope, _, by_k = law(0.3, r2)
    np.testing.assert_allclose(slope, (bend(0.3, r2 + h) - bend(0.3, r2 - h)) / (2 * h), rtol=1e-6)
    np.testing.assert_allclose(by_k, (bend(0.3 + h, r2) - bend(0.3 - h, r2)) / (2 * h), rtol=1e-6)


def test_a_planar_fisheye_is_fitted_stored_and_compiled(fisheye):
    q, z = seen(np.random.default_rng(0), 50)
    names, turn = ("a", "b"), (True, True)
    fitted = fit_body(q, z, joint_names=names, revolute=turn, view="fisheye", unit="px")
    assert np.linalg.norm(fitted.held_out, axis=1).mean() < 0.4
    body = fitted.body
    assert body.beta[body.structure.groups["lens"][0]] > 10 * body.deviations[8] > 0
    structure, beta = body.structure, body.beta
    assert_slopes(structure, q[:5], beta)
    kind = type(structure)
    assert FORMAT.read(kind, *FORMAT.write(structure, kind)) == structure


def test_a_fisheye_sees_an_arm_in_space(fisheye):
    arm = load_arm("six_axis")
    structure = structure_of(arm, "fisheye", unit="px", lens=(900.0, 320.0, 240.0, 0.2))
>>>>>>> main
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
