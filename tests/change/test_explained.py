"""A log of one place after the sensor moved: as near as the model told is explained."""

from dataclasses import replace

import numpy as np
import pytest

import calib

ARM = calib.load_arm("two_link")
NOISE = 1e-3
MOVED = np.array([0.3, -0.2])


def log(q: np.ndarray, seed: int, moved: bool) -> calib.Samples:
    rng = np.random.default_rng(seed)
    x = ARM.forward(q) + NOISE * rng.standard_normal((len(q), 2)) + moved * MOVED
    return replace(calib.babble(ARM, len(q), seed=seed, noise=NOISE), q=q, x=x, simulation=None)


@pytest.fixture(scope="module")
def sparse() -> calib.Model:
    rng = np.random.default_rng(0)
    return calib.train(log(rng.uniform(ARM.lower, ARM.upper, (40, 2)), 0, moved=False))


@pytest.mark.parametrize("seed", [0, 1])
def test_rows_that_span_a_few_millimetres_follow_a_moved_sensor(
    sparse: calib.Model, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    place = np.array([0.5, 1.2]) + rng.uniform(-0.006, 0.006, (24, 2))
    adapted = calib.adapt(sparse, log(place, seed, moved=True))
    assert adapted.improved
    probes = ARM.lower + (ARM.upper - ARM.lower) * rng.uniform(size=(3000, 2))
    miss = np.linalg.norm(adapted.model.forward(probes) - ARM.forward(probes) - MOVED, axis=1)
    bound = adapted.model.model_error(probes)
    known = np.isfinite(bound)
    assert np.mean(miss[known] <= bound[known]) > 0.9
