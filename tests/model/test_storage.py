"""Model files: exact round trips, the same bytes, whole or not at all."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile.test_model_file import described, split
from models import bytes_of, draw, log, measured, no_arm, trained, turning

import calib
from calib import ModelError


@pytest.fixture(scope="module")
def data():
    return bytes_of(trained("two_link", 300, 5))


def of_a_camera():
    """Pixels of a tilted camera: a homography, and a body that is fitted to it."""
    rows = log(200)
    x = 400 * rows.x / (1 + 0.3 * rows.x[:, :1]) + [320, 240]
    x += np.random.default_rng(1).normal(size=x.shape)
    return calib.train(replace(rows, x=x, unit="px"), size=6)


MODELS = {
    "simulated": lambda: trained("two_link"),
    "a log": measured,
    "of three joints": lambda: trained("three_link"),
    "with a slide": lambda: trained("polar"),
    "with a joint that turns round": turning,
    "of few rows": lambda: calib.train(log(30, 1e-3), size=6),
    "without a body": lambda: calib.train(log(300, 1e-3), size=6, body="none"),
    "of no arm": lambda: calib.train(no_arm(150), size=6),
    "of a camera": of_a_camera,
    "of a growing neural gas": lambda: trained("two_link", 300, 5, map="gng"),
    "with a radius": lambda: trained("two_link", 300, 5, sigma=(2.0, 0.5), epochs=3),
}


@pytest.mark.parametrize("kind", MODELS)
def test_a_round_trip_gives_the_same_answers_and_the_same_bytes(kind, tmp_path):
    model = MODELS[kind]()
    path = tmp_path / "m.calib"
    model.save(path)
    again = calib.load(path)
    assert bytes_of(again) == path.read_bytes() == bytes_of(model)
    q = draw(model, 200, seed=1)
    assert again.readouts == model.readouts
    for readout in model.readouts:
        assert again.forward(q, readout).tobytes() == model.forward(q, readout).tobytes()
    x = model.forward(q)
    x = x[np.isfinite(x[:, 0])]
    # the starts are refined in other company, which rounds differently
    np.testing.assert_allclose(again.inverse(x), model.inverse(x), rtol=0, atol=1e-12)
    assert again.expected_error(q).tobytes() == model.expected_error(q).tobytes()
    assert again.model_error(q).tobytes() == model.model_error(q).tobytes()
    assert (again.body is None) == (model.body is None)
    if model.body is not None:
        assert again.body.describe() == model.body.describe()
        assert again.body.parameters() == model.body.parameters()
        np.testing.assert_allclose(again.body.bound(q), model.body.bound(q), rtol=1e-12)
    assert len(bytes_of(model)) < 1_000_000
    assert (again.rows is None) == (model.rows is None)
    if model.rows is not None:
        assert again.rows.q.tobytes() == model.rows.q.tobytes()
        assert again.rows.x.tobytes() == model.rows.x.tobytes()
    assert again.motor.lattice.size == model.motor.lattice.size
    assert again.motor.edges.tobytes() == model.motor.edges.tobytes()
    assert (again.links != model.links).nnz == 0
    assert again.history == model.history


def test_no_time_no_date_and_no_path_is_inside(data, tmp_path):
    arm = calib.load_arm("two_link")
    urdf = tmp_path / "copied_robot.urdf"
    urdf.write_text(arm.urdf)
    model = calib.train(calib.babble(calib.load_arm(str(urdf)), 300), size=5)
    path = tmp_path / "somewhere.calib"
    model.save(path)
    content = path.read_bytes()
    for secret in (tmp_path, tmp_path.name, Path(calib.__file__).parent, Path.home(), "somewhere"):
        assert str(secret).encode() not in content
    text = json.dumps(described(content))
    assert "seconds" not in described(content)
    assert not re.search(r"\b20[2-9]\d-\d\d-\d\d|\b\d\d:\d\d:\d\d\b", text)


def test_the_description_is_one_canonical_json_string(data):
    header, _ = split(data)
    assert list(header["__metadata__"]) == ["calib"]
    text = header["__metadata__"]["calib"]
    again = json.dumps(json.loads(text), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert text == again


def test_a_file_is_loaded_and_asked_without_pinocchio_and_yourdfpy(data, tmp_path):
    path = tmp_path / "m.calib"
    path.write_bytes(data)
    code = (
        "import sys, calib; m = calib.load(sys.argv[1]);"
        "assert abs(m.forward(m.inverse([0.3, 0.3])) - 0.3).max() < 1e-6;"
        "print([n for n in ('pinocchio', 'yourdfpy', 'meshcat', 'polars') if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_missing_files_and_folders_are_told_in_one_line(tmp_path):
    for path, message in (
        (tmp_path / "no.calib", "no such file, expected a model written by 'calib train'"),
        (tmp_path, "cannot be read"),
        (tmp_path / "no\0name", "cannot be read"),
    ):
        with pytest.raises(ModelError, match=message) as caught:
            calib.load(path)
        assert "\n" not in str(caught.value)


def test_an_older_file_is_replaced_only_by_one_that_was_read_back(tmp_path):
    path = tmp_path / "m.calib"
    model = trained()
    model.save(path)
    before = path.read_bytes()
    upper = model.about.upper.copy()
    upper[0] = np.nan
    broken = replace(model, about=replace(model.about, upper=upper))
    with pytest.raises(calib.ModelError, match="nothing was written"):
        broken.save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.calib"]


def test_maps_are_read_as_they_were_saved(tmp_path):
    association = trained("two_link", n=400, size=4).association
    for maps in (association, association.motor):
        path = tmp_path / "maps.calib"
        maps.save(path)
        again = calib.load_maps(path)
        assert type(again) is type(maps)
        first = path.read_bytes()
        again.save(path)
        assert path.read_bytes() == first
    association.save(path)
    q = np.array([[0.5, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(calib.load_maps(path).predict(q), association.predict(q))


def test_files_that_are_no_maps_are_refused_in_a_line(tmp_path):
    model = trained("two_link", n=400, size=4)
    path = tmp_path / "model.calib"
    model.save(path)
    with pytest.raises(calib.ModelError, match="no file of maps"):
        calib.load_maps(path)
    with pytest.raises(calib.ModelError, match="no such file"):
        calib.load_maps(tmp_path / "none.calib")
    model.association.save(path)
    with pytest.raises(calib.ModelError):
        calib.load(path)
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(calib.ModelError, match="checksum"):
        calib.load_maps(path)
