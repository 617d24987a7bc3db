"""Closed loops: the servo step against the Jacobian, limits, and arms that differ."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from models import draw, trained, two_link

import calib

EXAMPLE = Path(__file__).parents[2] / "examples" / "closed_loop.py"


def test_a_small_step_goes_where_the_jacobian_says():
    model = trained()
    q = draw(model, 50, seed=1, margin=0.2)
    gap = 1e-5 * np.random.default_rng(2).normal(size=(50, 2))
    x = two_link(q)
    moved = two_link(model.servo(x, x + gap, q, gain=1.0)) - x
    np.testing.assert_allclose(moved, gap, rtol=0.05, atol=5e-7)


def test_on_target_nothing_moves():
    model = trained("three_link")
    q = draw(model, 20, seed=3)
    x = model.forward(q)
    np.testing.assert_allclose(model.servo(x, x, q), q, atol=1e-12)


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


def test_a_stretched_arm_stays_calm():
    model = trained("two_link_full")
    q = np.array([0.7, 0.0])
    x = model.forward(q)
    step = model.servo(x, x * (1 - 1e-3), q) - q
    assert np.abs(step).max() < 0.6


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (([np.nan, 0.1], [0.1, 0.2], [0.1, 0.5]), "measured position"),
        (([0.1, 0.1], [0.1], [0.1, 0.5]), "target"),
        (([0.1, 0.1], [0.1, 0.2], [0.1]), "q of shape"),
        (([0.1, 0.1], [[0.1, 0.2]] * 2, [0.1, 0.5]), "2 targets"),
    ],
)
def test_bad_arguments_are_told_in_one_line(arguments, part):
    with pytest.raises(calib.QueryError) as told:
        trained().servo(*arguments)
    assert part in str(told.value)
    assert "\n" not in str(told.value)


def test_a_gain_is_a_share_of_the_way():
    for gain in (0.0, -1.0, 1.5, float("nan")):
        with pytest.raises(calib.QueryError, match="gain"):
            trained().servo([0.1, 0.1], [0.1, 0.2], [0.1, 0.5], gain=gain)


def test_the_example_converges_to_the_noise_of_its_camera(capsys):
    result = runpy.run_path(str(EXAMPLE))["main"]()
    assert result["open_loop"] > 20 * result["noise"]
    assert result["closed_loop"] < 2 * result["noise"]
    assert "open loop" in capsys.readouterr().out
