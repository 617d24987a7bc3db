"""A sensor's clock that is late is found with the body, told and corrected."""

from dataclasses import replace

import numpy as np
import pytest
from models import log_of

import calib


def moving(robot, late, n=400, rate=25.0, noise=1e-4, seed=1):
    """A log along a path, its positions late by so many seconds, and the true kinematics."""
    arm = calib.load_arm(robot)
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 2.2, 1.3)
    pace, phase = rng.uniform(0.4, 1.2, (arm.dof, 2)), rng.uniform(0, 6.28, (arm.dof, 2))

    def q(t):
        return middle + half * np.sin(t[:, None, None] * pace + phase).mean(axis=2)

    offset = rng.normal(0.0, 3e-3, arm.dof)
    x = arm.forward(q(t - late) + offset)
    x += rng.normal(0.0, noise, x.shape)
    log = log_of(arm, q(t), x, time=t)
    return log, lambda q: arm.forward(q + offset)


@pytest.mark.parametrize("robot", ["two_link", "spatial_three"])
@pytest.mark.parametrize("late", [0.02, -0.005, 0.15])
def test_a_late_clock_is_corrected_and_told(robot, late):
    """20 ms at 1.65 rad/s cost 2.3 mm for .27, and the bound covered 72 %."""
    log, truth = moving(robot, late)
    model = calib.train(log, size=8)
    # 60 ms of rows at 20 Hz were told as one row and 10 ms
    (note,) = (n for n in model.about.notes if "against the joints" in n or "moved by" in n)
    assert ("late" if late > 0 else "early") in note
    value, half = (float(v) for v in note.split(" are ")[1].split(" ms")[0].split(" +- "))
    assert abs(value - 1e3 * abs(late)) < 0.5
    assert half < 1.0
    error = np.linalg.norm(model.forward(log.q) - truth(log.q), axis=1)
    known = np.isfinite(error)
    assert error[known].mean() < 2e-4
    assert np.mean(error[known] <= model.expected_error(log.q)[known]) > 0.9


@pytest.mark.parametrize("robot", ["two_link", "spatial_three"])
def test_a_clock_that_is_right_and_poses_in_any_order_need_no_word(robot):
    log, _ = moving(robot, 0.0)
    order = np.random.default_rng(0).permutation(len(log))
    for each in (log, log.take(order)):
        notes = calib.train(each, size=8).about.notes
        assert not any("against the joints" in note for note in notes)


def test_without_a_column_of_time_the_delay_is_one_of_rows():
    log, _ = moving("two_link", 0.02)
    model = calib.train(replace(log, time=None), size=8)
    assert [n for n in model.about.notes if "0.499 +- " in n and "rows late" in n]


def test_evaluate_compares_a_late_log_as_if_it_were_in_time():
    log, _ = moving("two_link", 0.0)
    model = calib.train(log, size=8)
    late, _ = moving("two_link", 0.03)
    result = calib.evaluate(model, late)
    assert any("30" in note and "late" in note for note in result.notes)
    assert result.errors["local"]["forward"]["distance"]["mean"] < 3e-4
