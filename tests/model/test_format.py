"""The model format: every tensor and key is on the page; older ones say train again."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hostile.test_model_file import described
from models import bytes_of, draw, log, measured, trained
from safetensors import safe_open
from safetensors.numpy import load as unpack
from safetensors.numpy import save as pack

import calib
from calib import ModelError

PAGE = (Path(__file__).parents[2] / "docs" / "format.md").read_text(encoding="utf-8")

MODELS = {
    "simulated": lambda: trained("two_link", 300, 5),
    "of a log": lambda: measured(150, 5),
    "without a body": lambda: calib.train(log(300, 1e-3), size=6, body="none"),
    "of a growing neural gas": lambda: trained("two_link", 300, 5, map="gng"),
}


@pytest.mark.parametrize("kind", MODELS)
def test_every_tensor_and_every_key_is_on_the_page(kind, tmp_path):
    path = tmp_path / "m.calib"
    MODELS[kind]().save(path)
    with safe_open(path, framework="np") as file:
        names, metadata = set(file.keys()), file.metadata()
    told = set(re.findall(r"`([a-z0-9_.*]+)`", PAGE))
    starred = {name[2:] for name in told if name.startswith("*.")}
    assert {n for n in names if n not in told and n.split(".", 2)[-1] not in starred} == set()
    said = json.loads(metadata["calib"])
    assert set(said) <= told
    assert set(said["about"]) <= told
    for key in ("association", "local", "body"):
        assert set(said[key] or ()) <= told
    assert set(said["association"]["wiring"]) <= told


def read(data):
    """The description and the tensors of a file."""
    (length,) = struct.unpack("<Q", data[:8])
    header, numbers = json.loads(data[8 : 8 + length]), data[8 + length :]
    said = json.loads(header.pop("__metadata__")["calib"])
    types = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "U8": "u1", "U16": "<u2", "U32": "<u4"}
    tensors = {
        name: np.frombuffer(numbers[slice(*told["data_offsets"])], types[told["dtype"]]).reshape(
            told["shape"]
        )
        for name, told in header.items()
    }
    return said, tensors


def body_of(said, tensors, q):
    """Positions (n, 2) of a planar body at joint values (n, dof)."""
    told, n = said["body"]["structure"], q.shape[1]
    sensor = told["sensors"][told["place"]]
    parts = iter(tensors["body.beta"])

    def take(count):
        return np.array([next(parts) for _ in range(count)])

    turns, d = np.array(told["revolute"]), np.array(told["signs"])
    alpha, s, a, b = take(4)
    t, h, (k,), c = take(2), take(2), take(1), take(2)
    length, offset, gain = take(n), take(n), take(n)
    psi = np.cumsum(np.where(turns, d * q, 0.0), axis=1)
    theta = gain * d * q + offset
    for i in range(n):
        for m in range(i, n):
            if turns[i] and turns[m]:
                e, f = take(2)
                theta[:, i] += e * np.cos(psi[:, m]) + f * np.sin(psi[:, m])
    order = np.arange(1, 49)
    for i in np.flatnonzero(turns):
        cosines, sines = take(48), take(48)
        angle = q[:, [i]] * order
        theta[:, i] += np.cos(angle) @ cosines + np.sin(angle) @ sines
    phi = np.cumsum(np.where(turns, theta, 0.0), axis=1)
    w = sensor["metre"] if sensor["view"] in ("base", "rigid") else 1.0
    slid = (length + w * gain * d * q) * np.exp(1j * (phi + offset))
    p = np.where(turns, length * np.exp(1j * phi), slid).sum(axis=1)
    p = np.stack([p.real, p.imag], axis=1)
    turned = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
    matrix = np.exp(s) * turned @ [[1 + a, b], [b, 1 - a]] @ np.diag([1, sensor["mirror"]])
    y = t + p @ matrix.T / (1 + p @ h)[:, None]
    v = (y - sensor["centre"]) / (1.5 * sensor["extent"]) - c
    return y + 1.5 * sensor["extent"] * k * (v**2).sum(axis=1, keepdims=True) * v


@pytest.mark.parametrize("robot", ["two_link", "three_link", "polar", "log"])
def test_a_reader_that_knows_this_page_alone_answers_forward(robot):
    model = measured(150, 5) if robot == "log" else trained(robot, 300, 5)
    said, tensors = read(bytes_of(model))
    assert said["local"]["degree"] == -1
    q = draw(model, 50)
    np.testing.assert_allclose(body_of(said, tensors, q), model.forward(q), rtol=0, atol=1e-12)


@pytest.mark.parametrize("version", [1, 2, 0, None, "2"])
def test_an_older_format_says_train_again(version, tmp_path):
    data = bytes_of(trained("two_link", 300, 5))
    header = {**described(data), "format": version}
    old = pack(unpack(data), metadata={"calib": json.dumps(header)})
    (tmp_path / "old.calib").write_bytes(old)
    with pytest.raises(ModelError, match=r"expected \d+.*train the model again"):
        calib.load(tmp_path / "old.calib")
