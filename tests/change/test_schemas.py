"""Schemas: states of one arm that are kept, recognised and recalled."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drifting import arm, error, log, model

import calib
from calib.change.schemas import keep, recall, recognise, schemas_of
from calib.errors import LogError, ModelError, OptionError
from calib.maps.local_models import LocalModels
from calib.model_file.storage import from_bytes, to_bytes

TOOL = "tip.offset=0.05,0"
OTHER = "tip.offset=0.03,0.02"
NOISE = 1e-3


@cache
def both():
    samples = log(TOOL, n=1500, seed=2, noise=NOISE)
    return keep(model(NOISE), calib.train(samples, size=30), "tool on")


@pytest.mark.parametrize("n", [10, 30])
def test_a_log_is_recognised_by_a_few_rows(n):
    kept = both()
    for seed in range(20):
        for changes, name in (((TOOL,), "tool on"), ((), "schema 1"), ((OTHER,), None)):
            found = recognise(kept, log(*changes, n=n, seed=50 + seed))
            assert found.name == name
            assert found.present == (name == "schema 1")
            assert found.samples == n


def test_a_wrong_detection_does_not_hide_what_fits():
    samples = log(TOOL, n=30, seed=5)
    x = samples.x.copy()
    x[7] += 0.2
    assert recognise(both(), replace(samples, x=x)).name == "tool on"


def test_what_is_recalled_is_what_was_kept():
    kept = both()
    on = recall(kept, "tool on")
    samples = log(TOOL, n=300, seed=6, noise=0.0)
    assert error(on, samples) < 1e-3 < error(kept, samples)
    gap = np.linalg.norm(on.forward(samples.q, "activity") - samples.x, axis=1)
    assert np.nanmean(gap) < 0.01
    assert (on.schema, [s.name for s in on.schemas]) == ("tool on", ["schema 1"])
    q = arm().lower + 0.5 * (arm().upper - arm().lower)
    back = recall(on, "schema 1")
    assert np.array_equal(back.forward(q), kept.forward(q))
    assert np.array_equal(back.expected_error(q), kept.expected_error(q))
    # the links of a recalled schema lead to all of its branches
    assert len(on.inverse_all(on.forward(q))[0]) == len(kept.inverse_all(kept.forward(q))[0])


def test_a_file_keeps_schemas_and_says_so_the_same_way(tmp_path):
    kept = both()
    kept.save(tmp_path / "m.calib")
    loaded = calib.load(tmp_path / "m.calib")
    assert [s.name for s in schemas_of(loaded)] == ["schema 1", "tool on"]
    samples = log(TOOL, n=50, seed=7)
    before, after = recognise(kept, samples), recognise(loaded, samples)
    assert before.name == after.name == "tool on"
    assert after.fits[0].distance == pytest.approx(before.fits[0].distance, rel=1e-4)
    u = loaded.motor.scale.to_unit(samples.q)
    told = [m.schemas[0].contradictions(u, samples.x)[2] for m in (kept, loaded)]
    assert (told[1] >= told[0] * (1 - 1e-5)).all()
    loaded.save(tmp_path / "again.calib")
    assert (tmp_path / "m.calib").read_bytes() == (tmp_path / "again.calib").read_bytes()


def test_a_file_keeps_schemas_of_maps_alone_and_of_local_models():
    first, second = (
        calib.train(log(*changes, n=500, seed=2, noise=NOISE), size=8, body="none")
        for changes in ((), (TOOL,))
    )
    models = LocalModels(
        1, 9, np.full(64, 0.1), np.random.default_rng(0).normal(0, 1e-3, (64, 3, 2)),
        gates=np.ones((64, 3)),
    )  # fmt: skip
    second = replace(second, predictor=replace(second.predictor, models=models))
    kept = keep(first, second, "tool on")
    data = to_bytes(kept)
    loaded = from_bytes(data)
    u = np.random.default_rng(1).random((50, 2))
    before, after = (m.schemas[0].predictor.value(u) for m in (kept, loaded))
    assert np.ptp(before, axis=0).min() > 0.1
    np.testing.assert_allclose(after, before, atol=1e-5)
    assert to_bytes(loaded) == data


def test_a_model_without_schemas_has_the_bytes_that_it_had(tmp_path):
    model().save(tmp_path / "m.calib")
    assert b'"schemas"' not in (tmp_path / "m.calib").read_bytes()


def test_a_file_takes_schemas_up_to_a_limit(tmp_path, monkeypatch):
    import calib.model_file.schemas as stored

    kept = keep(both(), model(NOISE), "third")
    kept.save(tmp_path / "whole.calib")
    size = (tmp_path / "whole.calib").stat().st_size
    monkeypatch.setattr(stored, "BYTES", (size - _size(model(NOISE), tmp_path)) // 3 * 2)
    kept.save(tmp_path / "part.calib")
    loaded = calib.load(tmp_path / "part.calib")
    assert [s.name for s in loaded.schemas] == ["third"]


def _size(one, folder):
    one.save(folder / "one.calib")
    return (folder / "one.calib").stat().st_size


def test_a_schema_that_makes_no_sense_is_refused():
    import calib.model_file.schemas as stored
    from calib.errors import CalibError
    from calib.model_file.checked import Tensors

    kept = both()
    described, tensors = stored.pack_schemas(kept.schemas)
    whole = stored.unpack_schemas(kept, described, Tensors(tensors))
    assert whole[0].name == "tool on"
    wrong = {
        "name": [dict(described[0], name="a\nb")],
        "twice": [dict(described[0], name=kept.schema)],
        "bounds": [dict(described[0], bound_of="nothing")],
        "smooth": [dict(described[0], smooth={"body": None, "trend": None})],
    }
    for states in wrong.values():
        with pytest.raises(CalibError, match=r"schema|body"):
            stored.unpack_schemas(kept, states, Tensors(tensors))
    nan = dict(tensors)
    nan["schema.0.bounds"] = np.full_like(tensors["schema.0.bounds"], np.nan)
    with pytest.raises(CalibError, match="not finite"):
        stored.unpack_schemas(kept, described, Tensors(nan))
    short = dict(tensors)
    short["schema.0.sensory"] = tensors["schema.0.sensory"][:-1]
    with pytest.raises(CalibError, match="expected"):
        stored.unpack_schemas(kept, described, Tensors(short))


def test_a_damaged_file_is_an_error(tmp_path):
    both().save(tmp_path / "m.calib")
    data = bytearray((tmp_path / "m.calib").read_bytes())
    data[-20] ^= 1
    (tmp_path / "m.calib").write_bytes(data)
    with pytest.raises(ModelError):
        calib.load(tmp_path / "m.calib")


def test_states_of_another_arm_or_another_size_are_refused():
    kept = both()
    three = calib.train(calib.babble(calib.load_arm("three_link"), 500), size=5)
    with pytest.raises(OptionError, match="joints"):
        keep(kept, three, "other")
    with pytest.raises(OptionError, match="ranges, units or maps"):
        keep(kept, calib.train(calib.babble(arm(), 500), size=8), "small")
    with pytest.raises(OptionError, match="present"):
        keep(kept, model(NOISE), "schema 1")
    with pytest.raises(OptionError, match="printable"):
        keep(kept, model(NOISE), "a\tb")
    with pytest.raises(OptionError, match="unknown"):
        recall(kept, "tool off")
    with pytest.raises(LogError, match="same arm"):
        recognise(kept, calib.babble(calib.load_arm("three_link"), 20))


def test_the_oldest_schemas_are_dropped_first():
    kept = model(NOISE)
    for name in ("a", "b", "c"):
        kept = keep(kept, model(NOISE), name, most=3)
    assert [s.name for s in kept.schemas] == ["c", "b"]
