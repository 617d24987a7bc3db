"""Loading: a model from its file."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path

from ..errors import ModelError
from ..model.model import Model
from .storage import content, parts_of


def load(path: str | os.PathLike[str], *, warm: bool = False) -> Model:
    """Read a model from its file; neither Pinocchio nor yourdfpy is needed.

    Where `warm`, :meth:`Model.warm_up` is called, for a control loop.

    Raises
    ------
    ModelError
        If the file is missing, damaged, edited, of another format or of a newer version.
    """
    path = Path(path)
    try:
        data = content(path)
    except (OSError, ValueError) as error:
        missing = "no such file, expected a model written by 'calib train'"
        told = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise ModelError(
            f"{path}: {missing if isinstance(error, FileNotFoundError) else told}"
        ) from error
    model = from_bytes(data, str(path))
    if warm:
        model.warm_up()
    return model


def from_bytes(data: bytes, name: str = "model") -> Model:
    """Read a model from the content of its file; `name` is for messages."""
    parts = parts_of(data, name)
    return Model(**{each.name: getattr(parts, each.name) for each in fields(parts)})
