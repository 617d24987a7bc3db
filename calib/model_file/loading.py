"""Loading: a model, or maps, from a file."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import ModelError
from ..maps.association import Association
from ..maps.map import Map
from ..model.model import Model
from .container import MAPS_VERSION, check_sum, unpack
from .fields import read
from .storage import NONSENSE, model_of

_LARGEST = 2_000_000_000  # bytes


def load(path: str | os.PathLike[str], *, warm: bool = False) -> Model:
    """Read a model from its file; Pinocchio is not needed.

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
    return model_of(Model, data, name)


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
        maps: Map | Association = read(kind, header["maps"], tensors)
    except NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(f"{name}: not complete ({reason})") from error
    return maps


def _content(path: Path, expected: str) -> bytes:
    """Bytes of a file of a sensible size."""
    try:
        if path.is_char_device() or path.is_block_device():  # some never end
            raise ModelError(f"{path}: is a device, {expected}")
        size = path.stat().st_size
        if size > _LARGEST:
            raise ModelError(f"{path}: {size:,} bytes are too many for a model")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such file, {expected}") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path}: cannot be read ({reason})") from error
