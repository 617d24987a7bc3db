"""Online adaptation: the paper's eq. 9 to 12 on a stream."""

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, error, log, model

import calib
from calib import OptionError, follow
from calib.maps.lattice import Graph
from calib.stream.follow import BLOCK, OnlineAdapter

HORIZON = 3000


def streamed(*changes, n=3500, noise=0.0):
    samples = log(*changes, n=n, seed=3, noise=noise)
    pairs = list(follow(model(), samples.q, samples.x, horizon=HORIZON))
    return samples, [step for step, _ in pairs], pairs[-1][1]


@pytest.mark.parametrize("change", ["elbow.length=+20%", "elbow.length=-20%"])
def test_distortion_falls_back_under_its_threshold(change):
    samples, steps, adapter = streamed(change)
    assert steps[1].adapting
    assert steps[0].zeta_sensory > steps[0].threshold
    assert steps[-1].zeta_sensory < steps[-1].threshold
    followed = adapter.model()
    fresh = calib.train(calib.babble(arm(), 4000, seed=2, changes=[change]), size=30)
    q = np.random.default_rng(7).uniform(arm().lower, arm().upper, (1000, 2))
    truth = samples.simulation.exact(q)
    for readout, factor in (("local", 1.2), ("activity", 2.0)):
        after, best = (
            np.linalg.norm(m.forward(q, readout) - truth, axis=1).mean() for m in (followed, fresh)
        )
        assert after < factor * best + 1e-6
    assert error(followed, samples) < 1e-5


def test_a_change_that_stays_inside_of_the_map_is_noticed_by_the_links():
    _, steps, adapter = streamed("sensor.mirror=x", n=600)
    assert adapter.adapting
    assert steps[0].samples == BLOCK


def test_a_growing_gas_says_why_it_does_not_follow():
    gas = replace(model().sensory, lattice=Graph(2, np.array([[0, 1]])))
    grown = replace(model(), association=replace(model().association, sensory=gas))
    with pytest.raises(OptionError, match="growing neural gas has neither"):
        OnlineAdapter(grown)


def test_what_cannot_be():
    with pytest.raises(OptionError, match="horizon 0"):
        OnlineAdapter(model(), 0)
    with pytest.raises(OptionError, match="no samples"):
        OnlineAdapter(model()).feed(np.zeros((0, 2)), np.zeros((0, 2)))
    wide = replace(model().sensory, units=np.zeros((10**6, 2)))
    with pytest.raises(OptionError, match="few-shot"):
        OnlineAdapter(replace(model(), association=replace(model().association, sensory=wide)))
