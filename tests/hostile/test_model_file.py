"""Model files: damaged ones are refused or are the very same model, forged ones end in peace."""

import hashlib
import json
import struct
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import log, trained
from safetensors.numpy import load as unpack
from safetensors.numpy import save as pack

import calib
from hostile.guard import NAMES, NUMBERS, answer, damaged, inputs

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | NAMES | NUMBERS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=2),
)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Files of small models: simulated, of graphs, of a redundant arm, of maps alone, of a log."""
    folder = tmp_path_factory.mktemp("files")
    three = calib.babble(calib.load_arm("three_link"), 300, seed=0)
    made = {
        "two": trained("two_link", 300, 5),
        "gng": trained("two_link", 300, 5, map="gng"),
        "three": calib.train(three, motor_size=(3, 3, 3), sensory_size=4),
        "maps": calib.train(log(150, 1e-3), size=5, body="none"),
        "log": calib.train(log(150, 1e-3), size=5),
    }
    for name, model in made.items():
        model.save(folder / f"{name}.calib")
    return {name: (folder / f"{name}.calib").read_bytes() for name in made}


@pytest.fixture
def load(tmp_path):
    """Load the content of a file under guard: a model, or a refusal in one line."""

    return lambda data: answer(tmp_path / "m.calib", data, calib.load, calib.ModelError)


def split(data):
    """The JSON header of a safetensors file and the bytes of its tensors."""
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def described(data):
    return json.loads(split(data)[0]["__metadata__"]["calib"])


def forged(data, change):
    """The file after `change(description, tensors)`, its checksum right by docs/format.md."""
    description, tensors = described(data), {k: v.copy() for k, v in unpack(data).items()}
    change(description, tensors)
    rest = {key: value for key, value in description.items() if key != "sha256"}
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype.str} {tensors[name].shape};".encode())
        digest.update(tensors[name].tobytes())
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    digest.update(text.encode("utf-8", "surrogatepass"))
    rest["sha256"] = digest.hexdigest()
    return bytes(pack(tensors, metadata={"calib": json.dumps(rest)}))


def places(value):
    found = []
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            found += [(value, key), *places(value[key])]
    return found


@st.composite
def spoilt(draw, data):
    """A file of which something was replaced or removed, with a checksum that is right."""

    def change(description, tensors):
        if draw(st.booleans()):
            parent, key = draw(st.sampled_from(places(description)))
            old = parent[key]
            values = [PLAIN, st.just([old, old])]
            if isinstance(old, list):
                values.append(st.sampled_from((old[:-1], old * 2, old[::-1], [*old, None])))
            if isinstance(old, int | float):
                values.append(st.sampled_from((old + 1, -old, old * 1e6, old * 1e-6)))
            parent[key] = draw(st.one_of(*values))
            if draw(st.integers(0, 9)) == 9:
                del parent[key]
            return
        name, other = draw(st.sampled_from(sorted(tensors))), draw(st.sampled_from(sorted(tensors)))
        array, value = tensors[name], draw(st.sampled_from((np.nan, np.inf, 1e308, -1.0, 255.0)))
        first = np.arange(array.size).reshape(array.shape) == 0
        with np.errstate(all="ignore"):
            ways = (np.where(first, value, array), array.astype("f2"), array.astype("u1"),
                    np.atleast_1d(array)[:-1].copy(), tensors[other])  # fmt: skip
            tensors[name] = ways[draw(st.integers(0, 4))].astype(array.dtype)

    return forged(data, change)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers of a forged file may overflow
@pytest.mark.parametrize(("harm", "refused", "read"), [(damaged, 41, 0), (spoilt, 6, 6)])
def test_damaged_and_forged_files_are_refused_or_read(files, load, tmp_path, harm, refused, read):
    found = Counter()

    @inputs(80)
    @given(st.sampled_from(sorted(files.values())).flatmap(harm))
    def judge(data):
        model = load(data)
        if harm is damaged and not isinstance(model, str):  # the checksum tells
            model.save(tmp_path / "again.calib")
            assert (tmp_path / "again.calib").read_bytes() == data, "accepted, but not the same"
        found[isinstance(model, str)] += 1

    judge()
    assert found[True] >= refused
    assert found[False] >= read


def test_what_is_wrong_with_a_file_is_told(files, load):
    data = files["two"]
    header, body = split(data)

    def with_description(text):
        head = json.dumps({**header, "__metadata__": {"calib": text}}).encode()
        return struct.pack("<Q", len(head)) + head + body

    foreign = pack({"weight": np.zeros(3)}, metadata={"author": "someone"})
    assert "calib train" in load(foreign)
    newer = {**described(data), "format": described(data)["format"] + 1}
    assert "pip install -U calib-arm" in load(with_description(json.dumps(newer)))
    assert "checksum" in load(data[:-1] + bytes([data[-1] ^ 1]))
    assert "checksum" in load(with_description(json.dumps({**described(data), "sha256": "0"})))
    for text in ("", "{", "[]", "1", "null", '"calib"', "[" * 100_000):
        assert isinstance(load(with_description(text)), str)
    for version in (1, 2, 0, -1, "1", None, 1.5):
        older = with_description(json.dumps({**newer, "format": version}))
        assert "train the model again" in load(older)


def put(name, index, value):
    return lambda h, t: t[name].reshape(-1).__setitem__(index, value)


def lattice(shape):
    return lambda h, t: h["association"]["motor"]["lattice"].update(shape=shape)


NONSENSE = {  # each was once accepted, and crashed or answered nonsense later
    "without its motor map": lambda h, t: t.pop("association.motor.units"),
    "of a lattice that no memory holds": lattice([10**6, 10**6]),
    "of a lattice without nodes": lattice([0, 0]),
    "with a link to nowhere": put("association.linked.indices", 0, 250),
    "with rows of links that run back": put("association.linked.indptr", 1, 200),
    "with a weight that is no number": put("association.motor.units", 0, np.nan),
    "with an infinite bound": put("bounds", 0, np.inf),
    "with bounds of another map": lambda h, t: t.update(bounds=t["bounds"][:-1]),
    "with a number beyond all sizes": lambda h, t: h["body"].update(kappa=1e300),
    "with a list for its description": lambda h, t: h.update(about=[]),
    "with a name that is a number": lambda h, t: h["about"].update(joint_names=[1, "elbow"]),
    "with a history that is text": lambda h, t: h.update(history=["adapted"]),
}


@pytest.mark.parametrize("kind", NONSENSE)
def test_what_makes_no_sense_is_refused_even_with_the_right_checksum(files, load, kind):
    assert isinstance(load(forged(files["two"], NONSENSE[kind])), str)
