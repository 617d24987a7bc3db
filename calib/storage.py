"""The model file: safetensors, one canonical JSON string, a checksum; nothing that can run."""

from __future__ import annotations

import hashlib
import json
import math
import os
import stat
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .about import About
from .atomic import atomic_write
from .drift.baseline import Baseline
from .errors import CalibError, ModelError
from .links import Wiring
from .maps.graph import Graph
from .maps.lattice import Lattice
from .maps.map import HISTORY, Map
from .plain import finite, numbers, of_type
from .readouts.basis import Basis
from .readouts.linked import Association
from .readouts.local import LocalModels
from .readouts.predictor import Predictor
from .readouts.trend import Trend
from .scale import Scale

if TYPE_CHECKING:
    from .model import Model

FORMAT = 1
"""Version of the format; ``docs/format.md`` describes it."""

_KEY = "calib"
_LARGEST = 2_000_000_000  # bytes
_HEADER = 20_000_000  # bytes; those of the description are among them
_LARGE = 1e15  # no number of a model is so large, and its powers are numbers still
_FUNCTIONS = 100_000  # of a trend
_NONSENSE = (  # what building a model from a description without sense raises
    CalibError,
    AttributeError,
    IndexError,
    KeyError,
    OverflowError,
    TypeError,
    ValueError,
)


def save(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model into one file, whole or not at all.

    The same model gives the same bytes: there are no times, dates or paths inside.
    """
    atomic_write(path, to_bytes(model))


def to_bytes(model: Model) -> bytes:
    """Content of a model file."""
    from safetensors.numpy import save as pack

    tensors = {name: np.ascontiguousarray(a) for name, a in _tensors(model).items()}
    header = {
        "format": FORMAT,
        "about": model.about.to_json(),
        "history": list(model.history),
        "baseline": None if model.baseline is None else model.baseline.to_json(),
        "motor": {"lattice": list(model.motor.lattice.shape)},
        "sensory": {"lattice": list(model.sensory.lattice.shape)},
        "links": asdict(model.association.wiring),
        "trend": {
            "turns": list(model.predictor.trend.basis.turns),
            "degree": model.predictor.trend.basis.degree,
            "each": model.predictor.trend.basis.each,
        },
        "local": {
            "degree": model.predictor.models.degree,
            "samples": model.predictor.models.samples,
        },
    }
    header["sha256"] = _checksum(tensors, header)
    return bytes(pack(tensors, metadata={_KEY: _canonical(header)}))


def _canonical(header: Mapping[str, Any]) -> str:
    return json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def _tensors(model: Model) -> dict[str, NDArray[Any]]:
    links = model.links
    tensors: dict[str, NDArray[Any]] = {
        "links.data": links.data.astype(np.float32),
        "links.indices": links.indices.astype(_unsigned(model.sensory.size)),
        "links.counts": np.diff(links.indptr).astype(np.uint32),
        "trend.coefficients": model.predictor.trend.coefficients,
        "local.radius": model.predictor.models.radius,
        "local.coefficients": model.predictor.models.coefficients,
        "bounds": model.bounds,
        "visited": model.visited.astype(np.uint8),
    }
    if model.baseline is not None:
        tensors["baseline.motor"] = model.baseline.motor.astype(np.float32)
        tensors["baseline.sensory"] = model.baseline.sensory.astype(np.float32)
    for name, part in (("motor", model.motor), ("sensory", model.sensory)):
        tensors[f"{name}.units"] = part.units
        if isinstance(part.lattice, Graph):
            tensors[f"{name}.edges"] = part.edges.astype(_unsigned(part.size))
        tensors[f"{name}.history"] = part.history
        tensors[f"{name}.lower"] = part.scale.lower
        tensors[f"{name}.span"] = part.scale.span
        tensors[f"{name}.periodic"] = part.scale.periodic.astype(np.uint8)
    return tensors


def _unsigned(count: int) -> type[np.unsignedinteger[Any]]:
    return np.uint16 if count <= 1 << 16 else np.uint32


def _checksum(tensors: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> str:
    """SHA-256 of all tensors and of the rest of the description."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        array = tensors[name]
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    rest = {key: value for key, value in header.items() if key != "sha256"}
    digest.update(_canonical(rest).encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def load(path: str | os.PathLike[str]) -> Model:
    """Read a model from its file; neither Pinocchio nor yourdfpy is needed.

    Raises
    ------
    ModelError
        If the file is missing, damaged, edited, of another format or of a newer version.
    """
    path = Path(path)
    try:
        data = _read(path)
    except FileNotFoundError as error:
        raise ModelError(
            f"{path}: no such file, expected a model written by 'calib train'"
        ) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path}: cannot be read ({reason})") from error
    return from_bytes(data, str(path))


def _read(path: Path) -> bytes:
    """Content of a file; of what cannot be a model only as much as tells why."""
    status = path.stat()
    if stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(status.st_mode):  # some never end
        raise ModelError(f"{path}: is a device, expected a model written by 'calib train'")
    if status.st_size > _LARGEST:
        raise ModelError(f"{path}: {status.st_size:,} bytes are too many for a model")
    with path.open("rb") as file:
        start = file.read(_HEADER)
        return start + file.read(_LARGEST) if f'"{_KEY}"'.encode() in start else start


def from_bytes(data: bytes, name: str = "model") -> Model:
    """Read a model from the content of its file; `name` is for messages."""
    header, tensors = _unpack(data, name)
    version = header.get("format")
    if not isinstance(version, int) or version < 1:
        raise ModelError(f"{name}: model format {version!r} is unknown, train the model again")
    if version > FORMAT:
        raise ModelError(
            f"{name}: model format {version} is newer than {FORMAT}, the newest that this "
            "program reads: upgrade it with 'pip install -U calib-arm'"
        )
    if header.get("sha256") != _checksum(tensors, header):
        raise ModelError(
            f"{name}: damaged or edited, it does not match its checksum: restore or train it again"
        )
    try:
        return _build(header, tensors)
    except _NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(f"{name}: not a complete model ({reason}), train it again") from error


def _unpack(data: bytes, name: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Split a safetensors file into the JSON header and the tensors."""
    from safetensors import SafetensorError
    from safetensors.numpy import load as unpack

    try:
        tensors = unpack(data)
        length = int.from_bytes(data[:8], "little")
        metadata = json.loads(data[8 : 8 + length]).get("__metadata__") or {}
    except (SafetensorError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelError(
            f"{name}: not a model file, or damaged: expected what 'calib train' writes"
        ) from error
    if _KEY not in metadata:
        raise ModelError(f"{name}: a safetensors file, but not one that 'calib train' wrote")
    try:
        header = json.loads(metadata[_KEY])
    except (ValueError, RecursionError) as error:
        raise ModelError(f"{name}: damaged, its description is not JSON") from error
    if not isinstance(header, dict):
        raise ModelError(f"{name}: damaged, its description is not a JSON object")
    return header, tensors


def _build(header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> Model:
    from scipy.sparse import csr_array

    from .model import Model

    about = About.from_json(header["about"])
    dof = len(about.joint_names)
    motor = _map("motor", header, tensors, dof)
    sensory = _map("sensory", header, tensors, 2)
    counts = _whole(tensors, "links.counts").astype(np.int64)
    indices = _whole(tensors, "links.indices").astype(np.int32)
    _expect("links.data", tensors["links.data"], indices.shape)
    _expect("links.counts", counts, (motor.size,))
    if counts.sum() != len(indices) or len(indices) != len(tensors["links.data"]):
        raise ValueError("the links' lengths differ")
    if len(indices) and indices.max() >= sensory.size:
        raise ValueError("a link points outside of the sensory map")
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    links = csr_array(
        (tensors["links.data"].astype(float), indices, indptr), shape=(motor.size, sensory.size)
    )
    turns = tuple(float(t) for t in header["trend"]["turns"])
    if len(turns) != dof:
        raise ValueError("the trend is of another arm")
    if not all(0.0 <= turn < _LARGE for turn in turns):  # zero of joints that slide
        raise ValueError(f"{turns} are no turns")
    if math.comb(_small(header["trend"]["degree"], 60) + dof, dof) > _FUNCTIONS:
        raise ValueError("the trend has too many functions")
    basis = Basis(turns, *(_small(header["trend"][k], 60) for k in ("degree", "each")))
    _expect("trend.coefficients", tensors["trend.coefficients"], (len(basis.orders), 2))
    degree = _small(header["local"]["degree"], 3, least=-1)
    models = LocalModels(
        degree,
        int(header["local"]["samples"]),
        tensors["local.radius"],
        tensors["local.coefficients"],
    )
    if degree >= 0:
        from .readouts.basis import exponents

        _expect("local.radius", models.radius, (motor.size,))
        if not (models.radius > 0.0).all():
            raise ValueError("local.radius is not above zero")
        terms = len(exponents(dof, degree))
        _expect("local.coefficients", models.coefficients, (motor.size, terms, 2))
    _expect("bounds", tensors["bounds"], (motor.size,))
    _expect("visited", tensors["visited"], (motor.size,))
    return Model(
        about,
        Association(motor, sensory, links, _wiring(header["links"])),
        Predictor(motor, Trend(basis, tensors["trend.coefficients"]), models),
        tensors["bounds"],
        tensors["visited"].astype(bool),
        _history(header["history"]),
        _baseline(header.get("baseline"), tensors, motor, sensory),
    )


def _baseline(
    stated: Mapping[str, Any] | None, tensors: Mapping[str, NDArray[Any]], motor: Map, sensory: Map
) -> Baseline | None:
    if stated is None:
        return None
    parts = [tensors[f"baseline.{name}"].astype(float) for name in ("motor", "sensory")]
    for name, part, lattice in zip(("motor", "sensory"), parts, (motor, sensory), strict=True):
        _expect(f"baseline.{name}", part, (lattice.size,))
    numbers("spread", stated["spread"], 2)
    finite("noise", stated["noise"])
    return Baseline.from_json(stated, *parts)


def _history(stated: Any) -> tuple[dict[str, Any], ...]:
    from .alignment import Alignment

    states = tuple(of_type("history", state, dict) for state in of_type("history", stated, list))
    for state in states:
        if state.get("frame") is not None:
            Alignment.from_json([numbers("frame", row, 3) for row in state["frame"]])
    return states


def _map(
    name: str, header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]], dim: int
) -> Map:
    shape = tuple(int(n) for n in header[name]["lattice"])
    units = tensors[f"{name}.units"]
    lattice: Lattice | Graph
    if f"{name}.edges" in tensors:
        edges = _whole(tensors, f"{name}.edges").astype(np.intp)
        _expect(f"{name}.edges", edges, (len(edges), 2))
        if not len(edges) or edges.max() >= len(units):
            raise ValueError(f"an edge of the {name} map ends at no node")
        lattice = Graph(len(units), edges)
    else:
        lattice = Lattice(shape)
    _expect(f"{name}.units", units, (lattice.size, dim))
    lower, span = tensors[f"{name}.lower"], tensors[f"{name}.span"]
    _expect(f"{name}.lower", lower, (dim,))
    _expect(f"{name}.span", span, (dim,))
    if not (span > 0.0).all():
        raise ValueError(f"{name}.span is not above zero")
    periodic = tensors[f"{name}.periodic"].astype(bool)
    _expect(f"{name}.periodic", periodic, (dim,))
    history = tensors[f"{name}.history"]
    _expect(f"{name}.history", history, (len(history), len(HISTORY)))
    found = Map(units, lattice, Scale(lower, span, periodic), history)
    if not found.spacing > 0.0:
        raise ValueError(f"the nodes of the {name} map are all in one place")
    return found


def _wiring(stated: Mapping[str, Any]) -> Wiring:
    bandwidth = float(stated["bandwidth"])
    if not 0.0 < bandwidth < 100.0:
        raise ValueError(f"{bandwidth!r} is no bandwidth")
    return Wiring(bool(stated["local"]), bool(stated["mutual"]), bandwidth)


def _expect(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name} holds {array.dtype}, expected numbers")
    if array.dtype.kind == "f" and not (np.abs(array.astype(float)) < _LARGE).all():
        raise ValueError(f"{name} holds a value that is not finite, or beyond {_LARGE:g}")


def _whole(tensors: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    if tensors[name].dtype.kind != "u":
        raise ValueError(f"{name} holds {tensors[name].dtype}, expected whole numbers")
    return tensors[name]


def _small(value: Any, most: int, least: int = 0) -> int:
    if not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{value!r} is not a degree")
    return value
