"""Loading: a model from its file."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from ..errors import ModelError
from ..model.model import Model
from .storage import parts_of

_LARGEST = 2_000_000_000  # bytes


def load(path: str | os.PathLike[str], *, warm: bool = False) -> Model:
    """Read a model from its file; neither Pinocchio nor yourdfpy is needed.

    Where `warm`, :meth:`Model.warm_up` is called, for a control loop.  Raises ModelError if the
    file is missing, damaged, edited, of another format or of a newer version.
    """
    path, expected = Path(path), "expected a model written by 'calib train'"
    try:
        status = path.stat()
        if stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(status.st_mode):  # some never end
            raise ModelError(f"{path}: is a device, {expected}")
        if status.st_size > _LARGEST:
            raise ModelError(f"{path}: {status.st_size:,} bytes are too many for a model")
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such file, {expected}") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path}: cannot be read ({reason})") from error
    model = from_bytes(data, str(path))
    if warm:
        model.warm_up()
    return model


def from_bytes(data: bytes, name: str = "model") -> Model:
    """Read a model from the content of its file; `name` is for messages."""
    return parts_of(Model, data, name)
