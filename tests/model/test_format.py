"""The model format: what the page says is enough to read a file, and old files stay readable."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from models import draw, log, measured, no_arm, trained, turning
from safetensors import safe_open

import calib
from calib.body.basis import Basis
from calib.body.trend import Trend
from calib.maps.predictor import Both
from calib.model_file.storage import FORMAT, to_bytes

HERE = Path(__file__).parents[1]
PAGE = (HERE.parent / "docs" / "format.md").read_text(encoding="utf-8")
KEPT = {n: HERE / "data" / f"model-format-{n}.calib" for n in (1, 2)}
"""A model of each format, written by the first package that had it."""
ANSWERS = {n: json.loads(p.with_suffix(".json").read_text("utf-8")) for n, p in KEPT.items()}


def reader():
    """The names that the page's reader defines."""
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict = {}
    exec(compile(code, "docs/format.md", "exec"), names)
    assert "import calib" not in code
    return names


def mirrored(view="rigid"):
    """A slide and a turn in millimetres, seen from behind."""
    arm = calib.load_arm("polar")
    s = calib.babble(arm, 120, seed=1, changes=["sensor.mirror=x"])
    x = 1e3 * s.x + np.random.default_rng(2).normal(scale=0.1, size=s.x.shape)
    return calib.train(replace(s, x=x, unit="mm", simulation=None), size=6, view=view)


def freed():
    """A planar body whose every parameter is off its neutral value."""
    model = calib.load(KEPT[2])
    rng = np.random.default_rng(6)
    beta = model.body.beta * (1 + 0.05 * rng.standard_normal(len(model.body.beta)))
    beta += 1e-4 * rng.standard_normal(len(beta))
    body = replace(model.body, beta=beta)
    smooth = replace(model.predictor.smooth, body=body)
    return replace(model, body=body, predictor=replace(model.predictor, smooth=smooth))


def of_both():
    """A body, a trend of what it leaves over, and local models."""
    model = calib.load(KEPT[2])
    basis = Basis((1.5, 0.0), 2, 0)
    trend = Trend(basis, np.random.default_rng(0).standard_normal((len(basis.orders), 2)))
    smooth = Both(model.predictor.smooth, trend)
    return replace(model, predictor=replace(model.predictor, smooth=smooth))


def gated():
    """Local models that end at lines."""
    model = made("of no arm")
    models = model.predictor.models
    gates = np.random.default_rng(0).standard_normal((len(models.radius), 3))
    predictor = replace(model.predictor, models=replace(models, gates=gates))
    return replace(model, predictor=predictor)


MODELS = {
    "of format 1": lambda: calib.load(KEPT[1]),
    "of format 2": lambda: calib.load(KEPT[2]),
    "of freed parameters": freed,
    "mirrored, in millimetres": mirrored,
    "in the robot's root frame": lambda: calib.train(log(60, 1e-3), size=6, view="base"),
    "of no arm": lambda: calib.train(no_arm(200), size=6),
    "of gates": gated,
    "of a body and a trend": of_both,
    "with noise": lambda: trained("two_link", 800, 8, noise=1e-3),
    "of a log": lambda: measured(150, 5),
    "of three joints": lambda: trained("three_link", 800, 6),
    "with a slide": lambda: trained("polar", 800, 8),
    "with a joint that turns round": turning,
    "of few rows": lambda: calib.train(log(30, 1e-3), size=6),
    "of a growing neural gas": lambda: trained("two_link", 300, 5, map="gng"),
}


@cache
def made(kind):
    return MODELS[kind]()


@pytest.mark.parametrize("kind", MODELS)
def test_the_reader_of_the_page_agrees_with_the_model(kind, tmp_path):
    model = made(kind)
    path = tmp_path / "m.calib"
    model.save(path)
    forward = reader()["forward"]
    q = draw(model, 20, seed=2)
    expected = model.forward(q, "local")
    known = np.isfinite(expected[:, 0])
    assert known.sum() >= 5
    extent = np.linalg.norm(np.ptp(expected[known], axis=0))
    said = [forward(path, row) for row in q[known]]
    np.testing.assert_allclose(said, expected[known], atol=1e-9 * max(1.0, extent))


def test_the_reader_reads_every_part_of_a_model():
    """Else parts of the reader would never run."""
    assert calib.load(KEPT[1]).predictor.models.degree == ANSWERS[1]["local_degree"] == 2
    kept = calib.load(KEPT[2])
    assert kept.predictor.models.degree == ANSWERS[2]["local_degree"] == 5
    assert kept.predictor.models.fades
    groups = kept.body.structure.groups
    for name in ("view.tilt", "lens", "curve.0", "curve.1"):
        assert kept.body.beta[groups[name]].all(), name
    assert made("of freed parameters").body.beta.all()
    slides = made("mirrored, in millimetres").body.structure
    assert slides.revolute == (True, False)
    assert (slides.mirror, slides.metre) == (-1, 1000.0)
    assert made("in the robot's root frame").body.structure.view == "base"
    assert isinstance(made("of no arm").predictor.smooth, Trend)


def test_the_reader_refuses_what_the_page_does_not_describe(tmp_path):
    path = tmp_path / "m.calib"
    calib.train(log(100, 1e-3), size=5, body="none").save(path)
    with pytest.raises(ValueError, match="planar bodies and trends"):
        reader()["forward"](path, [0.5, 1.0])


@pytest.mark.parametrize("kind", MODELS)
def test_every_tensor_and_every_key_is_on_the_page(kind, tmp_path):
    path = tmp_path / "m.calib"
    made(kind).save(path)
    with safe_open(path, framework="np") as file:
        names, metadata = set(file.keys()), file.metadata()
    told = set(re.findall(r"`([a-z0-9_.*]+)`", PAGE))
    starred = {name[2:] for name in told if name.startswith("*.")}
    assert {n for n in names if n not in told and n.partition(".")[2] not in starred} == set()
    said = json.loads(metadata["calib"])
    assert set(said) <= told
    assert set(said["about"]) <= told
    for key in ("smooth", "local", "links"):
        assert set(said[key]) <= told
    body = said["smooth"]["body"]
    if body is not None:
        assert set(body) <= told
        assert set(body["structure"]) <= told
        assert set(body["structure"]["nominal"] or ()) <= told
    assert set(said["smooth"]["trend"] or ()) <= told


@pytest.mark.parametrize("version", KEPT)
def test_the_checksum_is_as_the_page_says(version):
    with safe_open(KEPT[version], framework="np") as file:
        said = json.loads(file.metadata()["calib"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    digest = hashlib.sha256()
    for name in sorted(tensors):
        a = tensors[name]
        digest.update(f"{name} {a.dtype.str} {a.shape};".encode() + a.tobytes())
    stated = said.pop("sha256")
    canonical = json.dumps(said, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    digest.update(canonical.encode())
    assert digest.hexdigest() == stated


@pytest.mark.parametrize("version", KEPT)
def test_a_kept_model_loads_and_answers_as_it_did(version):
    model, answers = calib.load(KEPT[version]), ANSWERS[version]
    q, x = np.array(answers["q"]), np.array(answers["x"])
    size = 1.0 if version == 1 else 1e3  # metres, pixels
    for readout, said in answers["forward"].items():
        np.testing.assert_allclose(model.forward(q, readout), said, rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(model.expected_error(q), answers["expected_error"], rtol=1e-9)
    bound = answers.get("model_error", answers["expected_error"])
    np.testing.assert_allclose(model.model_error(q), bound, rtol=1e-9)
    found, told = model.inverse(x, near=q), np.array(answers["inverse"])
    assert (np.isnan(found) == np.isnan(told)).all()
    np.testing.assert_allclose(found, told, rtol=1e-7, atol=1e-9)
    assert (model.about.samples, model.about.seed) == ({1: 900, 2: 400}[version], 3)
    assert (model.body is None) == (version == 1)
    if model.body is not None:
        assert model.body.member == answers["member"]


def test_an_old_model_is_written_again_as_the_format_of_today(tmp_path):
    assert FORMAT == 2, "a new format: write model-format-3 too, and keep the tests for 1 and 2"
    assert to_bytes(calib.load(KEPT[2])) == KEPT[2].read_bytes()
    old = calib.load(KEPT[1])
    assert not old.predictor.models.fades
    old.save(tmp_path / "new.calib")
    new = calib.load(tmp_path / "new.calib")
    q = draw(old, 100, seed=3)
    assert old.readouts == new.readouts
    for readout in old.readouts:
        assert new.forward(q, readout).tobytes() == old.forward(q, readout).tobytes()
    assert new.expected_error(q).tobytes() == old.expected_error(q).tobytes()
    assert to_bytes(new) == (tmp_path / "new.calib").read_bytes()


@pytest.mark.parametrize("version", KEPT)
def test_a_kept_model_goes_through_every_command(version, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("old.calib").write_bytes(KEPT[version].read_bytes())
    calib.write_log(calib.babble(calib.load_arm("two_link"), 60, seed=1), "new.csv")
    x, y = ANSWERS[version]["x"][0]
    for words in (
        "info old.calib",
        "query forward old.calib 0.5 1.0",
        f"query inverse old.calib {x} {y}",
        "evaluate old.calib --data new.csv",
        "preview old.calib --html page.html",
        "report old.calib -o report.html",
    ):
        done = run(*words.split())
        assert done.code == 0, (words, done.err)
    assert Path("old.calib").read_bytes() == KEPT[version].read_bytes()
    assert {"page.html", "report.html"} <= {p.name for p in tmp_path.iterdir()}


def test_check_and_adapt_of_format_1_ask_for_training(run, tmp_path, monkeypatch):
    """It keeps no posterior, so that nothing tells how far a log may be from it."""
    monkeypatch.chdir(tmp_path)
    Path("old.calib").write_bytes(KEPT[1].read_bytes())
    new = calib.babble(calib.load_arm("two_link"), 60, seed=1)
    calib.write_log(new, "new.csv")
    for command in ("check", "adapt"):
        done = run(command, "old.calib", "--data", "new.csv")
        assert (done.code, done.out) == (1, "")
        assert "older format" in done.err
        assert "train it again" in done.err
        with pytest.raises(calib.CalibError, match="train it again"):
            getattr(calib, command)(calib.load(KEPT[1]), new)
    assert {p.name for p in tmp_path.iterdir()} == {"old.calib", "new.csv"}
