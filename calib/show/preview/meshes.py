"""Meshes: files that a URDF names, read from one folder and nowhere else.

A URDF is a stranger's text. Its file names are looked up below the folder that the user
gives; what leads elsewhere, by `..`, by a symbolic link or by an address, is refused, and
nothing is ever fetched from a network.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from ...errors import RobotError
from .mesh_bounds import MAX_BYTES, MAX_VERTICES, check_mesh

KINDS = (".stl", ".obj", ".ply", ".dae", ".glb")


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
    if kind not in KINDS:
        raise RobotError(f"mesh {path.name}: kind {kind or 'none'}, expected {', '.join(KINDS)}")
    if path.stat().st_size > MAX_BYTES:
        raise RobotError(
            f"mesh {path.name}: {path.stat().st_size / 1e6:.0f} MB, at most "
            f"{MAX_BYTES // 1_000_000} MB are drawn"
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
    if len(vertices) > MAX_VERTICES or len(faces) > MAX_VERTICES:
        raise RobotError(f"mesh {path.name}: more than {MAX_VERTICES:,} vertices or triangles")
    if not len(faces) or not np.isfinite(vertices).all() or faces.max() >= len(vertices):
        raise RobotError(f"mesh {path.name}: holds no triangles")
    vertices, where = np.unique(vertices, axis=0, return_inverse=True)
    return Triangles(vertices, where.reshape(-1)[faces].astype(np.uint32))
