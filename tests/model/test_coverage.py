"""Expected errors: the 95 % bound holds for 93 to 97 % of fresh queries.

Border queries are fewer, so that chance moves their share by up to two percent more.
"""

import numpy as np
import pytest
from models import log, trained

import calib
from calib.maps.node_bounds import near_border

CASES = [("two_link", 0.0), ("two_link", 1e-3), ("two_link_full", 1e-3), ("polar", 1e-3)]


def fresh(model, robot, n=12_000):
    """Return joints and exact positions that training never saw."""
    arm = calib.load_arm(robot)
    q = np.random.default_rng(99).uniform(arm.lower, arm.upper, (n, arm.dof))
    return arm, q, arm.forward(q)


@pytest.mark.parametrize(("robot", "noise"), CASES)
def test_forward(robot, noise):
    model = trained(robot, n=3000, size=15, noise=noise)
    _, q, x = fresh(model, robot)
    held = np.linalg.norm(model.forward(q) - x, axis=1) <= model.expected_error(q)
    border = near_border(model.motor, model.motor.scale.to_unit(q))
    if noise == 0.0:  # errors of rounding, which no bound is below
        assert held.all()
        return
    assert 0.93 <= held.mean() <= 0.97
    assert 0.91 <= held[border].mean() <= 0.98


@pytest.mark.parametrize(("robot", "noise"), CASES)
def test_inverse(robot, noise):
    model = trained(robot, n=3000, size=15, noise=noise)
    arm, q, x = fresh(model, robot)
    near = q[np.random.default_rng(1).permutation(len(q))]
    answer = model.solve(x, near=near)
    reached = answer.reachable
    assert reached.mean() > 0.99
    away = np.linalg.norm(arm.forward(answer.q) - x, axis=1)[reached]
    held = away <= answer.expected_error[reached]
    if noise == 0.0:
        assert held.all()
        return
    assert 0.93 <= held.mean() <= 0.97


@pytest.mark.parametrize("rows", [200, 800])
def test_a_logs_bound_on_what_the_sensor_will_read_holds_for_95_percent(rows):
    held = []
    for seed in range(2):
        model = calib.train(log(rows, 1e-3, seed), size=8, seed=seed)
        assert model.about.bound_of == "sensor reading"
        fresh = log(5000, 1e-3, seed + 70)
        known = np.isfinite(model.forward(fresh.q)[:, 0])
        assert known.mean() > 0.95
        errors = np.linalg.norm(model.forward(fresh.q[known]) - fresh.x[known], axis=1)
        held.append(np.mean(errors <= model.expected_error(fresh.q[known])))
    assert 0.93 <= np.mean(held) <= 0.98
