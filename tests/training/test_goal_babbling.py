"""Goal babbling: targets where the map's own error is largest."""

from __future__ import annotations

import numpy as np
import pytest
from drifting import arm

import calib
from calib.common.scale import Scale
from calib.errors import OptionError
from calib.training.goal_babbling import goal_babble, next_joints


def test_rows_are_those_of_the_simulated_arm_within_its_ranges():
    samples = goal_babble(arm(), 300, seed=3)
    assert len(samples) == 300
    assert (samples.q >= samples.lower).all()
    assert (samples.q <= samples.upper).all()
    np.testing.assert_allclose(samples.x, samples.simulation.exact(samples.q), atol=1e-12)
    again = goal_babble(arm(), 300, seed=3)
    assert np.array_equal(samples.q, again.q)
    assert not np.array_equal(samples.q, goal_babble(arm(), 300, seed=4).q)


def test_it_goes_where_the_map_is_wrong():
    rng = np.random.default_rng(0)
    q = rng.uniform(size=(900, 2))
    x = q.copy()
    wild = q[:, 0] > 0.7  # here the position turns with the joints eight times as fast
    x[wild, 1] += 0.2 * np.sin(40.0 * q[wild, 0])
    scale = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
    new = next_joints(scale, q, x, 400, rng)
    assert new.shape == (400, 2)
    assert ((new >= 0.0) & (new <= 1.0)).all()
    # 40 % are drawn at random: 30 % of those are there as well
    assert np.mean(new[:, 0] > 0.65) > 0.55


def test_changes_and_ranges_are_those_of_babble():
    samples = goal_babble(
        arm(), 100, noise=1e-3, changes=["elbow.length=+20%"], ranges={"shoulder": (0.2, 0.6)}
    )
    assert samples.q[:, 0].min() >= 0.2
    assert samples.q[:, 0].max() <= 0.6
    gap = np.linalg.norm(samples.x - samples.simulation.exact(samples.q), axis=1)
    assert 0.5e-3 < gap.mean() < 2.5e-3
    reach = np.linalg.norm(samples.x, axis=1).max()
    assert reach > 0.56  # 0.30 + 0.30 m


def test_too_few_samples_are_refused():
    for n in (10, True, 100.0):
        with pytest.raises(OptionError, match="at least 60"):
            goal_babble(arm(), n)


def test_a_model_learns_from_it():
    model = calib.train(goal_babble(arm(), 400), size=8)
    assert model.about.source == "simulation"
