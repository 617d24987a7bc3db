"""The ablation: its cases are what they say, and a small run fills every figure."""

import numpy as np
import pytest

from calib.arm.loading import load_arm
from calib.paper.ablation import Ground, measure, train_on
from calib.paper.ablation_cases import bump, ripple, simulated


def test_a_bump_is_three_millimetres_high_and_gone_outside():
    arm = load_arm("two_link")
    truth, inside = bump(arm)
    middle, away = np.radians([[45.0, 80.0]]), np.radians([[45.0, 100.0]])
    height = np.linalg.norm(truth(middle) - arm.forward(middle), axis=1)
    assert height == pytest.approx(3e-3)
    assert inside(middle)
    assert not inside(away)
    assert np.linalg.norm(truth(away) - arm.forward(away)) < 1e-12


def test_a_ripple_moves_the_elbow_inside_of_its_window_alone():
    arm = load_arm("two_link")
    truth, inside = ripple(arm)
    q = np.radians(np.stack([np.full(200, 30.0), np.linspace(20, 140, 200)], axis=1))
    gap = np.linalg.norm(truth(q) - arm.forward(q), axis=1)
    assert gap[~inside(q)].max() == 0.0
    assert 0.8 * np.radians(1) * 0.25 < gap.max() <= np.radians(1) * 0.25


def test_an_uneven_log_dwells_and_is_tested_evenly():
    case = simulated("uneven", 2000, 500, seed=0)
    span = case.samples.upper - case.samples.lower
    u = (case.samples.q - case.samples.lower) / span
    assert 0.65 < ((u > 0.1) & (u < 0.25)).all(axis=1).mean() < 0.8
    assert abs(((case.q - case.samples.lower) / span).mean() - 0.5) < 0.03


@pytest.mark.parametrize("network", ["vdsom", "grid"])
def test_a_trained_network_is_measured_in_full(network):
    case = simulated("exact", 800, 200, seed=0)
    figures = measure(case, train_on(case, Ground.of(case, 0), network, 8, 0))
    assert figures["local elsewhere"] < 1e-6
    assert figures["local defect"] is None
    assert figures["linear elsewhere"] < figures["activity elsewhere"] < figures["winner elsewhere"]
    assert figures["missed"] < 5.0
    assert 80 < figures["linear covered"] <= 100
