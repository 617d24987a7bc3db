"""Rig files: a hand-eye calibration as one file, or within a model that was learned from it."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.model import Model
from ..model_file.container import check_sum, unpack
from .rig import ARRAYS, KIND, TUPLES, VERSION, CameraPlace, HandEye, Photo


def rig_of(document: Mapping[str, Any]) -> HandEye:
    """The rig that `HandEye.document` told.

    Raises KeyError, TypeError, ValueError if it is none.
    """
    values = {
        field.name: document[field.name]
        for field in fields(HandEye)
        if field.name not in ("poses", "body")
    }
    values |= {name: np.array(document[name], float) for name in ARRAYS}
    values |= {name: tuple(document[name]) for name in TUPLES}
    values["cameras"] = tuple(_camera(camera) for camera in document["cameras"])
    photo = document["photo"]
    if photo is not None:
        values["photo"] = Photo(
            name=photo["name"],
            camera=photo["camera"],
            jpeg=base64.b64decode(photo["jpeg"]),
            corners=np.array(photo["corners"], float).reshape(-1, 2),
            predicted=np.array(photo["predicted"], float).reshape(-1, 2),
        )
    return HandEye(**values)


def _camera(document: Mapping[str, Any]) -> CameraPlace:
    eye = document["eye"]
    place = document["hand" if eye == "hand" else "base"]
    return CameraPlace(
        document["name"],
        eye,
        place,
        document["lens"],
        document.get("from_first"),
    )


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
    except OSError as error:
        raise ModelError(
            f"{name}: cannot be read ({error.strerror})"
        ) from error
    if header.get("kind") != KIND or header.get("format") != VERSION:
        raise ModelError(
            f"{name}: no rig: expected what calib handeye -o writes"
        )
    check_sum(header, tensors, name)
    document: Any = header[KIND]
    try:
        return rig_of(document)
    except (LookupError, TypeError, ValueError) as error:
        raise ModelError(f"{name}: not complete ({error})") from error


def rig_of_model(model: Model) -> HandEye | None:
    """The rig that a model was learned from; None of others."""
    board: Any = model.about.options.get("board")
    try:
        return rig_of(board[KIND])
    except (LookupError, TypeError, ValueError):
        return None
