"""Damaged, edited and forged model files: told in one line, or the very same model."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_files import described, join, split
from models import log, no_arm, trained
from safetensors.numpy import save as pack

import calib
from calib.body.trend import Trend
from calib.errors import ModelError
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
