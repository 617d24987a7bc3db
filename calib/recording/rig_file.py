"""Rig files: a hand-eye calibration as one file, or within a model that was learned from it."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..common.atomic import atomic_write
from ..errors import ModelError
from ..model.model import Model
from ..model_file.container import check_sum, pack, unpack
from .rig import CameraPlace, HandEye, Photo

KIND = "rig"
VERSION = 1
ARRAYS = ("flange", "misses", "covariance")
TUPLES = ("notes", "left_out", "names", "frames")


def document_of(rig: HandEye) -> dict[str, Any]:
    """All of a rig but its log and its body, as plain values."""
    document: dict[str, Any] = {**rig.to_json(), "convention": rig.convention}
    document |= {name: getattr(rig, name).tolist() for name in ARRAYS}
    document |= {name: list(getattr(rig, name)) for name in TUPLES}
    document["photo"] = None
    if rig.photo is not None:
        document["photo"] = {
            "name": rig.photo.name,
            "camera": rig.photo.camera,
            "jpeg": base64.b64encode(rig.photo.jpeg).decode(),
            "corners": rig.photo.corners.tolist(),
            "predicted": rig.photo.predicted.tolist(),
        }
    return document


def rig_of(document: Mapping[str, Any]) -> HandEye:
    """The rig that `document_of` told.

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
        document["name"], eye, place, document["lens"], document.get("from_first")
    )


def save_rig(rig: HandEye, path: str | os.PathLike[str]) -> None:
    """Write a rig as one file: the same rig gives the same bytes."""
    atomic_write(
        path, pack({"kind": KIND, "format": VERSION, KIND: document_of(rig)}, {})
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
        raise ModelError(f"{name}: cannot be read ({error.strerror})") from error
    if header.get("kind") != KIND or header.get("format") != VERSION:
        raise ModelError(f"{name}: no rig: expected what calib handeye -o writes")
    check_sum(header, tensors, name)
    try:
        return rig_of(header[KIND])
    except (LookupError, TypeError, ValueError) as error:
        raise ModelError(f"{name}: not complete ({error})") from error


def rig_of_model(model: Model) -> HandEye | None:
    """The rig that a model was learned from; None of others."""
    board: Any = model.about.options.get("board")
    try:
        return rig_of(board[KIND])
    except (LookupError, TypeError, ValueError):
        return None
