"""The planar structure: closed forms, derivatives by finite differences, invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.body.curves import curve_slope, curve_value, waves_of
from calib.body.planar import PlanarStructure
from calib.body.sensors import InPlane


def structure(revolute=(True, True), view="rigid", signs=(1, 1), mirror=1) -> PlanarStructure:
    names = tuple(f"j{i}" for i in range(len(revolute)))
    sensor = InPlane(view, extent=0.4, mirror=mirror, centre=(0.1, -0.2))
    return PlanarStructure(names, revolute, signs, None, False, (sensor,))


def some_beta(s: PlanarStructure, seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    beta = s.prior(s.members()[-1][1]).mean + generator.normal(0, 0.02, s.size)
    beta[s.groups["length"]] = 0.3
    beta[s.groups["view.shift"]] = 0.5, -0.3
    return beta


def test_two_link_closed_form():
    s = structure()
    beta = s.prior(("length",)).mean.copy()
    beta[s.groups["length"]] = 0.5, 0.25
    q = np.array([[0.3, -0.7], [0.0, np.pi / 2]])
    expected = [
        [0.5 * np.cos(a) + 0.25 * np.cos(a + b), 0.5 * np.sin(a) + 0.25 * np.sin(a + b)]
        for a, b in q
    ]
    assert np.allclose(s.predict(q, beta), expected, atol=1e-15)


CASES = [
    ((True, True), "rigid", (1, 1), 1),
    ((True, True, True), "homography", (1, -1, 1), -1),
    ((True, False, True), "affine", (1, 1, -1), 1),
    ((False, True), "homography", (1, 1), -1),
]


@pytest.mark.parametrize(("revolute", "view", "signs", "mirror"), CASES)
def test_derivatives_by_finite_differences(revolute, view, signs, mirror):
    s = structure(revolute, view, signs, mirror)
    beta = some_beta(s)
    q = np.random.default_rng(1).uniform(-1, 1, (4, len(revolute)))
    z, by_beta = s.linearise(q, beta)
    assert np.allclose(z, s.predict(q, beta), atol=1e-14)
    h = 1e-6
    for k in range(s.size):
        step = np.zeros(s.size)
        step[k] = h
        slope = (s.predict(q, beta + step) - s.predict(q, beta - step)) / (2 * h)
        assert np.allclose(by_beta[:, :, k], slope, atol=1e-7), s.labels[k]
    by_joint = s.slope(q, beta)
    for k in range(s.dof):
        step = np.zeros(s.dof)
        step[k] = h
        slope = (s.predict(q + step, beta) - s.predict(q - step, beta)) / (2 * h)
        assert np.allclose(by_joint[:, :, k], slope, atol=1e-7)


def test_a_rotated_sensor_is_an_offset_of_the_first_joint():
    s = structure()
    beta = some_beta(s)
    beta[s.groups["elastic"]] = 0.0
    moved, turned = beta.copy(), beta.copy()
    moved[s.groups["offset"][0]] += 0.3
    turned[s.groups["view.rotation"]] += 0.3
    for each in (moved, turned):
        for name in ("view.shear", "view.tilt", "lens"):
            each[s.groups[name]] = 0.0  # a rigid view
    q = np.random.default_rng(5).uniform(-1, 1, (6, 2))
    assert np.allclose(s.predict(q, moved), s.predict(q, turned), atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(st.floats(-20, 20), st.integers(0, 1000))
def test_curves_repeat_every_turn_and_agree_with_their_series(x, seed):
    c = np.random.default_rng(seed).normal(0, 1e-3, 96)
    orders = np.arange(1, 49)
    direct = c[:48] @ np.cos(orders * x) + c[48:] @ np.sin(orders * x)
    assert curve_value(np.array([x]), c)[0] == pytest.approx(direct, abs=1e-14)
    assert curve_value(np.array([x + 2 * np.pi]), c)[0] == pytest.approx(direct, abs=1e-13)
    waves = np.concatenate([np.cos(orders * x), np.sin(orders * x)])
    assert np.allclose(waves_of(np.array([x]))[:, 0], waves, atol=1e-12)
    h = 1e-6
    slope = (curve_value(np.array([x + h]), c) - curve_value(np.array([x - h]), c)) / (2 * h)
    assert np.allclose(curve_slope(np.array([x]), c), slope, atol=1e-7)
