"""The model format: what the page says is enough to read a file, and old files stay readable."""

from __future__ import annotations

import hashlib
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from models import brief_teacher, draw, log, measured, trained, turning
from safetensors import safe_open

import calib
from calib.model_file.storage import FORMAT, to_bytes

HERE = Path(__file__).parent
PAGE = (HERE.parent / "docs" / "format.md").read_text(encoding="utf-8")
OLD = HERE / "data" / "model-format-1.calib"
ANSWERS = json.loads((HERE / "data" / "model-format-1.json").read_text(encoding="utf-8"))


def reader():
    """The names that the page's reader defines."""
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict = {}
    exec(compile(code, "docs/format.md", "exec"), names)
    assert "import calib" not in code
    return names


def taught():
    with brief_teacher(1500):
        return calib.train(log(30, 1e-3), size=6)


MODELS = {
    "of an old format": lambda: calib.load(OLD),
    "with noise": lambda: trained("two_link", 800, 8, noise=1e-3),
    "of a log": lambda: measured(150, 5),
    "of three joints": lambda: trained("three_link", 800, 6),
    "with a slide": lambda: trained("polar", 800, 8),
    "with a joint that turns round": turning,
    "taught": taught,
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
    np.testing.assert_allclose([forward(path, row) for row in q], model.forward(q), atol=1e-9)


def test_there_are_local_models_among_those_that_are_read():
    """Else the second half of the reader would never run."""
    assert calib.load(OLD).predictor.models.degree == ANSWERS["local_degree"] == 2


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
    for key in ("trend", "local", "links"):
        assert set(said[key]) <= told


def test_the_checksum_is_as_the_page_says():
    with safe_open(OLD, framework="np") as file:
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


def test_an_old_model_loads_and_answers_as_it_did():
    model = calib.load(OLD)
    q, x = np.array(ANSWERS["q"]), np.array(ANSWERS["x"])
    for readout, answers in ANSWERS["forward"].items():
        np.testing.assert_allclose(model.forward(q, readout), answers, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(model.expected_error(q), ANSWERS["expected_error"], rtol=1e-9)
    found = model.inverse(x, near=q)
    answers = np.array(ANSWERS["inverse"])
    assert (np.isnan(found) == np.isnan(answers)).all()
    np.testing.assert_allclose(found, answers, rtol=1e-7, atol=1e-9)
    assert model.about.samples == 900
    assert model.about.seed == 3


def test_an_old_model_is_written_again_as_the_format_of_today():
    assert FORMAT == 1, "a new format: write model-format-2 too, and keep this test for 1"
    assert to_bytes(calib.load(OLD)) == OLD.read_bytes()


def test_an_old_model_goes_through_every_command(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("old.calib").write_bytes(OLD.read_bytes())
    calib.write_log(calib.babble(calib.load_arm("two_link"), 60, seed=1), "new.csv")
    for words in (
        "info old.calib",
        "query forward old.calib 0.5 1.0",
        "query inverse old.calib 0.3 0.3",
        "evaluate old.calib --data new.csv",
        "adapt old.calib --data new.csv",
        "query forward old.adapted.calib 0.5 1.0",
        "preview old.calib --html page.html",
        "report old.calib -o report.html",
    ):
        done = run(*words.split())
        assert done.code == 0, (words, done.err)
    assert run("check", "old.calib", "--data", "new.csv").code == 3  # that sensor has no kink
    assert Path("old.calib").read_bytes() == OLD.read_bytes()
    assert {"old.adapted.calib", "page.html", "report.html"} <= {p.name for p in tmp_path.iterdir()}
