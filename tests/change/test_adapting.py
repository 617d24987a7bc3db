"""What adaptation reports and stores, on small maps that imagine few samples."""

import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from models import babbled as log
from models import trained

import calib

pytestmark = pytest.mark.usefixtures("one_blas_thread")


model = partial(trained, n=2500, size=10)


def moved(found, samples):
    """Mean distance from the positions of other joints that is left, over what there was."""
    fresh = samples.simulation
    q = np.random.default_rng(8).uniform(model().about.lower, model().about.upper, (400, 2))
    x = fresh.exact(q)
    return [np.linalg.norm(m.forward(q) - x, axis=1).mean() for m in (model(), found.model)]


def test_the_report_of_a_few_samples_is_what_was_measured():
    samples, told = log("elbow.length=+20%"), []
    found = calib.adapt(model(), samples, progress=lambda *part: told.append(part))
    gap = np.linalg.norm(model().forward(samples.q) - samples.x, axis=1)
    assert found.improved
    assert (found.samples, found.outliers) == (60, 0)
    assert "length" in found.correction
    assert found.before["mean"] == pytest.approx(gap.mean(), rel=1e-6)
    assert found.before["max"] == pytest.approx(gap.max(), rel=1e-6)
    assert found.after["max"] < 1e-5
    before, after = moved(found, samples)
    assert after < 1e-4 * before
    # told in order: shares of the work, stages by name, errors as numbers
    shares = [share for share, _, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert all(isinstance(error, float) for *_, error in told)


def test_what_is_known_of_an_adapted_model():
    samples = replace(log("elbow.length=+20%", noise=2e-4), unit="m")
    found = calib.adapt(model(), samples)
    fresh, about = found.model, found.model.about
    assert (about.source, about.bound_of, about.samples) == ("log", "sensor reading", 60)
    assert about.simulation is None
    assert about.unit == "m"
    assert about.notes == found.notes
    assert about.errors["local"]["forward"]["distance"] == found.after
    (event,) = fresh.history
    assert (event["event"], event["method"], event["samples"]) == ("adapted", "few-shot", 60)
    assert (event["before"], event["after"]) == (found.before, found.after)
    assert event["from"]["samples"] == 2500
    # a bound for every place that the old model knew, and it holds
    other = log("elbow.length=+20%", n=300, noise=2e-4, seed=5)
    miss = np.linalg.norm(fresh.forward(other.q) - other.x, axis=1)
    bound = fresh.expected_error(other.q)
    assert np.isfinite(bound).all()
    assert np.mean(miss <= bound) >= 0.9
    assert bound.max() < 3e-3
    assert not calib.check(fresh, other).drifted


def test_wrong_detections_are_counted_and_left_out():
    samples = log("elbow.length=+20%")
    wrong = samples.x.copy()
    wrong[[7, 31]] += 0.15
    found = calib.adapt(model(), replace(samples, x=wrong))
    assert (found.samples, found.outliers) == (58, 2)
    assert any("contradict" in note and "rows 8, 32" in note for note in found.notes)
    assert found.model.history[0]["outliers"] == 2
    assert moved(found, samples)[1] < 1e-3
    one = samples.x.copy()
    one[7] += 0.15
    single = calib.adapt(model(), replace(samples, x=one))
    assert any("contradict" in note and "row 8" in note for note in single.notes)
    none = calib.adapt(model(), samples)
    assert not any("contradict" in note for note in none.notes)


@pytest.mark.parametrize(
    ("scale", "unit", "expected"), [(1000.0, "m", "sensor"), (1.1, "m", "m"), (1000.0, "mm", "mm")]
)
def test_the_unit_is_the_logs_or_the_sensors_own(scale, unit, expected):
    samples = log()
    found = calib.adapt(model(), replace(samples, x=scale * samples.x, simulation=None, unit=unit))
    assert found.improved
    assert found.model.about.unit == expected


def test_a_model_that_misses_its_rows_by_more_than_promised_is_not_written(monkeypatch):
    module = sys.modules[calib.adapt.__module__]
    strict = replace(module.ADAPTING, consistent=0.0, clearly_better=0.0)
    monkeypatch.setattr(module, "ADAPTING", strict)
    found = calib.adapt(model(), log("elbow.length=+20%", noise=2e-4))
    assert not found.improved
    assert any("more than promised" in note for note in found.notes)
