"""Closed loops: the servo step against the Jacobian, limits, and arms that differ."""

import numpy as np
import pytest
from models import draw, trained, two_link

import calib


def test_a_small_step_goes_where_the_jacobian_says():
    model = trained()
    q = draw(model, 50, seed=1, margin=0.2)
    gap = 1e-5 * np.random.default_rng(2).normal(size=(50, 2))
    x = two_link(q)
    moved = two_link(model.servo(x, x + gap, q, gain=1.0)) - x
    np.testing.assert_allclose(moved, gap, rtol=0.05, atol=5e-7)
    np.testing.assert_allclose(model.servo(x, x, q), q, atol=1e-12)  # on target


@pytest.mark.parametrize("robot", ["two_link", "three_link", "polar", "scara"])
def test_an_arm_that_differs_is_brought_onto_its_target(robot):
    model = trained(robot)
    arm = calib.load_arm(robot)
    first = arm.joint_names[0]
    real = calib.Simulation(arm, changes=(f"{first}.offset=0.04", "sensor.rotate=0.05"))
    q = draw(model, 20, seed=4, margin=0.25)
    target = real.exact(draw(model, 20, seed=5, margin=0.3))
    q = model.inverse(target, near=q, nearest=True)
    assert np.linalg.norm(real.exact(q) - target, axis=1).mean() > 5e-3
    for _ in range(60):
        q = model.servo(real.exact(q), target, q)
    assert np.median(np.linalg.norm(real.exact(q) - target, axis=1)) < 1e-6


def test_steps_keep_the_limits_and_are_never_long():
    model = trained()
    span = model.about.upper - model.about.lower
    q = draw(model, 100, seed=6)
    far = np.random.default_rng(7).uniform(-5, 5, (100, 2))
    after = model.servo(two_link(q), far, q, gain=1.0)
    assert (after >= model.about.lower - 1e-12).all()
    assert (after <= model.about.upper + 1e-12).all()
    assert (np.linalg.norm((after - q) / span, axis=1) <= 0.1 + 1e-12).all()


def test_a_gain_is_a_share_of_the_way():
    for gain in (0.0, -1.0, 1.5, float("nan")):
        with pytest.raises(calib.QueryError, match="gain"):
            trained().servo([0.1, 0.1], [0.1, 0.2], [0.1, 0.5], gain=gain)
