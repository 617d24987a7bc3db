"""Rig files: a hand-eye calibration as one file, or within a model that was learned from it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.model import Model
from ..model_file.container import check_sum, unpack
from .rig import ARRAYS, KIND, HandEye


def rig_of(document: Mapping[str, Any]) -> HandEye:
    """The rig that `HandEye.document` told.

    Raises KeyError, TypeError, ValueError if it is none.
    """
    values = dict(document)
    for name in ARRAYS:
        values[name] = np.array(document[name], float)
    for name in ("notes", "left_out", "names", "frames", "cameras"):
        values[name] = tuple(document[name])
    return HandEye(**values)


def is_rig(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a rig."""
    try:
        header, _ = unpack(Path(path).read_bytes(), str(path))
    except (OSError, ModelError):
        return False
    return header.get("kind") == KIND


def load_rig(path: str | os.PathLike[str]) -> HandEye:
    """Read a rig from its file.

    Raises ModelError if the file is missing, damaged, edited or no rig.
    """
    name = str(path)
    try:
        header, tensors = unpack(Path(path).read_bytes(), name)
        check_sum(header, tensors, name)
        document: Any = header[KIND]
        return rig_of(document)
    except (OSError, LookupError, TypeError, ValueError) as error:
        raise ModelError(
            f"{name}: no rig: expected what calib handeye -o writes ({error})"
        ) from error


def rig_of_model(model: Model) -> HandEye | None:
    """The rig that a model was learned from; None of others."""
    board: Any = model.about.options.get("board")
    try:
        return rig_of(board[KIND])
    except (LookupError, TypeError, ValueError):
        return None
