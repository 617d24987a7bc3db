"""Model files: exact round trips, the same bytes, and damage that is told in one line."""

import json
import re
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import draw, log, measured, no_arm, trained, turning
from safetensors.numpy import save as pack

import calib
from calib.body.basis import Basis
from calib.body.trend import Trend
from calib.errors import ModelError
from calib.maps.predictor import Both, Predictor
from calib.model_file.storage import FORMAT, from_bytes, to_bytes


@pytest.fixture(scope="module")
def data():
    return to_bytes(trained("two_link", 300, 5))


@pytest.fixture(scope="module")
def of_trends():
    """A model of a log that no arm explains."""
    model = calib.train(no_arm(150), size=5)
    assert isinstance(model.predictor.smooth, Trend)
    return to_bytes(model)


@pytest.fixture(scope="module")
def of_maps():
    """A model of maps and links alone."""
    return to_bytes(calib.train(log(150, 1e-3), size=5, body="none"))


@pytest.fixture(scope="module")
def of_a_log():
    """A model of a log: its body has a second fit, and its rows are kept."""
    return to_bytes(calib.train(log(150, 1e-3), size=5))


def split(data):
    """The JSON header of a safetensors file and the bytes of its tensors."""
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def join(header, body):
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def described(data):
    return json.loads(split(data)[0]["__metadata__"]["calib"])


def edited(data, **changes):
    """Return the file with other values in its description."""
    header, body = split(data)
    description = {**json.loads(header["__metadata__"]["calib"]), **changes}
    header["__metadata__"]["calib"] = json.dumps(description)
    return join(header, body)


def refusal(data):
    with pytest.raises(ModelError) as caught:
        from_bytes(data, "m.calib")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("m.calib: ")
    assert len(message) < 250
    return message


def refused_or_equal(damaged, data):
    """Whether a file is refused in one line, or still describes the very same model."""
    try:
        return to_bytes(from_bytes(damaged, "m.calib")) == data
    except ModelError as error:
        return "\n" not in str(error)


def plain(about):
    return json.dumps(about.to_json(), sort_keys=True)


def of_both():
    """A body, a trend of what it leaves over, and local models."""
    model = measured(300, 6)
    basis = Basis((1.5, 0.0), 2, 0)
    rng = np.random.default_rng(0)
    trend = Trend(basis, 1e-4 * rng.standard_normal((len(basis.orders), 2)))
    predictor = model.predictor
    return replace(
        model, predictor=Predictor(model.motor, Both(predictor.smooth, trend), predictor.models)
    )


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
    "of a body and a trend": of_both,
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
    assert to_bytes(again) == path.read_bytes() == to_bytes(model)
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
    assert (again.rows is None) == (model.rows is None)
    if model.rows is not None:
        assert again.rows.q.tobytes() == model.rows.q.tobytes()
        assert again.rows.x.tobytes() == model.rows.x.tobytes()
    assert again.motor.lattice.size == model.motor.lattice.size
    assert again.motor.edges.tobytes() == model.motor.edges.tobytes()
    assert (again.links != model.links).nnz == 0
    assert plain(again.about) == plain(model.about)
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
    assert described(data)["format"] == FORMAT


def test_any_safetensors_reader_finds_the_weights(data):
    from safetensors.numpy import load

    tensors = load(data)
    model = from_bytes(data)
    assert tensors["motor.units"].shape == (25, 2)
    assert (tensors["motor.units"] == model.motor.units).all()
    assert not any(a.dtype == object for a in tensors.values())


def test_saving_replaces_an_older_file_whole_and_leaves_nothing_else(data, tmp_path):
    path = tmp_path / "m.calib"
    path.write_bytes(b"older")
    from_bytes(data).save(path)
    assert path.read_bytes() == data
    assert [p.name for p in tmp_path.iterdir()] == ["m.calib"]


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


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_a_flipped_bit_is_noticed_or_harmless(data, draws):
    place = draws.draw(st.integers(0, len(data) - 1))
    bit = draws.draw(st.integers(0, 7))
    flipped = bytearray(data)
    flipped[place] ^= 1 << bit
    assert refused_or_equal(bytes(flipped), data)


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_a_flipped_bit_in_the_header_is_noticed_or_harmless(data, draws):
    (length,) = struct.unpack("<Q", data[:8])
    place = draws.draw(st.integers(0, 8 + length - 1))
    flipped = bytearray(data)
    flipped[place] ^= 1 << draws.draw(st.integers(0, 7))
    assert refused_or_equal(bytes(flipped), data)


@given(st.floats(0, 1, exclude_max=True))
@settings(max_examples=60, deadline=None)
def test_a_file_that_is_cut_is_refused(data, share):
    refusal(data[: int(share * len(data))])


@given(st.binary(max_size=300))
@settings(max_examples=60, deadline=None)
def test_other_files_are_refused(content):
    refusal(content)


def test_bytes_after_the_end_are_refused(data):
    refusal(data + b"\0")


def test_a_foreign_safetensors_file_is_told_as_such(data):
    foreign = pack({"weight": np.zeros(3)}, metadata={"author": "someone"})
    assert "not one that 'calib train' wrote" in refusal(foreign)
    assert "not one that 'calib train' wrote" in refusal(pack({"weight": np.zeros(3)}))


def test_a_newer_format_is_told_with_the_command_that_upgrades(data):
    message = refusal(edited(data, format=FORMAT + 1))
    assert f"model format {FORMAT + 1} is newer than {FORMAT}" in message
    assert "pip install -U calib-arm" in message


@pytest.mark.parametrize("version", [0, -1, "1", None, 1.5])
def test_an_impossible_format_is_refused(data, version):
    assert "is unknown" in refusal(edited(data, format=version))


@pytest.mark.parametrize("text", ["", "{", "[]", "1", "null", '"calib"', "[" * 100_000])
def test_a_description_that_is_no_json_object_is_refused(data, text):
    header, body = split(data)
    header["__metadata__"]["calib"] = text
    refusal(join(header, body))


def test_edited_numbers_and_edited_descriptions_do_not_match_the_checksum(data):
    header, body = split(data)
    changed = bytearray(body)
    changed[len(body) // 2] ^= 1
    assert "checksum" in refusal(join(header, bytes(changed)))
    about = described(data)["about"]
    about["upper"] = [3.0, 3.0]
    assert "checksum" in refusal(edited(data, about=about))
    assert "checksum" in refusal(edited(data, sha256="0" * 64))


def forged(data, change):
    """Return the file after `change(header, tensors)`, with a checksum that is right."""
    from safetensors.numpy import load

    from calib.model_file import storage

    header, tensors = described(data), dict(load(data))
    change(header, tensors)
    header["sha256"] = storage._checksum(tensors, header)
    return pack(tensors, metadata={"calib": json.dumps(header)})


def _set(name, index, value):
    def change(header, tensors):
        tensors[name] = tensors[name].copy()
        tensors[name].reshape(-1)[index] = value

    return change


FORGERIES = {
    "without its motor map": lambda h, t: t.pop("motor.units"),
    "without joints": lambda h, t: h["about"].pop("joint_names"),
    "with a joint more": lambda h, t: h["about"]["joint_names"].append("wrist"),
    "of a larger lattice": lambda h, t: h["motor"].update(lattice=[6, 6]),
    "of a lattice without nodes": lambda h, t: h["motor"].update(lattice=[0, 0]),
    "of a lattice that no memory holds": lambda h, t: h["motor"].update(lattice=[10**6, 10**6]),
    "with a link to nowhere": _set("links.indices", 0, 60_000),
    "with a weight that is no number": _set("motor.units", 0, np.nan),
    "with an infinite bound": _set("bounds", 0, np.inf),
    "without a smooth part": lambda h, t: h.pop("smooth"),
    "with neither a body nor a trend": lambda h, t: h["smooth"].update(body=None),
    "with a trend that is not there": lambda h, t: h["smooth"].update(
        trend={"turns": [1.5, 1.0], "degree": 1, "each": 0}
    ),
    "with bounds of another map": lambda h, t: t.update(bounds=t["bounds"][:-1]),
    "with a list for its description": lambda h, t: h.update(about=[]),
    "with a name that is a number": lambda h, t: h["about"].update(joint_names=[1, "elbow"]),
    "with a range without width": lambda h, t: h["about"].update(upper=h["about"]["lower"]),
    "with a range that is no number": lambda h, t: h["about"].update(upper=[np.nan, 1.0]),
    "with locked joints that are a number": lambda h, t: h["about"].update(locked=1.5),
    "with errors of other joints": lambda h, t: h["about"]["errors"]["local"].update(inverse={}),
    "with nodes all in one place": lambda h, t: t.update({"motor.units": 0 * t["motor.units"]}),
    "with a scale without width": _set("motor.span", 0, 0.0),
    "with a history that is text": lambda h, t: h.update(history=["adapted"]),
    "with limits of another type": lambda h, t: t.update(
        {"motor.lower": t["motor.lower"].astype(np.uint8)}
    ),
    "with a map of other limits": _set("motor.lower", 0, -9.0),
    "with a negative variance": lambda h, t: h["baseline"].update(spread=[0.7, -0.7]),
    "with a negative bound": _set("bounds", 0, -1.0),
    "with shifts of another map": lambda h, t: t.update({"motor.shifts": t["motor.shifts"][:-1]}),
    "with a shift that is no number": _set("sensory.shifts", 0, np.nan),
    "with shifts of another type": lambda h, t: t.update(
        {"motor.shifts": t["motor.shifts"].astype(float)}
    ),
    "with a bandwidth of nearly nothing": lambda h, t: h["links"].update(bandwidth=1e-320),
    "with links of no strength": lambda h, t: t.update({"links.data": 0 * t["links.data"]}),
    "with a link of a negative strength": _set("links.data", 0, -1.0),
    "with no node visited": lambda h, t: t.update(visited=0 * t["visited"]),
    "with links whose number is negative": lambda h, t: t.update(
        {"links.counts": -t["links.counts"].astype(np.int64)}
    ),
}


def _body(**changes):
    return lambda h, t: h["smooth"]["body"].update(changes)


def _chain(**changes):
    return lambda h, t: h["smooth"]["body"]["structure"].update(changes)


def _trend(**changes):
    return lambda h, t: h["smooth"]["trend"].update(changes)


BODY_FORGERIES = {
    "of an unknown kind": _chain(kind="plastic"),
    "of an unknown view": _chain(view="sideways"),
    "of more joints": _chain(joint_names=["a", "b", "c"], revolute=[True] * 3, signs=[1] * 3),
    "of a sign of 2": _chain(signs=[1, 2]),
    "of no extent": _chain(extent=0.0),
    "with a centre that is text": _chain(centre=["0", "0"]),
    "with a bound that shrinks": _body(kappa=0.5),
    "with negative rows": _body(rows=-1),
    "with rows that are text": _body(rows="150"),
    "with a second fit that is a number": _body(second=1),
    "with a parameter that is no number": _set("body.beta", 0, np.nan),
    "with a noise below zero": _set("body.noise", 0, -1.0),
    "with parameters beyond the last": _set("body.active", -1, 10**6),
    "with parameters in no order": _set("body.active", 0, 5),
    "with a root that is no number": _set("body.root", 0, np.nan),
    "with a root of another size": lambda h, t: t.update({"body.root": t["body.root"][:-1]}),
    "with an infinite second root": _set("body.second.root", 0, np.inf),
    "without its second fit": lambda h, t: t.pop("body.second.root"),
    "with rows of another arm": lambda h, t: t.update({"rows.q": t["rows.q"][:, :1].copy()}),
    "with a row that is no number": _set("rows.x", 0, np.nan),
    "with fewer positions than rows": lambda h, t: t.update({"rows.x": t["rows.x"][:-1]}),
    "with too many rows": lambda h, t: t.update(
        {name: np.tile(t[name], (40, 1)) for name in ("rows.q", "rows.x")}
    ),
}
TREND_FORGERIES = {
    "of a monstrous trend": _trend(degree=10**9),
    "of a negative trend": _trend(degree=-1),
    "with a trend that is text": _trend(degree="2"),
    "with a coefficient beyond all sense": _set("trend.coefficients", 0, 1e300),
    "with a turn of nearly nothing": _trend(turns=[1e-320, 1.0]),
}


@pytest.mark.parametrize("kind", FORGERIES)
def test_a_file_that_makes_no_sense_is_refused_even_with_the_right_checksum(data, kind):
    refusal(forged(data, FORGERIES[kind]))


@pytest.mark.parametrize("kind", BODY_FORGERIES)
def test_a_body_that_makes_no_sense_is_refused(of_a_log, kind):
    refusal(forged(of_a_log, BODY_FORGERIES[kind]))


@pytest.mark.parametrize("kind", TREND_FORGERIES)
def test_a_trend_that_makes_no_sense_is_refused(of_trends, kind):
    refusal(forged(of_trends, TREND_FORGERIES[kind]))


def test_an_honest_forgery_is_a_model(data, of_a_log, of_trends, of_maps):
    for honest in (data, of_a_log, of_trends, of_maps):
        assert to_bytes(from_bytes(forged(honest, lambda h, t: None))) == honest


def test_missing_files_and_folders_are_told_in_one_line(tmp_path):
    for path, message in (
        (tmp_path / "no.calib", "no such file, expected a model written by 'calib train'"),
        (tmp_path, "cannot be read"),
        (tmp_path / "no\0name", "cannot be read"),
    ):
        with pytest.raises(ModelError, match=message) as caught:
            calib.load(path)
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero here")
def test_a_device_without_end_is_not_read():
    with pytest.raises(ModelError, match="is a device"):
        calib.load("/dev/zero")


def test_a_large_file_of_another_sort_is_not_read_whole(tmp_path, monkeypatch):
    from calib.model_file import storage

    monkeypatch.setattr("calib.model_file.storage._HEADER", 1000)
    path = tmp_path / "m.calib"
    path.write_bytes(b"x" * 5000)
    assert len(storage._read(path)) == 1000
    with pytest.raises(ModelError, match="not a model file"):
        calib.load(path)


# --- what cannot be read back ----------------------------------------------------------------


def test_errors_that_could_not_be_measured_are_stored_as_null(tmp_path):
    """A log of one circle left NaN in the inverse errors, and a file that nothing could read."""
    nan = {"mean": float("nan"), "max": float("nan"), "p99": float("nan")}
    model = trained()
    errors = {
        "local": {
            "forward": dict.fromkeys(("x", "y", "distance"), nan),
            "inverse": dict.fromkeys((*model.about.joint_names, "distance"), nan),
        }
    }
    path = tmp_path / "m.calib"
    calib.Model.save(replace(model, about=replace(model.about, errors=errors)), path)
    read = calib.load(path).about.errors["local"]["inverse"]["distance"]
    assert read == {"mean": None, "max": None, "p99": None}


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


def test_a_log_along_one_circle_gives_a_model_that_can_be_read(tmp_path):
    turn = np.linspace(0.1, 1.4, 120)
    q = np.stack([turn, np.full_like(turn, 1.2) + 1e-3 * np.sin(9 * turn)], axis=1)
    arm = calib.load_arm("two_link")
    s = calib.Samples(q, arm.forward(q), arm.joint_names, q.min(0), q.max(0), arm.revolute)
    path = tmp_path / "circle.calib"
    try:
        calib.train(s, size=8).save(path)
    except calib.CalibError:
        assert not path.exists()
    else:
        assert calib.load(path).about.samples == 120
