"""Expected errors hold for 95 % of the queries: inside, at the border, and beside paths.

Border queries are fewer, so that chance moves their share by up to two percent more.
"""

import numpy as np
import pytest
from models import log, trained

import calib

CASES = [("two_link", 0.0), ("two_link", 1e-3), ("two_link_full", 1e-3), ("polar", 1e-3)]


def test_bounds_of_maps_alone_hold_for_95_percent():
    model, arm = trained("two_link", 3000, 15, 1e-3, body="none"), calib.load_arm("two_link")
    q = np.random.default_rng(99).uniform(arm.lower, arm.upper, (8000, 2))
    covered = np.linalg.norm(model.forward(q) - arm.forward(q), axis=1) <= model.expected_error(q)
    assert 0.93 <= covered.mean() <= 0.97


@pytest.mark.parametrize(("robot", "noise"), CASES)
def test_bounds_of_a_simulation_hold_in_both_directions(robot, noise):
    model = trained(robot, n=3000, size=15, noise=noise)
    arm, rng = calib.load_arm(robot), np.random.default_rng(99)
    q = rng.uniform(arm.lower, arm.upper, (8000, arm.dof))
    x = arm.forward(q)
    forward = np.linalg.norm(model.forward(q) - x, axis=1) <= model.expected_error(q)
    answer = model.solve(x, near=q[rng.permutation(len(q))])
    reached = answer.reachable
    assert reached.mean() > 0.99
    away = np.linalg.norm(arm.forward(answer.q) - x, axis=1)
    inverse = (away <= answer.expected_error)[reached]
    if noise == 0.0:  # errors of rounding: of the map, and of the search that ends beside a target
        assert forward.all()
        assert (away <= answer.expected_error + answer.distance)[reached].all()
        assert away[reached].max() < 1e-12
        return
    assert 0.93 <= forward.mean() <= 0.97
    assert 0.93 <= inverse.mean() <= 0.97
    border = (np.abs(model.motor.scale.to_unit(q) - 0.5) > 0.45).any(axis=1)
    assert 0.91 <= forward[border].mean() <= 0.98


def answered(model, q, x):
    """Share of rows that are answered, and how much of that the bound covers."""
    bound = model.expected_error(q)
    known = np.isfinite(bound)
    off = np.linalg.norm(model.forward(q) - x, axis=1)
    return known.mean(), np.mean((off <= bound)[known])


@pytest.mark.parametrize("rows", [200, 800])
def test_a_logs_bound_on_what_the_sensor_will_read_holds_for_95_percent(rows):
    held = []
    for seed in range(2):
        model = calib.train(log(rows, 1e-3, seed), size=8, seed=seed)
        assert model.about.bound_of == "sensor reading"
        fresh = log(5000, 1e-3, seed + 70)
        share, covered = answered(model, fresh.q, fresh.x)
        assert share > 0.95
        held.append(covered)
    assert 0.93 <= np.mean(held) <= 0.98
