"""Error curves of joints against their series."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.body.curves import curve_slope, curve_value, waves_of


@settings(max_examples=30, deadline=None)
@given(st.floats(-20, 20), st.integers(0, 1000))
def test_curves_repeat_every_turn_and_agree_with_their_series(x, seed):
    c = np.random.default_rng(seed).normal(0, 1e-3, 96)
    orders = np.arange(1, 49)
    waves = np.concatenate([np.cos(orders * x), np.sin(orders * x)])
    assert np.allclose(waves_of(np.array([x]))[:, 0], waves, atol=1e-12)
    assert curve_value(np.array([x]), c)[0] == pytest.approx(c @ waves, abs=1e-14)
    assert curve_value(np.array([x + 2 * np.pi]), c)[0] == pytest.approx(c @ waves, abs=1e-13)
    h = 1e-6
    slope = (curve_value(np.array([x + h]), c) - curve_value(np.array([x - h]), c)) / (2 * h)
    assert np.allclose(curve_slope(np.array([x]), c), slope, atol=1e-7)
