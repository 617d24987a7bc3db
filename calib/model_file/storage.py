"""The model file: safetensors, one canonical JSON string, a checksum; nothing that can run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from typing import Any, TypeVar

from numpy.typing import NDArray

from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.atomic import atomic_write
from ..common.parallel import one_blas_thread
from ..errors import CalibError, ModelError
from ..model.parts import Parts
from .fields import read, write
from .sense import check

VERSION = 5  # of the format, as ``docs/format.md`` describes it
KINDS = {Structure: (PlanarStructure, SpatialStructure)}
_KEY = "calib"
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
        check(model)
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
