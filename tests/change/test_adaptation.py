"""Few-shot adaptation: facts about what few samples are enough for."""

from dataclasses import replace

import numpy as np
import pytest
from drifting import arm, error, log, model

import calib

CHANGES = {
    "link": ("elbow.length=+20%",),
    "links": ("shoulder.length=-10%", "elbow.length=-20%"),
    "camera": ("sensor.rotate=0.14", "sensor.shift=0.03,0", "sensor.scale=1.05"),
    "encoders": ("shoulder.offset=0.0524", "elbow.offset=-0.0349"),
    "mirror": ("sensor.mirror=x",),
}


@pytest.mark.parametrize("name", CHANGES)
def test_thirty_exact_samples(name):
    samples = log(*CHANGES[name], n=30, noise=0.0)
    assert error(model(), samples) > 0.01
    assert error(calib.adapt(model(), samples).model, samples) < 2e-5


def test_a_bent_frame():
    samples = log(n=100, noise=0.0)

    def bent(x):
        away = x - np.array([0.2, 0.25])
        return x + 0.8 * np.sum(away**2, axis=1, keepdims=True) * away

    seen = replace(samples, x=bent(samples.x), simulation=None)
    found = calib.adapt(model(), seen)
    q = np.random.default_rng(3).uniform(arm().lower, arm().upper, (500, 2))
    truth = bent(samples.simulation.exact(q))
    assert np.linalg.norm(found.model.forward(q) - truth, axis=1).mean() < 2e-5
    assert "lens" in found.correction
    assert "lens" in [c.cause for c in found.changed]


def test_a_tilted_camera_that_reads_pixels():
    """The tilt was sized by the log's unit, not the chain's: 1 mm off, and 72 % covered."""
    samples = log(n=100, noise=0.0)

    def pixels(x):
        away = x - np.array([0.15, 0.25])
        depth = 1.2 + np.sin(0.35) * away[:, 1]
        return 900.0 * away * np.array([1.0, -np.cos(0.35)]) / depth[:, None]

    seen = replace(samples, x=pixels(samples.x), simulation=None, unit="px")
    found = calib.adapt(model(), seen).model
    q = np.random.default_rng(3).uniform(arm().lower, arm().upper, (500, 2))
    miss = np.linalg.norm(found.forward(q) - pixels(samples.simulation.exact(q)), axis=1)
    assert miss.mean() < 0.01
    assert np.mean(miss <= found.model_error(q)) > 0.95


@pytest.mark.parametrize("readout", ["activity", "winner"])
def test_the_maps_follow_too(readout):
    samples = log("elbow.length=+20%", n=100, noise=0.0)
    adapted = calib.adapt(model(), samples).model
    q = np.random.default_rng(7).uniform(arm().lower, arm().upper, (500, 2))
    gap = np.linalg.norm(adapted.forward(q, readout) - samples.simulation.exact(q), axis=1)
    assert gap.mean() < 0.025
    x = samples.simulation.exact(q)
    assert np.nanmax(np.abs(adapted.inverse(x, near=q) - q)) < 1e-6


@pytest.mark.parametrize(
    ("change", "words"),
    [("sensor.scale=1000", "1000 times the model's.*unit='mm'"), ("sensor.mirror=y", "mirrored")],
)
def test_what_must_be_said_aloud(change, words):
    found = calib.adapt(model(), log(change, n=60, noise=0.0))
    import re

    assert any(re.search(words, note) for note in found.notes)
    assert found.improved


TOGETHER = ("elbow.length=+3%", "elbow.offset=0.02")


@pytest.mark.parametrize("seed", [1, 7])
def test_rows_of_an_unchanged_arm_are_added_where_few_were_known(seed):
    two = calib.load_arm("two_link")
    few, more, exact = (
        calib.babble(two, n, seed=seed + k, noise=s, changes=TOGETHER)
        for k, n, s in ((0, 12, 5e-4), (1, 40, 5e-4), (2, 300, 0.0))
    )
    model = calib.train(replace(few, simulation=None), size=6)
    made = calib.adapt(model, more)
    assert made.correction == "nothing changed, rows added"
    assert error(made.model, exact) < 0.7 * error(model, exact)


def test_history_is_kept_inside(tmp_path):
    once = calib.adapt(model(), log("elbow.length=+20%", n=60)).model
    twice = calib.adapt(once, log("elbow.length=-20%", n=60)).model
    assert model().history == ()
    assert len(twice.history) == 2
    assert twice.history[0] == once.history[0]
    assert twice.history[0]["from"]["source"] == "simulation"
    twice.save(tmp_path / "m.calib")
    assert calib.load(tmp_path / "m.calib").history == twice.history
