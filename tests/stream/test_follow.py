"""Maps that follow a stream: the online rule, its schedules, and what it stores."""

from functools import partial

import numpy as np
import pytest
from models import babbled as log
from models import trained
from small_maps import UNIT_BOX

import calib
from calib.maps.lattice import Lattice
from calib.maps.model_selection import blocks
from calib.stream.follow import BLOCK, OnlineAdapter, matching_sigma


@pytest.fixture(autouse=True)
def _brief(monkeypatch, one_blas_thread):
    monkeypatch.setattr("calib.change.adapt.HORIZON", 1500)


model = partial(trained, n=2500, size=10)


def test_the_report_of_the_online_rule_is_of_blocks_that_it_never_saw():
    samples, told = log("elbow.length=+20%", n=700), []
    found = calib.adapt(model(), samples, method="online", progress=lambda *part: told.append(part))
    assert found.improved
    assert found.correction == "maps and Hebbian links trained online"
    held = np.concatenate(blocks(700, 10)[4::10])
    gap = np.linalg.norm(model().forward(samples.q) - samples.x, axis=1)[held]
    assert found.before["mean"] == pytest.approx(gap.mean(), rel=1e-6)
    now = np.linalg.norm(found.model.forward(samples.q) - samples.x, axis=1)[held]
    assert found.after["mean"] == pytest.approx(now.mean(), rel=1e-6)
    assert found.after["mean"] < 0.05 * found.before["mean"]
    event = found.model.history[0]
    assert (event["method"], event["samples"], event["frame"]) == ("online", 700, None)
    assert f"{700 - len(held)} samples were shown 3 times" in found.notes
    assert [share for share, _, _ in told] == pytest.approx(
        [0.9 * 630 / 1500, 0.9 * 1260 / 1500, 0.9]
    )
    assert {stage for _, stage, _ in told} == {"online"}
    assert all(error > 0 for *_, error in told)


def test_schedules_are_equations_10_and_12():
    samples = log("elbow.length=+20%", n=1000)
    adapter = OnlineAdapter(model(), 800, force=True)
    steps = [
        adapter.feed(samples.q[k : k + BLOCK], samples.x[k : k + BLOCK])
        for k in range(0, 1000, BLOCK)
    ]
    assert [s.samples for s in steps] == list(range(BLOCK, 1001, BLOCK))
    t = np.minimum(np.arange(BLOCK - 1, 1000, BLOCK), 800)
    np.testing.assert_allclose([s.beta for s in steps], np.exp(1 - t / 800))
    np.testing.assert_allclose([s.eta for s in steps], 0.13 * np.exp(1 - t / 800))
    sigma = np.array([s.sigma for s in steps])
    # a geometric decay to half a node at the horizon
    start = np.exp(np.log(sigma[0] / 0.5) / (1 - t[0] / 800)) * 0.5
    np.testing.assert_allclose(sigma, start * (0.5 / start) ** (t / 800))
    assert start > 0.5
    assert all(s.adapting for s in steps)


def test_distortion_is_the_running_mean_of_equation_9():
    samples = log(n=300, noise=1e-3)
    adapter = OnlineAdapter(model())
    motor, sensory = model().motor, model().sensory
    mean = None
    for k in range(0, 300, BLOCK):
        q, x = samples.q[k : k + BLOCK], samples.x[k : k + BLOCK]
        step = adapter.feed(q, x)
        now = np.array(
            [
                np.mean(motor.nearest(motor.scale.to_unit(q))[0] ** 2),
                np.mean(sensory.nearest(sensory.scale.to_unit(x))[0] ** 2),
                np.linalg.norm(model().forward(q[::5], "activity") - x[::5], axis=1).mean(),
            ]
        )
        mean = now if mean is None else 0.5 * mean + 0.5 * now
        said = [step.zeta_motor, step.zeta_sensory, step.error]
        np.testing.assert_allclose(said, mean, rtol=1e-3)
        assert not step.adapting
        assert (step.sigma, step.eta, step.beta) == (0.0, 0.0, 0.0)
    assert adapter.model() is model()


def test_a_short_stream_is_learned_and_its_nodes_are_those_that_were_visited():
    samples = log("elbow.length=+20%", n=400)
    adapter = OnlineAdapter(model(), 400, force=True)
    adapter.feed(samples.q, samples.x)
    twice = OnlineAdapter(model(), 400, force=True)
    twice._q, twice._x, twice._since = [samples.q] * 2, [samples.x] * 2, 0
    fresh = adapter.model()
    q = log(n=100, seed=6).q
    truth = samples.simulation.exact(q)
    assert np.linalg.norm(fresh.forward(q) - truth, axis=1).mean() < 1e-4
    # rows that are shown again count once
    np.testing.assert_allclose(twice.model().forward(q), fresh.forward(q), atol=1e-4)
    assert fresh.visited[fresh.motor.winners(samples.q)].all()
    assert fresh.links.shape == model().links.shape


def trained_like(*history, shape=(30, 30)):
    lattice = Lattice(shape)
    units = np.zeros((lattice.size, 2))
    return calib.Map(units, lattice, UNIT_BOX, np.array([(*row, 0.0) for row in history]))


def test_between_two_epochs_the_radius_is_interpolated_geometrically():
    network = trained_like((900, 8.0, 0.5), (900, 4.0, 0.4), (900, 1.0, 0.2), (900, 0.5, 0.05))
    # after a radius of 8 the error was 0.4, after 4 it was 0.2, after 1 it was 0.05
    assert matching_sigma(network, 0.3) == pytest.approx(8.0 * 0.5**0.5)
    assert matching_sigma(network, 0.35) == pytest.approx(8.0 * 0.5**0.25)
    assert matching_sigma(network, 0.125) == pytest.approx(4.0 * 0.25**0.5)
    assert matching_sigma(network, 0.05) == pytest.approx(1.0)
    assert matching_sigma(network, 0.4) == pytest.approx(8.0)
    assert matching_sigma(network, 0.41) == 15.0
