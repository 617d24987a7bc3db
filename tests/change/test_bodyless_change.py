"""`check` and `adapt` of a model that is maps and links alone: errors of the maps are no drift."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calib

ARM = calib.load_arm("two_link")
NOISE = 1e-3


def log(n: int, seed: int, change: str | None = None) -> calib.Samples:
    changes = [change] if change else []
    samples = calib.babble(ARM, n, seed=seed, noise=NOISE, changes=changes)
    return replace(samples, simulation=None)


@cache
def model() -> calib.Model:
    return calib.train(log(1500, 0), body="none", size=20)


def poses(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n, 2) joint values [rad] in one corner of the range, or along one straight path."""
    if kind == "corner":
        return ARM.lower + (ARM.upper - ARM.lower) * rng.uniform(0.75, 0.97, (n, 2))
    start, end = ARM.lower + (ARM.upper - ARM.lower) * rng.uniform(0.1, 0.9, (2, 2))
    return start + np.linspace(0.0, 1.0, n)[:, None] * (end - start)


@pytest.mark.parametrize("kind", ["corner", "path"])
@pytest.mark.parametrize("n", [30, 200])
def test_errors_that_maps_share_over_a_few_nodes_are_no_drift(kind: str, n: int) -> None:
    rng = np.random.default_rng(4)
    for seed in range(2):
        q = poses(kind, n, rng)
        x = ARM.forward(q) + NOISE * rng.standard_normal((n, 2))
        assert not calib.check(model(), replace(log(n, seed), q=q, x=x)).drifted


@pytest.mark.parametrize("change", ["sensor.rotate=0.05", "sensor.mirror=x", "elbow.length=+10%"])
def test_a_change_beyond_the_errors_of_maps_is_drift(change: str) -> None:
    assert calib.check(model(), log(200, 5, change)).drifted


def test_maps_alone_learn_from_a_stream_only() -> None:
    drift, found = (
        f(model(), log(200, 5, "sensor.rotate=0.05")) for f in (calib.check, calib.adapt)
    )
    assert not drift.adapts
    assert found.model is model()
    assert any("method 'online'" in note for note in found.notes)
