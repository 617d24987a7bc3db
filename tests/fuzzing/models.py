"""Model files: damaged ones are refused or answer as the original, forged ones in peace."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from safetensors.numpy import load as unpack
from safetensors.numpy import save as pack

import calib
from calib.errors import CalibError, ModelError
from calib.model_file import storage

from .guard import guarded, one_line
from .kinds import Kind
from .mutate import NAMES, NUMBERS, damaged


@dataclass(frozen=True)
class ModelCase:
    """A file, the model that it was made from, and whether its checksum was made to fit."""

    data: bytes
    base: int
    forged: bool


class Models(Kind):
    """Damaged and forged model files."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.bases = list(small_models())
        self.answers = [_answers(storage.from_bytes(data)) for data in self.bases]

    def make(self, rng: Random) -> ModelCase:
        """Make a file."""
        base = rng.randrange(len(self.bases))
        data = self.bases[base]
        way = rng.random()
        if way < 0.35:
            return ModelCase(damaged(rng, data), base, forged=False)
        if way < 0.55:
            return ModelCase(_claiming(rng, data), base, forged=False)
        if way < 0.7:
            return ModelCase(_edited(rng, data), base, forged=False)
        return ModelCase(_forged(rng, data), base, forged=True)

    def judge(self, case: ModelCase) -> str:
        """Load it. What is accepted has to answer, the unforged exactly as the original."""
        path = self.folder / "m.calib"
        path.write_bytes(case.data)
        with guarded(self.folder):
            try:
                model = calib.load(path)
            except ModelError as error:
                one_line(str(error))
                return "forged, refused" if case.forged else "refused"
            if case.forged:
                return _use(model)
            again = _answers(model)
        assert again == self.answers[case.base], "accepted, but it answers otherwise"
        assert storage.to_bytes(model) == self.bases[case.base], "accepted, but not the same"
        return "accepted, the same answers"


def small_models() -> list[bytes]:
    """Files of small models of every sort: simulated, of logs, lattices and graphs."""
    made = []
    for robot, options in (
        ("two_link", {"size": 5}),
        ("two_link", {"size": 5, "map": "gng"}),
        ("three_link", {"motor_size": (3, 3, 3), "sensory_size": 4}),
        ("polar", {"size": 4}),
    ):
        samples = calib.babble(calib.load_arm(robot), 300, seed=0)
        made.append(storage.to_bytes(calib.train(samples, **options)))
    rng = np.random.default_rng(0)
    q = rng.uniform((-np.pi, 0.3), (np.pi, 2.5), (300, 2))
    reach = 0.3 * np.exp(1j * q[:, 0]) + 0.2 * np.exp(1j * q.sum(axis=1))
    x = np.stack([reach.real, reach.imag], axis=1) + rng.normal(0, 1e-3, (300, 2))
    log = calib.Samples(q, x, ("a", "b"), np.array([-np.pi, 0.3]), np.array([np.pi, 2.5]),
                        (True, True))  # fmt: skip
    made.append(storage.to_bytes(calib.train(log, size=5)))
    return made


def _probe(model: Any) -> np.ndarray:
    about = model.about
    draws = np.random.default_rng(0).random((20, len(about.joint_names)))
    return np.asarray(about.lower + (about.upper - about.lower) * draws)


def _answers(model: Any) -> bytes:
    """All that a model says, to the last bit."""
    q = _probe(model)
    parts = [model.forward(q, readout) for readout in ("local", "activity", "winner")]
    x = parts[0][np.isfinite(parts[0]).all(axis=1)]
    answer = model.solve(x)
    parts += [answer.q, answer.distance, answer.expected_error, model.expected_error(q)]
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)


def _use(model: Any) -> str:
    """Ask a forged model everything: answers or one line, whatever it holds."""
    refused = ""
    for ask in (
        lambda: _answers(model),
        lambda: model.inverse_all(model.forward(_probe(model))[:3]),
        lambda: calib.evaluate(model, None),
        lambda: calib.check(model, _log_of(model)),
        lambda: storage.to_bytes(model),
    ):
        try:
            ask()
        except CalibError as error:
            refused = one_line(str(error))
    return "forged, loaded, refused to answer" if refused else "forged, loaded"


def _log_of(model: Any) -> calib.Samples:
    about, q = model.about, _probe(model)
    x = np.random.default_rng(1).normal(0, 0.1, (len(q), 2))
    return calib.Samples(q, x, about.joint_names, about.lower, about.upper, about.revolute)


def _split(data: bytes) -> tuple[dict[str, Any], bytes]:
    (length,) = struct.unpack("<Q", data[:8])
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def _join(header: Any, body: bytes) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


def _claiming(rng: Random, data: bytes) -> bytes:
    """Let the header of the tensors claim other sizes, types and places, up to terabytes."""
    huge = rng.choice((2**40, 2**63 - 1, 2**64 - 1, 2**64, -1, 10**15, len(data) * 2, 0))
    if rng.random() < 0.3:
        return struct.pack("<Q", huge % 2**64) + data[8:]
    header, body = _split(data)
    names = [name for name in header if name != "__metadata__"]
    tensor = header[rng.choice(names)]
    what = rng.randrange(6)
    if what == 0:
        tensor["shape"] = rng.choice(
            ([huge], [huge, huge], [2**32, 2**32], [0], [], [-1], [1] * 9999)
        )
    elif what == 1:
        tensor["data_offsets"] = rng.choice(([0, huge], [huge, huge], [8, 0], [0], [0, 0, 0]))
    elif what == 2:
        tensor["dtype"] = rng.choice(("F64", "F32", "F16", "BF16", "I64", "U8", "BOOL", "F8_E4M3",
                                      "O", "", "complex128"))  # fmt: skip
    elif what == 3:
        header[rng.choice(NAMES)] = header.pop(rng.choice(names))
    elif what == 4:
        header["__metadata__"] = rng.choice(({}, [], None, {"calib": 1}, {"calib": "{}"},
                                             {"x": "y"}, "calib"))  # fmt: skip
    else:
        a, b = rng.sample(names, 2)
        header[a], header[b] = header[b], header[a]
    return _join(header, body)


def _edited(rng: Random, data: bytes) -> bytes:
    """Change the description and leave its checksum."""
    header, body = _split(data)
    description = json.loads(header["__metadata__"]["calib"])
    _spoil(rng, description)
    header["__metadata__"]["calib"] = json.dumps(description)
    return _join(header, body)


def _forged(rng: Random, data: bytes) -> bytes:
    """Change the description and the tensors, and let the checksum fit."""
    description = json.loads(_split(data)[0]["__metadata__"]["calib"])
    tensors = {name: array.copy() for name, array in unpack(data).items()}
    for _ in range(rng.randint(1, 2)):
        if rng.random() < 0.6:
            _spoil(rng, description)
        else:
            _spoil_tensor(rng, tensors)
    description.pop("sha256", None)
    try:
        description["sha256"] = storage._checksum(tensors, description)
        return bytes(pack(tensors, metadata={"calib": json.dumps(description)}))
    except UnicodeEncodeError:  # lone surrogates cannot be written
        return data


def _spoil(rng: Random, description: Any) -> None:
    """Replace, remove or add something anywhere in plain data."""
    places = [(parent, key) for parent, key in _places(description) if key != "sha256"]
    parent, key = rng.choice(places)
    if rng.random() < 0.15:
        del parent[key]
    else:
        parent[key] = _value(rng, parent[key])


def _places(value: Any) -> list[tuple[Any, Any]]:
    found = []
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            found += [(value, key), *_places(value[key])]
    return found


def _value(rng: Random, old: Any) -> Any:
    values = [None, True, [], {}, "", 0, -1, 1, 2, 7, 1e308, -1e308, 1e-320, float("nan"),
              float("inf"), 10**30, 2**63, [[]], [1, 2, 3], {"a": 1}, rng.choice(NAMES),
              rng.choice(NUMBERS), [old], [old, old], str(old)]  # fmt: skip
    if isinstance(old, list):
        values += [old[:-1], old * 2, old[::-1], [*old, None]]
    if isinstance(old, int | float):
        values += [old + 1, -old, old * 1e6, old * 1e-6]
    return rng.choice(values)


def _spoil_tensor(rng: Random, tensors: dict[str, np.ndarray]) -> None:
    name = rng.choice(sorted(tensors))
    array = tensors[name]
    what = rng.randrange(7)
    if what == 0 and array.size:
        number = rng.choice((np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, -1.0, 0.0, 255.0))
        with np.errstate(all="ignore"):
            array.reshape(-1)[rng.randrange(array.size)] = np.array(number).astype(array.dtype)
    elif what == 1:
        kind = rng.choice(("f8", "f4", "f2", "i8", "u1", "i1", "u8", "?"))
        with np.errstate(all="ignore"):
            tensors[name] = array.astype(kind)
    elif what == 2:
        tensors[name] = rng.choice((array[:-1], array[:0], array.reshape(-1), array[None])
                                   if array.ndim else (array[None],)).copy()  # fmt: skip
    elif what == 3:
        del tensors[name]
    elif what == 4:
        tensors[rng.choice(NAMES[10:]) or "x"] = array
    elif what == 5:
        tensors[name] = np.full_like(array, rng.choice((0, 1, 200)))
    else:
        other = rng.choice(sorted(tensors))
        tensors[name], tensors[other] = tensors[other], array
