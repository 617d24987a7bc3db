"""A simulated arm and the first rows of the real one: what a drawing may say where none was."""

from __future__ import annotations

import numpy as np
import pytest

import calib

ARM = calib.load_arm("two_link")
WAVES = np.array([5.0, 7.0])


@pytest.fixture(scope="module")
def model():
    return calib.train(calib.babble(ARM, 2000, seed=0), size=12, seed=0)


def real(q):
    """The tip (n, 2) of an arm whose joints follow waves of 2 mrad, the elbow 10 mrad off."""
    return ARM.forward(q + 2e-3 * np.sin(WAVES * q + [0.0, 1.0]) + [0.0, 0.01])


def rows_of(u, seed=0):
    q = ARM.lower + (ARM.upper - ARM.lower) * u
    x = real(q) + np.random.default_rng(seed).normal(0.0, 2e-4, q.shape)
    return calib.Samples(q, x, ARM.joint_names, ARM.lower, ARM.upper, (True, True))


@pytest.mark.parametrize(("most", "times"), [(1.0, 0.3), (0.3, 1.0)], ids=["all", "corner"])
def test_the_bound_holds_where_no_row_was(model, most, times):
    """Waves that a drawing does not show, and of which few rows tell little."""
    log = rows_of(most * np.random.default_rng(0).random((100 if most < 1.0 else 30, 2)))
    q = rows_of(np.random.default_rng(9).random((1000, 2))).q
    adapted = calib.adapt(model, log).model
    error = np.linalg.norm(adapted.forward(q) - real(q), axis=1)
    assert np.mean(error <= adapted.model_error(q)) > 0.95
    before = np.linalg.norm(model.forward(q) - real(q), axis=1).mean()
    assert error.mean() < times * before


def test_rows_along_a_line_are_left_to_the_update(model):
    from calib.change.comparison import compare
    from calib.change.drawing import fit_from_drawing

    along = np.linspace(0.2, 0.8, 40)[:, None] * [1.0, 0.7]
    assert fit_from_drawing(compare(model, rows_of(along)), np.inf) is None
    spread = np.random.default_rng(1).random((40, 2))
    assert fit_from_drawing(compare(model, rows_of(spread)), np.inf) is not None


def test_a_model_of_a_log_has_no_drawing(model):
    from calib.change.comparison import compare
    from calib.change.drawing import fit_from_drawing

    log = rows_of(np.random.default_rng(1).random((60, 2)))
    own = calib.train(log, size=6)
    assert fit_from_drawing(compare(own, log), np.inf) is None
