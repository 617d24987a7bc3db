"""Meshes: files that a URDF names, read from one folder and nowhere else, and bounded.

A URDF is a stranger's text. Its file names are looked up below the folder that the user gives; what
leads elsewhere, by `..`, by a symbolic link or by an address, is refused, and nothing is fetched
from a network. Text of 50 MB becomes a gigabyte of Python objects: sizes are bounded before any
reader looks.
"""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from ...common.wording import INSTALL
from ...errors import RobotError

_KINDS = (".stl", ".obj", ".dae")  # what ROS reads; others can declare more than they hold
_MOST_BYTES, _MOST_TEXT = 50_000_000, 10_000_000  # a reader makes some twenty bytes of one of text
_MOST_VERTICES = 3_000_000  # with all instances


def resolve_mesh(name: str, folder: Path) -> Path:
    """Return the file of a mesh's name in a URDF.

    name : a relative path, ``package://PACKAGE/PATH`` (looked for as PACKAGE/PATH and as PATH in
        the folder) or ``file://PATH``
    Raises RobotError if there is no such file, or it lies elsewhere.
    """
    parts, root = urlsplit(name), folder.resolve()
    path, options = unquote(parts.path), [name]
    if parts.scheme in ("package", "model"):
        options = [f"{parts.netloc}/{path.lstrip('/')}", path.lstrip("/")]
    elif parts.scheme == "file" and parts.netloc in ("", "localhost"):
        options = [path]
    elif len(parts.scheme) > 1:  # C: is a drive
        raise RobotError(f"mesh {name!r}: only files are read, nothing is fetched")
    for option in options:
        with suppress(OSError, RuntimeError, ValueError):  # no name of a file
            found = (root / option).resolve()
            if found.is_relative_to(root) and found.is_file():
                return found
    raise RobotError(f"mesh {name!r}: no such file in {folder}, and nothing outside of it is read")


def _refuse(*_: object) -> None:
    raise ValueError("it holds a document type")


def read_mesh(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Read vertices (n, 3) [m] and faces (m, 3) of a mesh file; materials are left out.

    Raises RobotError if it is too large, of an unknown kind, or damaged.
    """
    kind = path.suffix.lower()
    if kind not in _KINDS:
        raise RobotError(f"mesh {path.name}: kind {kind or 'none'}, expected {', '.join(_KINDS)}")
    with path.open("rb") as file:
        # a binary STL has a size that its number of triangles tells
        text = kind != ".stl" or b"\0" not in file.read(1024)
    if path.stat().st_size > (most := _MOST_TEXT if text else _MOST_BYTES):
        raise RobotError(
            f"mesh {path.name}: {path.stat().st_size / 1e6:.0f} MB of {'text' if text else 'data'}"
            f", at most {most // 1_000_000} MB are drawn",
            hint="convert it to binary STL" if text else "reduce the number of its triangles",
        )
    data = path.read_bytes()
    if kind == ".dae":  # a search for bytes misses UTF-16: a parser looks
        parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = _refuse
        try:
            parser.Parse(data, True)
        except (expat.ExpatError, ValueError, LookupError) as error:
            raise RobotError(f"mesh {path.name}: {error}, expected XML without one") from None
    try:
        import trimesh
    except ImportError:
        raise RobotError(f"mesh {path.name} needs trimesh: {INSTALL.format('meshes')}") from None
    loader: Any = trimesh
    try:
        mesh: Any = loader.load(io.BytesIO(data), file_type=kind[1:], force="mesh", process=False)
        vertices = np.asarray(mesh.vertices, dtype=np.float32).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.uint32).reshape(-1, 3)
    except Exception as error:  # whatever the reader of one of the formats throws
        raise RobotError(f"mesh {path.name}: cannot be read ({error})") from error
    if max(len(vertices), len(faces)) > _MOST_VERTICES:
        raise RobotError(f"mesh {path.name}: more than {_MOST_VERTICES:,} vertices or triangles")
    if not len(faces) or not np.isfinite(vertices).all() or faces.max() >= len(vertices):
        raise RobotError(f"mesh {path.name}: holds no triangles")
    # STL repeats each vertex for each of its triangles, five or six times
    vertices, where = np.unique(vertices, axis=0, return_inverse=True)
    return vertices, where.reshape(-1)[faces].astype(np.uint32)
