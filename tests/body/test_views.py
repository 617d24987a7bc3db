"""Kinds of sensors: a lens of another law, added to the table, works wherever a lens counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import load_arm
from calib.body.fitting import fit_body, planar_structure
from calib.body.spatial import structure_of
from calib.body.views import PLANAR, SPATIAL, cubic
from calib.errors import OptionError
from calib.inverse.pixel import undistorted
from calib.model_file.contents import FORMAT

LENS = ("view.rotation", "view.scale", "view.shift", "view.tilt", "lens")


def division(k, r2):
    """Bend of a fisheye: 1 / (1 + k r^2) - 1."""
    grow = 1 + k * r2
    return -k / grow**2, r2 * grow, -r2 / grow**2


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
    beta = structure.neutral()
    beta[structure.groups["view.shift"]] = 0.1, 0.2, 2.5
    q = np.random.default_rng(1).uniform(arm.lower, arm.upper, (4, 6)) / 2
    groups = ("view.shift", "lens", "offset", "tool")
    _, by_beta = structure.linearise(q, beta)
    for k in np.concatenate([structure.groups[g] for g in groups]):
        step = np.zeros(structure.size)
        step[k] = 1e-6
        rise = structure.predict(q, beta + step) - structure.predict(q, beta - step)
        np.testing.assert_allclose(by_beta[:, :, k], rise / 2e-6, rtol=1e-5, atol=1e-3)


def test_an_unknown_kind_is_refused():
    _, z = seen(np.random.default_rng(0), 20)
    with pytest.raises(OptionError, match="'fisheye', expected one of auto, base"):
        planar_structure(z, ("a", "b"), (True, True), None, "fisheye", "px", False)
