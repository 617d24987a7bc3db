"""Storage: a model as the content of a file, and back; nothing in it can run."""

from __future__ import annotations

import os
from typing import TypeVar

import numpy as np

from ..common.atomic import atomic_write
from ..common.parallel import one_blas_thread
from ..errors import CalibError, ModelError
from ..maps.links import SparseRows
from ..model.parts import ModelParts
from .container import check_sum, pack, unpack
from .fields import read, write

VERSION = 8  # of the format, as ``docs/format.md`` describes it
# what building a model from a description without sense raises
NONSENSE = (
    CalibError,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
_M = TypeVar("_M", bound=ModelParts)


def save(model: ModelParts, path: str | os.PathLike[str]) -> None:
    """Write a model into one file, whole or not at all, once it could be read back.

    The same model gives the same bytes: there are no times, dates or paths inside.  Raises
    ModelError if the model's numbers make no file that could be read; an older file stays.
    """
    data = to_bytes(model)
    try:
        model_of(type(model), data, os.fspath(path))
    except ModelError as error:
        raise ModelError(
            f"the new model cannot be read back, so nothing was written: {error.message}",
            hint="an older file was left as it was; please report it with the log",
        ) from error
    atomic_write(path, data)


def to_bytes(model: ModelParts) -> bytes:
    """Content of a model file."""
    with one_blas_thread():  # a covariance is factored on the way into the file
        header, tensors = write(model, type(model))
    return pack({**header, "format": VERSION}, tensors)


def model_of(kind: type[_M], data: bytes, name: str) -> _M:
    """A model of a class from the content of its file; `name` is for messages."""
    header, tensors = unpack(data, name)
    version = header.get("format")
    if header.get("kind") == "rig":
        raise ModelError(
            f"{name}: a rig of flange poses, no model: calib report, calib preview and calib plan "
            "take it"
        )
    if "maps" in header:
        raise ModelError(
            f"{name}: maps alone, no model: `calib.load_maps` reads them"
        )
    if version != VERSION:
        remedy = "an older program wrote it, train the model again"
        if isinstance(version, int) and version > VERSION:
            remedy = "a newer program wrote it, upgrade this one with 'pip install -U calib-arm'"
        raise ModelError(
            f"{name}: model format {version!r}, expected {VERSION}: {remedy}"
        )
    check_sum(header, tensors, name)
    try:
        model = read(kind, header, tensors)
        _check(model)
        for other in model.others:
            _check(other)
    except NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(
            f"{name}: not a complete model ({reason}), train it again"
        ) from error
    return model


def _check_links(links: SparseRows) -> None:
    """Refuse links of nodes that do not exist; ModelError."""
    rows, columns = links.shape
    starts = links.indptr
    ends = (starts[0], starts[-1]) == (0, len(links.indices))
    ordered = len(starts) == rows + 1 and (np.diff(starts) >= 0).all()
    inside = ((links.indices >= 0) & (links.indices < columns)).all()
    if not (ends and ordered and inside):
        raise ModelError("it links nodes that do not exist")


def _check(model: ModelParts) -> None:
    """Refuse a model without an answer; ModelError or what breaks of its parts."""
    _check_links(model.association.linked)
    middle = np.full((1, len(model.about.lower)), 0.5)
    answer = model.predictor.value(middle)
    if model.body is not None:
        q = model.motor.scale.from_unit(middle)
        answer = answer + model.body.bound(q)
    if not np.isfinite(answer).all():
        raise ModelError("it has no answer in the middle of its range")
