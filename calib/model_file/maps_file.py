"""Maps in a file of their own: a map, or two with their links."""

from __future__ import annotations

import os

from ..common.atomic import atomic_write
from .container import pack
from .fields import write

MAPS_VERSION = 1


def save_maps(maps: object, path: str | os.PathLike[str]) -> None:
    """Write a map or an association into one file, whole or not at all."""
    header, tensors = write(maps, type(maps), {})
    kind = type(maps).__name__.lower()
    atomic_write(
        path,
        pack({"maps": header, "kind": kind, "format": MAPS_VERSION}, tensors),
    )
