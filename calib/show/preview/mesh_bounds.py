"""Bounds of mesh files: what a few bytes may ask a reader to make, checked before it is asked.

A GLB of some hundred bytes can declare a billion vertices, and text of 50 MB becomes a gigabyte
of Python objects. Use `check_mesh` on the bytes of a file before any reader sees them.
"""

from __future__ import annotations

import json
import re
from typing import Any
from xml.parsers import expat

from ...errors import RobotError

MAX_BYTES = 50_000_000
"""Bytes of a binary file that are read."""

MAX_TEXT = 10_000_000
"""Bytes of a file of text: its readers make some twenty bytes of each."""

MAX_VERTICES = 3_000_000
"""Vertices of a mesh with all its instances."""

_TEXT = (".obj", ".dae")
_PLY_ELEMENT = re.compile(rb"^element\s+\S+\s+(\S+)\s*$", re.MULTILINE)
_ITEM = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_PARTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def check_mesh(name: str, kind: str, data: bytes) -> None:
    """Refuse a mesh file, `kind` its ending such as ".glb", that asks for more than it holds.

    Raises RobotError if it is too large, holds a document type, or declares more than its bytes can
    be.
    """
    text = kind in _TEXT or (kind in (".stl", ".ply") and _is_text(data))
    most = MAX_TEXT if text else MAX_BYTES
    if len(data) > most:
        raise RobotError(
            f"mesh {name}: {len(data) / 1e6:.0f} MB of {'text' if text else 'data'}, at most "
            f"{most // 1_000_000} MB are drawn",
            hint="convert it to binary STL" if text else "reduce the number of its triangles",
        )
    if kind == ".dae":
        _forbid_doctype(name, data)
    elif kind == ".ply":
        _check_ply(name, data)
    elif kind == ".glb":
        _check_glb(name, data)


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:1024]


def _forbid_doctype(name: str, data: bytes) -> None:
    """Let a parser look for document types: a search for bytes misses UTF-16."""

    def refuse(*_: object) -> None:
        raise RobotError(f"mesh {name}: holds a document type, which is refused")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise RobotError(f"mesh {name}: is no XML ({error})") from None


def _check_ply(name: str, data: bytes) -> None:
    """Each element of a PLY takes a byte at least."""
    header = data[: data.find(b"end_header") + 1] or data[:65_536]
    total = 0
    for count in _PLY_ELEMENT.findall(header):
        total += int(count) if count.isdigit() and len(count) < 12 else len(data) + 1
    if total > len(data):
        raise _more_than_held(name, total)


def _check_glb(name: str, data: bytes) -> None:
    """Arrays of a GLB lie within its bytes; its scene is a tree whose instances are bounded."""
    try:
        length = int.from_bytes(data[12:16], "little")
        described = json.loads(data[20 : 20 + length])
        counts = [_elements(name, described, a, len(data)) for a in described.get("accessors", [])]
        if _vertices(described, counts) > MAX_VERTICES:
            raise _more_than_held(name, MAX_VERTICES + 1)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise RobotError(f"mesh {name}: damaged, its description makes no sense") from error


def _elements(name: str, described: dict[str, Any], accessor: dict[str, Any], size: int) -> int:
    """Return the number of elements of an array whose bytes the file holds."""
    count = int(accessor["count"])
    item = _ITEM[accessor["componentType"]] * _PARTS[accessor["type"]]
    if "sparse" in accessor or accessor.get("bufferView") is None:
        raise _more_than_held(name, count)
    view = described["bufferViews"][int(accessor["bufferView"])]
    if count < 0 or count * item > min(int(view["byteLength"]), size):
        raise _more_than_held(name, count)
    return count


def _vertices(described: dict[str, Any], counts: list[int]) -> int:
    """Vertices and indices of all instances in the scene, whose nodes have one parent at most."""
    meshes = [
        sum(
            sum(counts[int(k)] for k in part.get("attributes", {}).values())
            + (counts[int(part["indices"])] if "indices" in part else 0)
            for part in mesh.get("primitives", [])
        )
        for mesh in described.get("meshes", [])
    ]
    nodes = described.get("nodes", [])
    parents = [0] * len(nodes)
    for node in nodes:
        for child in node.get("children", []):
            parents[int(child)] += 1
    if max(parents, default=0) > 1:
        raise ValueError("a node with two parents")
    total = sum(meshes)
    for node in nodes:
        total += meshes[int(node["mesh"])] if "mesh" in node else 0
    return total


def _more_than_held(name: str, count: int) -> RobotError:
    return RobotError(f"mesh {name}: declares {count:,} values, more than its bytes can hold")
