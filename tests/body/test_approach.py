"""The direction of approach, and bounds that cover what no encoder reads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from models import L1, L2, arm, bare, lengths, log_of, two_link

import calib

PLAY = 0.01


@cache
def trained(change):
    return calib.train(calib.babble(arm(), 2000, noise=1e-4, changes=[change]), size=15)


def true_rows(change):
    simulation, rng = calib.Simulation(arm(), changes=[change]), np.random.default_rng(4)
    q = simulation.draw(2000, rng)
    return q, simulation.true(q, rng)


@pytest.mark.parametrize("change", ["elbow.backlash=0.01", "elbow.noise=0.005"])
def test_the_bound_covers_the_true_tip(change):
    q, x = true_rows(change)
    model = trained(change)
    error = lengths(model.forward(q) - x)
    assert 0.92 < np.mean(error <= model.expected_error(q)) < 0.98


def test_the_direction_pays_where_there_is_backlash():
    model = trained("elbow.backlash=0.01")
    assert model.approach is not None
    assert model.approach.play[0] == 0.0
    assert model.approach.play[1] == pytest.approx(PLAY / 2, rel=0.03)
    q, x = true_rows("elbow.backlash=0.01")
    side = calib.Samples(q, x, arm().joint_names).side
    blind = lengths(model.forward(q) - x)
    told = lengths(model.forward(q, approach=side) - x)
    assert np.nanmean(told) < 0.1 * np.nanmean(blind)
    bound = model.expected_error(q, approach=side)
    assert np.nanmean(told <= bound) > 0.92
    assert np.nanmean(bound) < 0.2 * np.nanmean(model.expected_error(q))
    # nothing is known of a joint that has not moved yet
    unknown = model.expected_error(q, approach=np.zeros_like(side))
    assert np.array_equal(unknown, model.expected_error(q), equal_nan=True)


def test_a_log_along_a_path_shows_it_and_a_shuffled_one_does_not():
    samples = calib.babble(arm(), 500)
    u = 0.5 + 0.5 * np.sin(np.arange(500)[:, None] * [0.106, 0.08] + [0.3, 1.1])
    q = samples.lower + (samples.upper - samples.lower) * u
    x = calib.Simulation(arm(), 1e-4, ["elbow.backlash=0.01"]).measure(q, np.random.default_rng(0))
    whole = calib.train(replace(samples, simulation=None, q=q, x=x, side=None), size=10)
    assert whole.approach.play[1] == pytest.approx(PLAY / 2, rel=0.05)
    assert any("backlash of elbow 0.5" in note for note in whole.about.notes)
    rows = bare(arm(), 500, 0, "elbow.backlash=0.01", noise=1e-4)
    order = np.random.default_rng(0).permutation(500)
    shuffled = replace(rows, q=rows.q[order], x=rows.x[order], side=None)
    assert calib.train(shuffled, size=10).approach is None


def test_a_log_of_few_rows_learns_the_play_of_all_joints_and_fresh_rows_are_no_alarm():
    changes = [f"{joint}.backlash=0.003" for joint in ("shoulder", "elbow", "wrist")]
    rows = bare("three_link", 90, 0, *changes, noise=1e-4)
    model = calib.train(rows.take(slice(0, 30)), size=4)
    assert model.approach.play[:2] == pytest.approx(0.0015, rel=0.1)
    assert calib.check(model, rows.take(slice(30, 90))).drifted is False


@pytest.mark.parametrize("elbow", [0.03, -0.03])
def test_a_play_below_zero_is_none(elbow):
    """Alone, the shoulder would explain the elbow's negative play as well."""
    rows, rng = bare(arm(), 400, 0), np.random.default_rng(0)
    side = rng.choice([-1.0, 1.0], (400, 1)).repeat(2, axis=1)
    play = np.array([0.01, elbow])
    x = arm().forward(rows.q - play * side) + rng.normal(0, 1e-4, (400, 2))
    approach = calib.train(replace(rows, x=x, side=side), size=5).approach
    if elbow < 0:
        assert approach is None
    else:
        assert approach.play == pytest.approx(play, rel=0.05)


@pytest.mark.parametrize("seed", [5, 9])
def test_what_a_parameter_explains_as_well_is_no_play(seed):
    """Along a path between three poses, each joint of which turned once, play was learned."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(arm().lower, arm().upper, (3, 2))
    time = np.linspace(0.0, 2.0, 600)
    q = np.stack([np.interp(time, np.arange(3), joint) for joint in poses.T], axis=1)
    offset, longer = rng.normal(0.0, 1e-3, 2), 5e-4 * rng.standard_normal()
    x = two_link(q + offset, L1 + longer, L2 - 5e-4) + rng.normal(0.0, 2e-4, q.shape)
    assert calib.train(log_of(arm(), q, x), size=4).approach is None
