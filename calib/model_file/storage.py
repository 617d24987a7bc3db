"""The model file: safetensors, one canonical JSON string, a checksum; nothing that can run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.atomic import atomic_write
from ..common.parallel import one_blas_thread
from ..errors import CalibError, ModelError
from ..maps.association import Association
from ..maps.lattice import Graph
from ..maps.local_models import MOST_DEGREE, LocalModels, exponents
from ..maps.map import Map
from ..model.about import MOST_ROWS, About
from ..model.alignment import Alignment
from ..model.facts import shown_errors
from ..model.parts import Parts
from .fields import read, write

VERSION = 7  # of the format, as ``docs/format.md`` describes it
KINDS = {Structure: (PlanarStructure, SpatialStructure)}
_KEY = "calib"
_TINY = 1e-300  # the least number above zero
_WIDEST = 1e9  # range of a joint [rad or m]
# what building a model from a description without sense raises
_NONSENSE = (CalibError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
_M = TypeVar("_M", bound=Parts)


def save(model: Parts, path: str | os.PathLike[str]) -> None:
    """Write a model into one file, whole or not at all, once it could be read back.

    The same model gives the same bytes: there are no times, dates or paths inside.  Raises
    ModelError if the model's numbers make no file that could be read; an older file stays.
    """
    data = to_bytes(model)
    try:
        parts_of(Parts, data, os.fspath(path))
    except ModelError as error:
        raise ModelError(
            f"the new model cannot be read back, so nothing was written: {error.message}",
            hint="an older file was left as it was; please report it with the log",
        ) from error
    atomic_write(path, data)


def to_bytes(model: Parts) -> bytes:
    """Content of a model file."""
    from safetensors.numpy import save as pack

    with one_blas_thread():  # a covariance is factored on the way into the file
        header, tensors = write(model, Parts, KINDS)
    header["format"] = VERSION
    header["sha256"] = _checksum(tensors, header)
    return bytes(pack(tensors, metadata={_KEY: _canonical(header)}))


def parts_of(kind: type[_M], data: bytes, name: str) -> _M:
    """A model of a class from the content of its file; `name` is for messages."""
    header, tensors = _unpack(data, name)
    version = header.get("format")
    if version != VERSION:
        remedy = "an older program wrote it, train the model again"
        if isinstance(version, int) and version > VERSION:
            remedy = "a newer program wrote it, upgrade this one with 'pip install -U calib-arm'"
        raise ModelError(f"{name}: model format {version!r}, expected {VERSION}: {remedy}")
    if header.get("sha256") != _checksum(tensors, header):
        raise ModelError(
            f"{name}: damaged or edited, it does not match its checksum: restore or train it again"
        )
    try:
        model: _M = read(kind, header, tensors, KINDS)
        _check(model)
    except _NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(f"{name}: not a complete model ({reason}), train it again") from error
    return model


def _canonical(header: Mapping[str, Any]) -> str:
    return json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def _checksum(tensors: Mapping[str, NDArray[Any]], header: Mapping[str, Any]) -> str:
    """SHA-256 of all tensors and of the rest of the description."""
    digest = hashlib.sha256()
    # names, types and shapes count too: the same bytes may be read as other tensors
    for name in sorted(tensors):
        array = tensors[name]
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    rest = {key: value for key, value in header.items() if key != "sha256"}
    # a text may hold a lone surrogate, which UTF-8 alone refuses
    digest.update(_canonical(rest).encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def _unpack(data: bytes, name: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Split a safetensors file into the JSON header and the tensors."""
    from safetensors import SafetensorError
    from safetensors.numpy import load as unpack

    try:
        tensors = unpack(data)
        length = int.from_bytes(data[:8], "little")
        header = json.loads(json.loads(data[8 : 8 + length])["__metadata__"][_KEY])
        return {**header}, tensors
    except (SafetensorError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelError(
            f"{name}: not a model file, or damaged: expected what 'calib train' writes"
        ) from error


def _check(model: Parts) -> None:
    """Refuse a model whose parts are none, or are not of one; ModelError or what breaks of it."""
    about, motor, body, models = model.about, model.motor, model.body, model.local
    # joints are asked in the unit box of the map: other limits would shift every answer
    span = motor.scale.span
    apart = np.abs([about.lower - motor.scale.lower, about.upper - about.lower - span])
    if not (
        _about(about)
        and _maps(model.association)
        and (apart <= 1e-6 * span).all()
        and (models.degree < 0 or _local(models, model.association))
        and (body is None or _body(body, len(about.lower)))
        and min(model.bounds.min(), model.model_bounds.min()) >= 0.0
        and model.visited.any()
        and (model.rows is None or len(model.rows) <= MOST_ROWS)
        and (
            model.baseline is None or model.baseline.seen is None or model.baseline.seen.places.size
        )
    ):
        raise ModelError("its parts do not fit together")
    for state in model.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    tuple(shown_errors(about, about.errors) if about.errors else ())
    middle = np.full((1, len(about.lower)), 0.5)
    answer = model.predictor.value(middle)  # what makes no sense breaks here, if nowhere before
    bound = 0.0 if body is None else body.bound(motor.scale.from_unit(middle))
    if not np.isfinite(answer + bound).all():
        raise ModelError("it has no answer in the middle of its range")


def _about(own: About) -> bool:
    names, sizes = own.joint_names, own.upper - own.lower
    return (
        all(names)
        and 1 <= len(set(names)) == len(names) == len(own.revolute) == len(sizes)
        and bool(((sizes > 0.0) & (sizes < _WIDEST)).all())
        and (own.plane is None or {"origin", "x", "y"} <= set(own.plane))
        and all(isinstance(each, str) for each in (own.simulation or {}).get("changes", ()))
        and min(*(own.picture or (1,)), own.samples - 1, own.seed, own.tested, own.left_out) >= 0
        and {"map", "rule", "epochs", "sigma"} <= set(own.options)
        and all(
            {"x", "y", "distance"} <= set(told["forward"])
            and {*names, "distance"} <= set(told["inverse"])
            for told in own.errors.values()
        )
    )


def _maps(own: Association) -> bool:
    links, first = own.linked, own.linked.indptr.astype(np.int64)
    return (
        all(map(_map, (own.motor, own.sensory)))
        and own.sensory.units.shape[1] in (2, 3)
        and links.shape == (own.motor.size, own.sensory.size)
        and len(first) == own.motor.size + 1
        and (first[0], first[-1]) == (0, len(links.data))
        and bool((np.diff(first) >= 0).all() and (links.data > 0.0).all() and len(links.data))
        and bool((links.indices >= 0).all() and (links.indices < own.sensory.size).all())
        and 1e-3 <= own.wiring.bandwidth <= 100.0
    )


def _map(own: Map) -> bool:
    lattice: Any = own.lattice
    return bool(
        lattice.size == len(own.units)
        and (not isinstance(lattice, Graph) or lattice.pairs.max(initial=0) < lattice.size)
        and not (own.scale.span < _TINY).any()
        and own.spacing > 0.0  # steps and cells are counted in the distance of nodes
    )


def _local(own: LocalModels, maps: Association) -> bool:
    (nodes, dof), width = maps.motor.units.shape, maps.sensory.units.shape[1]
    return (
        own.degree <= MOST_DEGREE
        and own.coefficients.shape == (nodes, len(exponents(dof, own.degree)), width)
        and len(own.radius) == nodes
        and not (own.radius < _TINY).any()
    )


def _body(own: Body, dof: int) -> bool:
    structure, beliefs = own.structure, tuple(each for each in (own, own.second) if each)
    return (
        structure.dof == dof
        and all(
            (len(each.beta), len(each.noise)) == (structure.size, structure.outputs)
            and (np.diff(each.active) > 0).all()
            and each.root.any(axis=1).all()
            and not (each.noise < _TINY).any()
            for each in beliefs
        )
        and 1.0 <= own.kappa < np.inf
        and own.nu >= 2.0
        and min(own.autocorrelation, own.repeat, own.rows, own.tau.min(), own.residual.min()) >= 0.0
    )
