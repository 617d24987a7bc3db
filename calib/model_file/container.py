"""Container: named arrays and one JSON object in a safetensors file, with a checksum."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping

from ..common.atomic import atomic_write
from ..errors import ModelError
from .fields import Tensors, write

MAPS_VERSION = 1  # of files of maps
_KEY = "calib"


def pack(header: Mapping[str, object], tensors: Tensors) -> bytes:
    """Content of a file: the same header and tensors give the same bytes."""
    from safetensors.numpy import save

    summed = {**header, "sha256": _checksum(tensors, header)}
    return bytes(save(tensors, metadata={_KEY: _canonical(summed)}))


def unpack(data: bytes, name: str) -> tuple[dict[str, object], Tensors]:
    """Split the content of a file into header and tensors; `name` is for messages."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        tensors = load(data)
        length = int.from_bytes(data[:8], "little")
        header = json.loads(
            json.loads(data[8 : 8 + length])["__metadata__"][_KEY]
        )
        return {**header}, tensors
    except (
        SafetensorError,
        ValueError,
        KeyError,
        TypeError,
        RecursionError,
    ) as error:
        raise ModelError(
            f"{name}: not a model file, or damaged: expected what 'calib train' writes"
        ) from error


def check_sum(
    header: Mapping[str, object], tensors: Tensors, name: str
) -> None:
    """Refuse a file that does not match its checksum."""
    if header.get("sha256") != _checksum(tensors, header):
        raise ModelError(
            f"{name}: damaged or edited, it does not match its checksum: restore or train it again"
        )


def _canonical(header: Mapping[str, object]) -> str:
    return json.dumps(
        header, sort_keys=True, separators=(",", ":"), ensure_ascii=False
    )


def _checksum(tensors: Tensors, header: Mapping[str, object]) -> str:
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


def save_maps(maps: object, path: str | os.PathLike[str]) -> None:
    """Write a map or an association into one file, whole or not at all."""
    header, tensors = write(maps, type(maps))
    kind = type(maps).__name__.lower()
    atomic_write(
        path,
        pack({"maps": header, "kind": kind, "format": MAPS_VERSION}, tensors),
    )
