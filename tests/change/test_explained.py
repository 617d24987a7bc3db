"""A log of one place after the sensor moved: as near as the model told is explained."""

import re
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


def test_positions_that_come_late_by_rows_are_found_and_corrected(sparse: calib.Model) -> None:
    rng = np.random.default_rng(2)
    places = ARM.lower + (ARM.upper - ARM.lower) * rng.uniform(0.2, 0.8, (6, 2))
    q = np.repeat(places, 8, axis=0) + rng.uniform(-0.004, 0.004, (48, 2))
    right = log(q, 3, moved=True)
    assert not any("by 2 rows" in note for note in calib.adapt(sparse, right).notes)
    late = replace(right, x=np.roll(right.x, 2, axis=0))
    for told in (calib.adapt(sparse, late).notes, calib.check(sparse, late).notes):
        found = [re.search(r"are ([\d.]+) .* rows late", note) for note in told]
        (delay,) = (float(match[1]) for match in found if match)
        assert delay == pytest.approx(2.0, abs=0.05)


def test_scattered_rows_of_one_place_explain_nothing() -> None:
    rng = np.random.default_rng(3)
    dense = calib.train(log(rng.uniform(ARM.lower, ARM.upper, (400, 2)), 4, moved=False))
    right = log(np.array([0.5, 1.2]) + rng.uniform(-0.02, 0.02, (24, 2)), 5, moved=True)
    mixed = calib.adapt(dense, replace(right, x=right.x[rng.permutation(24)]))
    assert not mixed.improved
    assert any("nothing explains the log" in note for note in mixed.notes)
