"""A stream for life: changes are noticed, learned, kept and recognised."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drifting import arm, log

import calib
from calib.change.follow import BLOCK, OnlineAdapter
from calib.change.streams import Follower
from calib.errors import OptionError, QueryError
from calib.maps.graph import Graph

TOOL, SHORT = ("tip.offset=0.05,0",), ("elbow.length=-20%",)
NOISE = 1e-3


@cache
def model(noise=0.0):
    return calib.train(calib.babble(arm(), 2000, seed=0, noise=noise), size=15)


def points():
    return np.random.default_rng(7).uniform(arm().lower, arm().upper, (500, 2))


def errors(followed, *changes):
    truth = calib.Simulation(arm(), changes=changes).exact(points())
    found = np.linalg.norm(followed.forward(points()) - truth, axis=1)
    assert np.isfinite(found).mean() > 0.9
    return found[np.isfinite(found)]


def feed(follower, *changes, n, seed, noise=NOISE, parts=1):
    samples = log(*changes, n=n, seed=seed, noise=noise)
    states = []
    for k in range(0, n, max(1, n // parts)):
        rows = slice(k, k + max(1, n // parts))
        states.append(follower.update(samples.q[rows], samples.x[rows]))
    return states


def test_tool_on_tool_off_tool_on():
    follower = Follower(model(NOISE), horizon=600)
    assert not any(s.changed for s in feed(follower, n=400, seed=20, parts=20))
    first = feed(follower, *TOOL, n=700, seed=21, parts=140)
    assert first[2].changed  # 13 of 20 samples
    assert first[-1].schema == "schema 2"
    assert not first[-1].learning
    assert errors(follower.model, *TOOL).mean() < 4e-4
    for seed, changes, name in ((22, (), "schema 1"), (23, TOOL, "schema 2")):
        states = feed(follower, *changes, n=60, seed=seed, parts=12)
        recalled = [s.samples - states[0].samples + 5 for s in states if s.recalled]
        assert recalled[0] <= 25
        assert states[-1].schema == name
        assert errors(follower.model, *changes).mean() < 4e-4
    assert {s.name for s in follower.model.schemas} == {"schema 1"}


def test_schemas_that_differ_by_less_than_the_bound_are_told_apart():
    small = ("tip.offset=0.002,0",)
    other = calib.train(log(*small, n=2000, seed=11, noise=NOISE), size=15)
    follower = Follower(calib.keep(model(NOISE), other, "pen"))
    assert not any(s.changed for s in feed(follower, n=1000, seed=12, parts=50))
    for seed, changes, name in ((13, small, "pen"), (14, (), "schema 1"), (15, small, "pen")):
        states = feed(follower, *changes, n=60, seed=seed, parts=12)
        assert states[-1].schema == name


def test_three_changes_in_a_row_are_each_recovered_and_bounded():
    follower = Follower(model(NOISE), horizon=2000)
    for k, changes in enumerate((TOOL, SHORT, ("sensor.rotate=0.06",))):
        feed(follower, *changes, n=250, seed=30 + k, parts=50)
        found = errors(follower.model, *changes)
        assert found.mean() < 1e-3
        bound = follower.model.expected_error(points())
        assert np.mean(found <= bound[np.isfinite(bound)]) > 0.9


def test_a_calm_stream_is_left_alone_for_long():
    follower = Follower(model(NOISE))
    states = feed(follower, n=5000, seed=40, parts=10)
    assert not any(s.changed or s.learning for s in states)
    assert follower.model.predictor is model(NOISE).predictor


def test_wrong_detections_are_no_change():
    follower = Follower(model(NOISE))
    states = feed(follower, "sensor.outliers=0.1", n=2000, seed=41, parts=20)
    assert not any(s.changed for s in states)


def test_feeding_one_by_one_finds_the_same_schemas():
    samples = log(*TOOL, n=50, seed=42, noise=NOISE)
    single = Follower(model(NOISE))
    for q, x in zip(samples.q, samples.x, strict=True):
        state = single.update(q, x)
    whole = Follower(model(NOISE))
    assert whole.update(samples.q, samples.x).schema == state.schema == "schema 2"
    assert abs(errors(single.model, *TOOL).mean() - errors(whole.model, *TOOL).mean()) < 2e-3


def test_schemas_outlive_the_program(tmp_path):
    follower = Follower(model(NOISE), horizon=300)
    feed(follower, *TOOL, n=350, seed=43)
    follower.model.save(tmp_path / "m.calib")
    again = Follower(calib.load(tmp_path / "m.calib"))
    states = feed(again, n=30, seed=44, parts=6)
    assert [s.schema for s in states][-1] == "schema 1"
    assert any(s.recalled for s in states)
    assert errors(again.model).mean() < 4e-4


def test_so_many_schemas_are_kept_and_no_more():
    follower = Follower(model(NOISE), most=2, horizon=200)
    for k, changes in enumerate((TOOL, SHORT, ("sensor.rotate=0.06",))):
        feed(follower, *changes, n=250, seed=50 + k)
    assert len(follower.model.schemas) == 1


def test_the_rule_recovers_from_three_changes_in_a_row():
    adapter = OnlineAdapter(model(), horizon=1500)
    usual = np.linalg.norm(model().forward(points(), "activity") - arm().forward(points()), axis=1)
    for k, changes in enumerate((TOOL, (), SHORT)):
        samples = log(*changes, n=2500, seed=60 + k, noise=0.0)
        for first in range(0, 2500, BLOCK):
            step = adapter.feed(samples.q[first : first + BLOCK], samples.x[first : first + BLOCK])
        assert step.changes == k + 1
        assert not step.adapting
        assert step.zeta_sensory < step.threshold
        followed = adapter.model()
        assert errors(followed, *changes).max() < 1e-6
        truth = samples.simulation.exact(points())
        by_maps = np.linalg.norm(followed.forward(points(), "activity") - truth, axis=1)
        assert np.nanmean(by_maps) < 2.5 * usual.mean()


def test_a_change_while_the_maps_re_form_is_noticed():
    adapter = OnlineAdapter(model(), horizon=10_000)
    for k, changes in enumerate((TOOL, SHORT)):
        samples = log(*changes, n=1200, seed=70 + k, noise=0.0)
        adapter.feed(samples.q, samples.x)
    assert adapter.changes == 2
    assert adapter.adapting
    assert errors(adapter.model(), *SHORT).max() < 1e-6


def test_links_of_nodes_without_visits_fade():
    adapter = OnlineAdapter(model(), horizon=1500)
    samples = log("elbow.length=-40%", n=4000, seed=80, noise=0.0)
    adapter.feed(samples.q, samples.x)
    made = adapter.model("rule")
    far = np.linalg.norm(made.sensory.weights, axis=1) > 0.30 + 0.6 * 0.25 + 0.02
    strength = np.asarray(made.links.sum(axis=0)).ravel()
    assert strength[far].max(initial=0.0) < 0.1 * np.median(strength[~far])


def test_a_dsom_follows_by_its_own_rule():
    samples = log(*TOOL, n=400, seed=90, noise=0.0)
    base = model()
    about = replace(base.about, options={**base.about.options, "map": "dsom"})
    adapter = OnlineAdapter(replace(base, about=about), force=True)
    adapter.feed(samples.q, samples.x)
    by_hand = base.sensory.units.copy()
    from calib.maps.dsom import present_dsom

    v = base.sensory.scale.to_unit(samples.x)
    for k in range(0, 400, BLOCK):
        present_dsom(by_hand, base.sensory.lattice, v[k : k + BLOCK])
    assert np.array_equal(adapter.model().sensory.units, by_hand)


def test_what_cannot_be():
    gas = replace(model().motor, lattice=Graph(model().motor.size, model().motor.edges))
    grown = replace(model(), association=replace(model().association, motor=gas))
    for follow in (Follower, OnlineAdapter):
        with pytest.raises(OptionError, match="growing neural gas"):
            follow(grown)
    with pytest.raises(OptionError, match="one or more schemas"):
        Follower(model(), most=0)
    with pytest.raises(OptionError, match="horizon"):
        Follower(model(), horizon=5)
    with pytest.raises(QueryError, match=r"\(n, 2\)"):
        Follower(model()).update([[0.1, 0.2]], [[0.1, 0.2, 0.3]])
    with pytest.raises(QueryError, match="finite"):
        Follower(model()).update([0.1, 0.2], [np.nan, 0.2])


def test_maps_and_links_alone_follow_as_well():
    base = calib.train(calib.babble(arm(), 2000, seed=0, noise=NOISE), size=15, body="none")
    usual = errors(base).mean()
    follower = Follower(base, horizon=1500)
    feed(follower, *TOOL, n=1600, seed=95)
    assert follower.model.body is None
    assert follower.model.default_readout == "linear"
    assert errors(follower.model, *TOOL).mean() < 3.0 * usual
    feed(follower, n=40, seed=96)
    assert follower.model.schema == "schema 1"
    assert errors(follower.model).mean() < 1.1 * usual
