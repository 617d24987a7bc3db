"""Storage: models and maps in files, and back; nothing in a file can run."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np

from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.atomic import atomic_write
from ..common.parallel import one_blas_thread
from ..errors import CalibError, ModelError
from ..maps.association import Association
from ..maps.links import SparseRows
from ..maps.map import Map
from ..model.model import Model
from .container import MAPS_VERSION, check_sum, pack, unpack
from .fields import Kinds, read, write

VERSION = 9  # of the format, as ``docs/format.md`` describes it
KINDS: Kinds = {Structure: (PlanarStructure, SpatialStructure)}
# what building a model from a description without sense raises
NONSENSE = (
    CalibError,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
_LARGEST = 2_000_000_000  # bytes


def save(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model into one file, whole or not at all, once it could be read back.

    The same model gives the same bytes: there are no times, dates or paths inside.  Raises
    ModelError if the model's numbers make no file that could be read; an older file stays.
    """
    data = to_bytes(model)
    try:
        from_bytes(data, os.fspath(path))
    except ModelError as error:
        raise ModelError(
            f"the new model cannot be read back, so nothing was written: {error.message}",
            hint="an older file was left as it was; please report it with the log",
        ) from error
    atomic_write(path, data)


def to_bytes(model: Model) -> bytes:
    """Content of a model file."""
    with one_blas_thread():  # a covariance is factored on the way into the file
        header, tensors = write(model, Model, KINDS)
    return pack({**header, "format": VERSION}, tensors)


def load(path: str | os.PathLike[str], *, warm: bool = False) -> Model:
    """Read a model from its file; neither Pinocchio nor yourdfpy is needed.

    Where `warm`, :meth:`Model.warm_up` is called, for a control loop.  Raises ModelError if the
    file is missing, damaged, edited, of another format or of a newer version.
    """
    data = _content(Path(path), "expected a model written by 'calib train'")
    model = from_bytes(data, str(path))
    if warm:
        model.warm_up()
    return model


def from_bytes(data: bytes, name: str = "model") -> Model:
    """Read a model from the content of its file; `name` is for messages."""
    header, tensors = unpack(data, name)
    version = header.get("format")
    if header.get("kind") == "rig":
        raise ModelError(
            f"{name}: a rig of flange poses, no model: calib report, calib preview and calib plan "
            "take it"
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
        model = read(Model, header, tensors, KINDS)
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


def _check(model: Model) -> None:
    """Refuse a model without an answer; ModelError or what breaks of its parts."""
    _check_links(model.association.linked)
    middle = np.full((1, len(model.about.lower)), 0.5)
    answer = model.predictor.value(middle)
    if model.body is not None:
        q = model.motor.scale.from_unit(middle)
        answer = answer + model.body.bound(q)
    if not np.isfinite(answer).all():
        raise ModelError("it has no answer in the middle of its range")


def load_maps(path: str | os.PathLike[str]) -> Map | Association:
    """Read what `Map.save` or `Association.save` wrote.

    Raises ModelError if the file is missing, damaged, edited or no file of maps.

    Examples
    --------
    >>> import calib, os, tempfile
    >>> rng = calib.babble(calib.load_arm("two_link"), 200, seed=0)
    >>> maps = calib.train(rng, size=5).association
    >>> path = os.path.join(tempfile.mkdtemp(), "maps.calib")
    >>> maps.save(path)
    >>> calib.load_maps(path)
    Association(...)
    """
    name = str(path)
    header, tensors = unpack(
        _content(Path(path), "expected maps that `save` wrote"), name
    )
    kinds = {"map": Map, "association": Association}
    kind = kinds.get(str(header.get("kind")))
    if kind is None or header.get("format") != MAPS_VERSION:
        raise ModelError(
            f"{name}: no file of maps: expected what `save` of a map writes"
        )
    check_sum(header, tensors, name)
    try:
        maps: Map | Association = read(kind, header["maps"], tensors, {})
    except NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(f"{name}: not complete ({reason})") from error
    return maps


def _content(path: Path, expected: str) -> bytes:
    """Bytes of a file of a sensible size."""
    try:
        status = path.stat()
        if stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(
            status.st_mode
        ):  # some never end
            raise ModelError(f"{path}: is a device, {expected}")
        if status.st_size > _LARGEST:
            raise ModelError(
                f"{path}: {status.st_size:,} bytes are too many for a model"
            )
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such file, {expected}") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path}: cannot be read ({reason})") from error
