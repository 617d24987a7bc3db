"""Without a body rows along a path say nothing of how the position changes beside it."""

import numpy as np
import pytest
from models import log

import calib

ARM = calib.load_arm("two_link")
LOW, SPAN = np.array(ARM.lower), np.array(ARM.upper) - np.array(ARM.lower)


def closed_path(shape, n):
    """A log of two_link along a closed path through the joints' box, with 1 mm noise."""
    t = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    place = {
        "circle": np.stack([0.3 * np.cos(t), 0.3 * np.sin(t)], axis=1),
        "ellipse": np.stack([0.4 * np.cos(t), 0.2 * np.sin(t)], axis=1),
        "eight": np.stack([0.4 * np.sin(t), 0.35 * np.sin(2 * t)], axis=1),
    }[shape]
    q = LOW + SPAN * (0.5 + place)
    x = ARM.forward(q) + np.random.default_rng(0).normal(scale=1e-3, size=q.shape)
    return calib.Samples(q, x, ARM.joint_names, ARM.lower, ARM.upper, ARM.revolute)


def covered(model):
    """Share of the box that is answered, and how much of that the bound covers."""
    rng = np.random.default_rng(1)
    q = LOW + SPAN * rng.random((4000, 2))
    said, bound = model.forward(q), model.expected_error(q)
    known = np.isfinite(bound)
    x = ARM.forward(q) + rng.normal(scale=1e-3, size=q.shape)
    return known.mean(), np.mean(np.linalg.norm(said - x, axis=1)[known] <= bound[known])


@pytest.mark.parametrize(("shape", "n"), [("circle", 120), ("ellipse", 200), ("eight", 200)])
def test_the_bound_holds_beside_a_closed_path(shape, n, tmp_path):
    rows = closed_path(shape, n)
    model = calib.train(rows, body="none")
    share, held = covered(model)
    assert share > 0.02
    assert held >= 0.93
    assert np.isfinite(model.expected_error(rows.q)).mean() > 0.7
    # the file keeps what the bound rests on
    model.save(tmp_path / "path.calib")
    q = LOW + SPAN * np.random.default_rng(2).random((500, 2))
    again = calib.load(tmp_path / "path.calib")
    np.testing.assert_allclose(again.expected_error(q), model.expected_error(q), rtol=1e-6)


def test_babbling_is_answered_all_over_the_box():
    share, held = covered(calib.train(log(1000, 1e-3), size=14, body="none"))
    assert share > 0.95
    assert held >= 0.93
