"""Online adaptation: the paper's eq. 9 to 12 on a stream."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, error, log, model

import calib
from calib.change.follow import BLOCK, OnlineAdapter, follow, matching_sigma
from calib.errors import OptionError
from calib.maps import dsom
from calib.maps.graph import Graph
from calib.maps.map import Map

HORIZON = 3000


def streamed(*changes, n=3500, noise=0.0):
    samples = log(*changes, n=n, seed=3, noise=noise)
    pairs = list(follow(model(), samples.q, samples.x, horizon=HORIZON))
    return samples, [step for step, _ in pairs], pairs[-1][1]


def test_a_calm_stream_changes_nothing():
    _, steps, adapter = streamed(n=1000)
    assert not any(step.adapting for step in steps)
    assert adapter.model() is model()


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


def test_schedules_decay_exponentially():
    _, steps, _ = streamed("elbow.length=+20%")
    learning = [s for s in steps if s.adapting][2:28]
    for name in ("sigma", "eta", "beta"):
        values = np.array([getattr(s, name) for s in learning])
        assert (np.diff(values) <= 1e-12).all()
    ratios = np.array([s.sigma for s in learning])
    assert np.allclose(ratios[1:] / ratios[:-1], ratios[1] / ratios[0], rtol=1e-6)
    assert steps[-1].beta == pytest.approx(1.0)
    assert steps[-1].sigma == pytest.approx(0.5)


def test_a_change_that_stays_inside_of_the_map_is_noticed_by_the_links():
    _, steps, adapter = streamed("sensor.mirror=x", n=600)
    assert adapter.adapting
    assert steps[0].samples == BLOCK


def test_sigma_is_reset_to_where_training_had_the_same_distortion():
    lattice, scale = model().sensory.lattice, model().sensory.scale
    history = np.array(
        [[900, 8.0, 0.5, 0], [900, 4.0, 0.4, 0], [900, 1.0, 0.2, 0], [900, 0.5, 0.05, 0]]
    )
    network = Map(model().sensory.units, lattice, scale, history)
    # the error of an epoch is what the radius of the one before has left
    assert matching_sigma(network, 0.4) == pytest.approx(8.0)
    assert matching_sigma(network, 0.2) == pytest.approx(4.0)
    assert 4.0 < matching_sigma(network, 0.3) < 8.0
    assert matching_sigma(network, 0.9) == 15.0  # larger than ever: the radius of the map


def test_nodes_that_are_no_longer_visited_lose_their_links():
    _, _, adapter = streamed("elbow.length=-40%")
    followed = adapter.model()
    far = np.linalg.norm(followed.sensory.weights, axis=1) > 0.30 + 0.6 * 0.25 + 0.02
    strength = np.asarray(followed.links.sum(axis=0)).ravel()
    assert (strength[far] == 0).all()
    assert np.isnan(followed.inverse(model().forward([0.3, 0.3]))).all()


def test_feeding_all_at_once_or_in_parts_is_the_same():
    samples = log("elbow.length=+20%", n=1000, noise=0.0)
    whole = OnlineAdapter(model(), HORIZON)
    whole.feed(samples.q, samples.x)
    parts = OnlineAdapter(model(), HORIZON)
    for k in range(0, 1000, BLOCK):
        parts.feed(samples.q[k : k + BLOCK], samples.x[k : k + BLOCK])
    assert np.array_equal(whole.model().sensory.units, parts.model().sensory.units)


def test_the_map_follows_by_the_gain_that_it_was_trained_with():
    samples = log("elbow.length=+20%", n=1000, noise=0.0)
    followed = {}
    for name in ("som", "vdsom", "vdsom:border", "<function gain>"):
        about = replace(model().about, options={**model().about.options, "map": name})
        adapter = OnlineAdapter(replace(model(), about=about), HORIZON, force=True)
        adapter.feed(samples.q, samples.x)
        followed[name] = adapter.model().sensory.units
    assert np.array_equal(followed["vdsom"], followed["vdsom:border"])
    assert np.array_equal(followed["vdsom"], followed["<function gain>"])
    assert not np.array_equal(followed["vdsom"], followed["som"])


def test_a_dsom_follows_by_its_own_rule():
    about = replace(model().about, options={**model().about.options, "map": "dsom"})
    samples, before = log("elbow.length=+20%", n=BLOCK, noise=0.0), model().sensory
    adapter = OnlineAdapter(replace(model(), about=about), HORIZON, force=True)
    adapter.feed(samples.q, samples.x)
    weights = before.units.copy()
    dsom.present_dsom(weights, before.lattice, before.scale.to_unit(samples.x))
    assert np.array_equal(adapter.model().sensory.units, weights)
    assert np.abs(weights - before.units).max() > 1e-3


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
