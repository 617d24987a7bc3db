"""A simulated arm and the first rows of the real one: what a drawing may say where none was."""

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


def test_an_improvement_along_a_line_says_nothing_of_the_rest(model):
    """Strong waves along a line are not taken for lengths or a lens."""
    along = np.sort(np.random.default_rng(2).random(60))
    line = np.stack([0.05 + 0.9 * along, 0.2 + 0.5 * along], axis=1)
    found = calib.adapt(model, rows_of(line))
    q = rows_of(np.random.default_rng(9).random((500, 2))).q
    error = np.linalg.norm(found.model.forward(q) - real(q), axis=1)
    before = np.linalg.norm(model.forward(q) - real(q), axis=1)
    known = np.isfinite(error)
    assert found.improved
    assert not found.everywhere
    assert any("unknown elsewhere" in note for note in found.notes)
    assert np.mean(error[known] <= found.model.model_error(q[known])) > 0.85
    assert error[known].mean() < before[known].mean()


def test_a_bound_that_the_rows_contradict_is_widened(model):
    """A bump that few rows saw: nothing improves, and the bound of the drawing does not hold."""
    q = ARM.lower + (ARM.upper - ARM.lower) * np.random.default_rng(30).random((530, 2))
    away = (q - (ARM.lower + ARM.upper) / 2) / (ARM.upper - ARM.lower)
    x = ARM.forward(q) + 5e-3 * np.exp(-50 * (away**2).sum(axis=1))[:, None]
    log = calib.Samples(q[:30], x[:30], ARM.joint_names, ARM.lower, ARM.upper, (True, True))
    found = calib.adapt(model, log)
    assert not found.improved
    assert any("the prediction stays" in note for note in found.notes)
    said = found.model.forward(q[30:])
    assert np.array_equal(said, model.forward(q[30:]))
    error = np.linalg.norm(said - x[30:], axis=1)
    assert np.mean(error <= model.model_error(q[30:])) < 0.1
    assert np.mean(error <= found.model.model_error(q[30:])) > 0.6
