"""Streams: maps that follow one (eq. 9 to 12), and the monitor, one sample at a time."""

from dataclasses import replace
from functools import cache, partial

import models
import numpy as np
import pytest
from conftest import refused
from models import arm, babbled, error, lengths, model, trained, two_link
from reference import random_joints
from small_maps import UNIT_BOX

import calib
from calib.maps.lattice import Graph, Lattice
from calib.maps.model_selection import blocks
from calib.stream.follow import OnlineAdapter, matching_sigma

small = partial(trained, n=2500, size=10)
CHANGES = ["shoulder.length=-5%", "elbow.offset=0.0174", "sensor.rotate=0.0174", "elbow.lock=1.0"]


def test_the_report_of_the_online_rule_is_of_blocks_that_it_never_saw(monkeypatch):
    monkeypatch.setattr("calib.change.adapt.HORIZON", 1500)
    samples, told = babbled("elbow.length=+20%", n=700, noise=0.0), []
    found = calib.adapt(small(), samples, method="online", progress=lambda *part: told.append(part))
    assert found.improved
    assert found.correction == "maps and Hebbian links trained online"
    held = np.concatenate(blocks(700, 10)[4::10])
    for one, figures in ((small(), found.before), (found.model, found.after)):
        gap = lengths(one.forward(samples.q) - samples.x)[held]
        assert figures["mean"] == pytest.approx(gap.mean(), rel=1e-6)
    assert found.after["mean"] < 0.05 * found.before["mean"]
    event = found.model.history[0]
    assert (event["method"], event["samples"], event["frame"]) == ("online", 700, None)
    assert f"{700 - len(held)} samples were shown 3 times" in found.notes
    shares = [0.9 * 630 / 1500, 0.9 * 1260 / 1500, 0.9]
    (_, first, _), *shown = told
    assert first == "causes"
    assert [share for share, _, _ in shown] == pytest.approx(shares)
    assert {stage for _, stage, _ in shown} == {"online"}
    assert all(error > 0 for *_, error in shown)


def followed(one, samples, horizon):
    pairs = list(calib.follow(one, samples.q, samples.x, horizon=horizon))
    return [step for step, _ in pairs], pairs[-1][1]


def test_schedules_are_equations_10_and_12():
    """From the first change on rates fall by the same factors each step, to rest at the horizon."""
    steps, _ = followed(small(), babbled("elbow.length=+20%", n=1500, noise=0.0), 800)
    size = steps[0].samples
    assert [step.samples for step in steps] == list(range(size, 1501, size))
    first = next(k for k, step in enumerate(steps) if step.adapting)
    adapting = steps[first:]
    t = np.minimum(size * np.arange(1, len(adapting) + 1) - 1, 800)
    assert t[-2] == t[-1] == 800
    beta, eta, sigma = np.transpose([(step.beta, step.eta, step.sigma) for step in adapting])
    np.testing.assert_allclose(beta, np.exp(1 - t / 800))
    np.testing.assert_allclose(eta, 0.13 * np.exp(1 - t / 800))
    # a geometric decay to half a node at the horizon
    start = np.exp(np.log(sigma[0] / 0.5) / (1 - t[0] / 800)) * 0.5
    np.testing.assert_allclose(sigma, start * (0.5 / start) ** (t / 800))
    assert start > 0.5
    # the threshold grows with the lattice
    steps, _ = followed(small(), babbled("sensor.scale=1.5", n=1500, noise=0.0), 800)
    assert steps[-1].threshold > 2.0 * steps[0].threshold


def test_distortion_is_the_running_mean_of_equation_9_and_a_calm_stream_changes_nothing():
    samples = babbled(n=300, noise=1e-3)
    steps, adapter = followed(small(), samples, 1500)
    motor, sensory, mean = small().motor, small().sensory, None
    size = steps[0].samples
    for k, step in enumerate(steps):
        q, x = (values[size * k : size * (k + 1)] for values in (samples.q, samples.x))
        now = np.array([
            np.mean(motor.nearest(motor.scale.to_unit(q))[0] ** 2),
            np.mean(sensory.nearest(sensory.scale.to_unit(x))[0] ** 2),
            lengths(small().forward(q[::5], "activity") - x[::5]).mean(),
        ])  # fmt: skip
        mean = now if mean is None else 0.5 * mean + 0.5 * now
        told = [step.zeta_motor, step.zeta_sensory, step.error]
        np.testing.assert_allclose(told, mean, rtol=1e-3)
        assert (step.adapting, step.sigma, step.eta, step.beta) == (False, 0.0, 0.0, 0.0)
    assert adapter.model() is small()


@pytest.mark.parametrize(("path", "late"), [(True, 0), (False, 0), (True, 1)])
def test_a_calm_stream_is_no_change_to_a_model_of_few_rows(path, late):
    """Maps lie where those rows do; on a path distortions are others, and positions may be late."""
    samples = models.log(1000, noise=1e-3, seed=4)
    if path:
        swing = 0.5 - 0.5 * np.cos(np.arange(1000)[:, None] / np.array([40.0, 57.0]))
        q = samples.lower + swing * (samples.upper - samples.lower)
        away = samples.x - two_link(samples.q)
        samples = replace(samples, q=q, x=two_link(np.roll(q, late, axis=0)) + away)
    one = models.measured(300, size=None)
    assert not any(step.adapting for step in followed(one, samples, 1500)[0])
    told = states(calib.monitor(one), samples.take(slice(300)))
    assert not any(state.drifted for state in told)
    assert told[-1].delay == pytest.approx(late, abs=0.1)


@pytest.mark.parametrize("offset", [0.0, 0.003, 0.1])
def test_maps_too_coarse_for_many_joints_follow_what_a_bound_tells(offset):
    one = calib.train(models.bare("spatial_three", 60, 0), size=2)
    samples = models.bare("spatial_three", 200, 5, f"elbow.offset={offset}")
    assert followed(one, samples, 1500)[0][0].adapting == (offset > 0.0)


def test_between_two_epochs_the_radius_is_interpolated_geometrically():
    history = [(900, 8.0, 0.5, 0), (900, 4.0, 0.4, 0), (900, 1.0, 0.2, 0), (900, 0.5, 0.05, 0)]
    network = calib.Map(np.zeros((900, 2)), Lattice((30, 30)), UNIT_BOX, np.array(history))
    # after a radius of 8 the error was 0.4, after 4 it was 0.2, after 1 it was 0.05
    sigmas = [matching_sigma(network, error) for error in (0.41, 0.4, 0.35, 0.3, 0.125, 0.05)]
    assert sigmas[0] == 15.0
    assert sigmas[1:] == pytest.approx([8.0, 8.0 * 0.5**0.25, 8.0 * 0.5**0.5, 4.0 * 0.25**0.5, 1.0])


def test_distortion_falls_back_under_its_threshold():
    change = "elbow.length=+20%"
    samples = babbled(change, n=3500, seed=3, noise=0.0)
    steps, adapter = followed(model(), samples, 3000)
    assert steps[1].adapting
    assert steps[0].zeta_sensory > steps[0].threshold
    assert steps[-1].zeta_sensory < steps[-1].threshold
    fresh = calib.train(babbled(change, n=4000, seed=2, noise=0.0), size=30)
    q = random_joints(arm(), 1000, seed=7)
    truth = samples.simulation.exact(q)
    both = adapter.model(), fresh
    for readout, factor in (("local", 1.2), ("activity", 2.0)):
        after, best = (lengths(one.forward(q, readout) - truth).mean() for one in both)
        assert after < factor * best + 1e-6
    assert error(adapter.model(), samples) < 1e-5


def test_a_short_stream_links_maps_by_what_its_body_predicts():
    samples = babbled("elbow.length=-20%", n=700, seed=3, noise=0.0)
    adapted = followed(model(), samples, 3000)[1].model()
    q = random_joints(arm(), 1000, seed=7)
    off = adapted.forward(q, "activity") - samples.simulation.exact(q)
    assert lengths(off).mean() < 7.5e-3
    assert 0.3 < adapted.visited.mean() < 0.9
    # a change that stays inside of the map is noticed by the links
    assert followed(model(), babbled("sensor.mirror=x", n=600, seed=3, noise=0.0), 3000)[1].adapting


def test_rows_from_before_a_change_within_a_block_are_not_learned():
    before, after = babbled(n=700, noise=0.0), babbled("elbow.length=+20%", n=700, noise=0.0)
    x = np.where(np.arange(700)[:, None] < 150, before.x, after.x)
    steps, adapter = followed(small(), replace(before, x=x), 800)
    assert [step.adapting for step in steps[:2]] == [False, True]
    assert np.abs(adapter.model().forward(after.q) - after.x).max() < 1e-9


def test_what_cannot_be_followed_is_told():
    for words, changes in (
        ("growing neural gas has neither", {"lattice": Graph(2, np.array([[0, 1]]))}),
        ("few-shot", {"units": np.zeros((10**6, 2))}),
    ):
        association = replace(model().association, sensory=replace(model().sensory, **changes))
        refused(calib.OptionError, words, OnlineAdapter, replace(model(), association=association))
    refused(calib.OptionError, "horizon 0", OnlineAdapter, model(), 0)
    none = np.zeros((0, 2))
    refused(calib.OptionError, "no samples", OnlineAdapter(model()).feed, none, none)


def states(monitor, samples):
    return [monitor.update(*sample) for sample in zip(samples.q, samples.x, strict=True)]


def alarmed(monitor, samples):
    return any(state.drifted for state in states(monitor, samples))


@pytest.mark.parametrize(("trained_noise", "noise"), [(0.0, 2e-3), (1e-3, 1e-3), (1e-3, 2e-3)])
@pytest.mark.parametrize("changes", [(), ("sensor.outliers=0.02",)])
def test_a_calm_stream_raises_no_alarm(trained_noise, noise, changes):
    assert not alarmed(calib.monitor(model(trained_noise)), babbled(*changes, n=1000, noise=noise))


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_within_a_stream(change):
    """Three wrong detections before it raise no alarm, and hide none."""
    monitor, calm = calib.monitor(model(1e-3)), babbled(n=300)
    x = calm.x.copy()
    x[[20, 90, 150]] += 100.0
    assert not alarmed(monitor, replace(calm, x=x))
    assert alarmed(monitor, babbled(change, n=200, seed=2))


@pytest.mark.parametrize("offset", [0.0, 0.005])
def test_noise_that_drifts_slowly_is_no_change_and_hides_none(offset):
    samples = babbled(f"elbow.offset={offset}", n=200, noise=0.0)
    drift = np.random.default_rng(0).normal(0.0, 1e-3, (200, 2))
    for k in range(1, 200):
        drift[k] = 0.98 * drift[k - 1] + np.sqrt(1.0 - 0.98**2) * drift[k]
    noisy = replace(samples, x=samples.x + drift)
    assert alarmed(calib.monitor(model(1e-3)), noisy) == (offset > 0.0)


def rippled(q, seed, offset=0.0):
    """Rows of an arm whose errors differ from pose to pose by more than the readings of one."""
    ripple = 3e-4 * np.sin(np.array([37.0, 41.0]) * q + 29.0 * q[:, ::-1])
    noise = np.random.default_rng(seed).normal(0.0, 5e-5, q.shape)
    return models.log_of(arm(), q, two_link(q + np.array([0.0, offset])) + ripple + noise)


@cache
def of_ripples(times):
    """Return a model of 150 poses, each read so many times."""
    q = np.random.default_rng(1).uniform(arm().lower, arm().upper, (150, 2))
    return calib.train(rippled(np.repeat(q, times, axis=0), 2), size=10)


@pytest.mark.parametrize(("times", "wrong", "late"), [(1, 0.0, 0), (1, 0.0, 1), (2, 0.02, 0)])
@pytest.mark.parametrize("offset", [0.0, 0.005])
def test_an_arm_that_dwells_shows_its_models_error_once(offset, times, wrong, late):
    """Wrong detections of 1 in 20, and of each pose's first, hide no change, nor a late clock."""
    rng = np.random.default_rng(3)
    goals = rng.uniform(arm().lower, arm().upper, (15, 2))
    q = np.repeat(goals, 40, axis=0) + rng.normal(0.0, 1e-4, (600, 2))
    samples, monitor = rippled(q, 4, offset), calib.monitor(of_ripples(times))
    is_wrong = rng.random(600) < 0.05
    is_wrong[::40] = True
    x = samples.x + is_wrong[:, None] * rng.normal(0.0, wrong, (600, 2))
    late_samples = replace(samples, q=q[late:], x=x[: 600 - late], side=None)
    assert alarmed(monitor, late_samples) == (offset > 0.0)
    assert monitor.state.delay == pytest.approx(late, abs=0.1)


def test_a_tenth_of_a_degree_at_a_millimetre_of_noise_is_an_alarm_until_it_is_undone():
    monitor = calib.monitor(model(1e-3))
    assert states(monitor, babbled("elbow.offset=0.0017", n=600, seed=0))[-1].drifted
    calm = states(monitor, babbled(n=1000, seed=3))[-1]
    assert not calm.drifted
    # samples that say nothing change nothing
    for q in ([np.nan, 1.0], [9.0, 1.0]):
        assert monitor.update(q, [0.1, 0.1]) == calm


@pytest.mark.parametrize("changes", [(), ("sensor.shift=0.01,0",)])
def test_noise_is_told_apart_from_a_change(changes):
    state = states(calib.monitor(model()), babbled(*changes, n=600, noise=2e-3))[-1]
    assert state.noise == pytest.approx(2e-3, rel=0.15)
