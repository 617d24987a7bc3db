"""Meshes: files that a URDF names, read from one folder and nowhere else, and bounded.

A URDF is a stranger's text. Its file names are looked up below the folder that the user gives; what
leads elsewhere, by `..`, by a symbolic link or by an address, is refused, and nothing is fetched
from a network. A GLB of some hundred bytes can declare a billion vertices, and text of 50 MB
becomes a gigabyte of Python objects: `check_mesh` looks at the bytes before any reader does.
"""

from __future__ import annotations

import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from ...errors import RobotError

_KINDS = (".stl", ".obj", ".ply", ".dae", ".glb")


@dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh: vertices (n, 3) [m] and faces (m, 3)."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


def resolve_mesh(name: str, folder: Path) -> Path:
    """Return the file of a mesh's name in a URDF.

    name : a relative path, ``package://PACKAGE/PATH`` (looked for as PACKAGE/PATH and as PATH in
        the folder) or ``file://PATH``
    Raises RobotError if there is no such file, or it lies elsewhere.
    """
    if "\0" in name or not name.strip():
        raise RobotError(f"mesh {name!r}: expected the name of a file")
    parts = urlsplit(name)
    path = unquote(parts.path)
    if parts.scheme in ("package", "model"):
        rest = path.lstrip("/")
        options = [Path(parts.netloc) / rest, Path(rest)]
    elif parts.scheme == "file" and parts.netloc in ("", "localhost"):
        options = [Path(path)]
    elif parts.scheme and len(parts.scheme) > 1:  # C: is a drive
        raise RobotError(f"mesh {name!r}: only files are read, nothing is fetched")
    else:
        options = [Path(name)]
    root = folder.resolve()
    escaped = False
    for option in options:
        try:
            found = (root / option).resolve()
        except (OSError, RuntimeError, ValueError):
            continue
        if not found.is_relative_to(root):
            escaped = True
        elif found.is_file():
            return found
    if escaped:
        raise RobotError(f"mesh {name!r}: lies outside of {folder}, which is not allowed")
    raise RobotError(f"mesh {name!r}: no such file in {folder}")


def read_mesh(path: Path) -> Triangles:
    """Read the triangles of a mesh file; materials and textures are left out.

    Raises RobotError if it is too large, of an unknown kind, or damaged.
    """
    kind = path.suffix.lower()
    if kind not in _KINDS:
        raise RobotError(f"mesh {path.name}: kind {kind or 'none'}, expected {', '.join(_KINDS)}")
    if path.stat().st_size > _MOST_BYTES:
        raise RobotError(
            f"mesh {path.name}: {path.stat().st_size / 1e6:.0f} MB, at most "
            f"{_MOST_BYTES // 1_000_000} MB are drawn"
        )
    data = path.read_bytes()
    check_mesh(path.name, kind, data)
    import trimesh

    loader: Any = trimesh
    try:
        mesh: Any = loader.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
        vertices = np.asarray(mesh.vertices, dtype=np.float32).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.uint32).reshape(-1, 3)
    except Exception as error:  # whatever the reader of one of the formats throws
        raise RobotError(f"mesh {path.name}: cannot be read ({error})") from error
    if len(vertices) > _MOST_VERTICES or len(faces) > _MOST_VERTICES:
        raise RobotError(f"mesh {path.name}: more than {_MOST_VERTICES:,} vertices or triangles")
    if not len(faces) or not np.isfinite(vertices).all() or faces.max() >= len(vertices):
        raise RobotError(f"mesh {path.name}: holds no triangles")
    # STL repeats each vertex for each of its triangles, five or six times
    vertices, where = np.unique(vertices, axis=0, return_inverse=True)
    return Triangles(vertices, where.reshape(-1)[faces].astype(np.uint32))


_MOST_BYTES = 50_000_000
"""Bytes of a binary file that are read."""

_MOST_TEXT = 10_000_000
"""Bytes of a file of text: its readers make some twenty bytes of each."""

_MOST_VERTICES = 3_000_000
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
    most = _MOST_TEXT if text else _MOST_BYTES
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
        if _vertices(described, counts) > _MOST_VERTICES:
            raise _more_than_held(name, _MOST_VERTICES + 1)
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
