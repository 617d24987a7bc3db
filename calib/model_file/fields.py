"""Fields: any dataclass as plain data and arrays, and back, as its own annotations say.

Arrays are annotated with their axes, see `calib.common.arrays.Shape`: they become tensors that are
named by their place, such as ``about.lower``.  Everything else becomes JSON.  What is read may come
from a stranger: types, shapes, and that numbers are finite, are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import pack, unpack
from ..common.arrays import TRIANGLE, Shape
from ..common.rows import LARGEST
from ..errors import ModelError

Tensor = NDArray[np.generic]
Tensors = dict[str, Tensor]
T = TypeVar("T")
Sizes = dict[str, int]
"""Lengths of axes, by their names."""

Kinds = Mapping[type, tuple[type, ...]]
"""Classes that may stand for a base class; a key `kind` tells which."""

_MISSING = object()  # of no type


@dataclass(frozen=True)
class Hint:
    """What an annotation says."""

    kinds: tuple[type, ...]  # types that a value may have
    optional: bool
    shape: Shape | None = None  # of an array

    @staticmethod
    def of(annotation: object) -> Hint:
        """Return what an annotation says."""
        kinds: tuple[type, ...] = (annotation,)  # type: ignore[assignment]
        if get_origin(annotation) in (UnionType, Union):
            kinds = get_args(annotation)
        optional = NoneType in kinds
        kinds = tuple(kind for kind in kinds if kind is not NoneType)
        if get_origin(kinds[0]) is not Annotated:
            return Hint(kinds, optional)
        kind, shape = get_args(kinds[0])
        return Hint((kind,), optional, shape)

    @property
    def item(self) -> Hint | None:
        """What each item of a tuple of objects is; None of anything else."""
        if get_origin(self.kinds[0]) is not tuple:
            return None
        item = Hint.of(get_args(self.kinds[0])[0])
        return item if is_dataclass(item.kinds[0]) else None

    def classes(self, kinds: Kinds) -> dict[str, type]:
        """Return the classes that a value may be of, by name."""
        classes = [
            one for kind in self.kinds for one in kinds.get(kind, (kind,))
        ]
        return {_name(one): one for one in classes}


@cache
def _hints(kind: type) -> dict[str, Hint]:
    """Return the annotations of a dataclass's fields, but for those that no file keeps."""
    hints = get_type_hints(kind, include_extras=True)
    names = [
        part.name for part in fields(kind) if part.metadata.get("kept", True)
    ]
    return {name: Hint.of(hints[name]) for name in names}


def _name(kind: type) -> str:
    return str(getattr(kind, "kind", getattr(kind, "__name__", "").lower()))


def _under(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def write(
    value: object, kind: type, kinds: Kinds
) -> tuple[dict[str, object], Tensors]:
    """Return a dataclass of a type as JSON-ready data, and its arrays by name."""
    writer = _Writer(kinds)
    return writer.object_of(value, Hint.of(kind), ""), writer.tensors


@dataclass
class _Writer:
    kinds: Kinds
    tensors: Tensors = field(default_factory=dict)

    def data_of(self, value: object, hint: Hint, path: str) -> object:
        """Return a value as plain data."""
        if hint.item is not None and isinstance(value, tuple):
            places = [_under(path, str(k)) for k in range(len(value))]
            pairs = zip(value, places, strict=True)
            return [
                self.object_of(one, hint.item, place) for one, place in pairs
            ]
        if is_dataclass(value):
            return self.object_of(value, hint, path)
        return _json(value)

    def object_of(
        self, value: object, hint: Hint, path: str
    ) -> dict[str, object]:
        """Return an object as plain data; its arrays are tensors."""
        data: dict[str, object] = {}
        kind: type = type(value)
        if len(hint.classes(self.kinds)) > 1:
            data["kind"] = _name(kind)
        for name, inner in _hints(kind).items():
            part = getattr(value, name)
            place = _under(path, name)
            if inner.shape is None:
                data[name] = self.data_of(part, inner, place)
            elif part is not None:
                self.tensors[place] = _stored(part, inner.shape)
        return data


def _json(value: object) -> object:
    """Return plain data: tuples as lists, infinite numbers and those that are none as null."""
    if isinstance(value, Mapping):
        return {str(key): _json(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_json(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _stored(value: Tensor | bytes, shape: Shape) -> Tensor:
    """Return an array as a file keeps it: whole numbers in as few bytes as they need."""
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    array = pack(value.astype(float)) if shape.kept == TRIANGLE else value
    kind: np.dtype[np.generic] = shape.stored
    if array.dtype.kind != "f":
        kind = np.min_scalar_type(int(array.max(initial=0)))
    return np.ascontiguousarray(array.astype(kind))


def read(kind: type[T], data: object, tensors: Tensors, kinds: Kinds) -> T:
    """Return the value of a type that was written; ModelError where something is wrong with it."""
    value = _Reader(tensors, kinds).value_of(Hint.of(kind), data, "", {})
    assert isinstance(value, kind)  # noqa: S101 - for the types
    return value


@dataclass
class _Reader:
    tensors: Tensors
    kinds: Kinds

    def value_of(
        self, hint: Hint, data: object, path: str, sizes: Sizes
    ) -> object:
        """Return the value at a place; `sizes` are those of the object that it is of."""
        if hint.shape is not None:
            if path in self.tensors:
                return _checked(
                    self.tensors[path], hint, hint.shape, path, sizes
                )
            if hint.optional:
                return None
            raise ModelError(f"array {path!r} is missing")
        if data is _MISSING:
            raise ModelError(f"{path} is missing")
        if data is None and hint.optional:
            return None
        if hint.item is not None:
            if not isinstance(data, list):
                raise ModelError(f"{path} is {data!r:.60}, expected a list")
            places = [_under(path, str(k)) for k in range(len(data))]
            pairs = zip(data, places, strict=True)
            return tuple(
                self.value_of(hint.item, one, at, {}) for one, at in pairs
            )
        if is_dataclass(next(iter(hint.classes(self.kinds).values()))):
            return self.object_of(hint, data, path)
        return _plain(hint.kinds[0], data, path)

    def object_of(self, hint: Hint, data: object, path: str) -> object:
        """Return the object at a place, whose axes of one name are of one length."""
        if not isinstance(data, Mapping):
            raise ModelError(f"{path} is {data!r:.60}, expected an object")
        classes = hint.classes(self.kinds)
        name = next(iter(classes))
        if len(classes) > 1:
            name = data.get("kind", "")
        if name not in classes:
            raise ModelError(
                f"{path} is of kind {name!r:.60}, expected {list(classes)}"
            )
        sizes: Sizes = {}
        values: dict[str, object] = {}
        for key, part in _hints(classes[name]).items():
            value = data.get(key, _MISSING)
            values[key] = self.value_of(part, value, _under(path, key), sizes)
        return classes[name](**values)


def _plain(kind: type, value: object, path: str) -> object:
    """Return a tuple, a mapping, a number, a text, true or false of a type."""
    origin = get_origin(kind)
    parts = get_args(kind)
    if kind is Any:
        return value
    if kind is float and value is None:
        return math.inf
    if origin is Mapping and isinstance(value, Mapping):
        return {
            str(key): _plain(parts[1], part, path)
            for key, part in value.items()
        }
    if origin is tuple and isinstance(value, list):
        items = parts
        if parts[-1] is ...:
            items = (parts[0],) * len(value)
        if len(items) == len(value):
            return tuple(
                _plain(p, v, path) for p, v in zip(items, value, strict=True)
            )
    if type(value) is int or type(value) is float:
        # nor are infinities and NaN below the largest
        if kind in (type(value), float) and abs(value) < LARGEST:
            return kind(value)
    elif type(value) is kind:
        return value
    raise ModelError(f"{path} is {value!r:.60}, expected {kind}")


def _checked(
    array: Tensor, hint: Hint, shape: Shape, path: str, sizes: Sizes
) -> object:
    """Return an array of the type and shape that its annotation says, with finite numbers."""
    is_bytes = hint.kinds[0] is bytes
    wanted = np.dtype(np.uint8)
    if not is_bytes:  # NDArray[float64] is ndarray[..., dtype[float64]]
        wanted = np.dtype(get_args(get_args(hint.kinds[0])[1])[0])
    fits = array.dtype.kind == "u"
    if wanted.kind == "f":
        fits = array.dtype == shape.stored
        fits = fits and bool((np.abs(array.astype(float)) < LARGEST).all())
        if fits and shape.kept == TRIANGLE:
            size = math.isqrt(2 * array.size)
            fits = array.shape == (size * (size + 1) // 2,)
            array = unpack(array.astype(np.float32), size) if fits else array
    axes: list[int] = []
    for axis, length in zip(shape.axes, array.shape, strict=False):
        axes.append(
            sizes.setdefault(axis, length) if isinstance(axis, str) else axis
        )
    if not fits or axes != list(array.shape) or len(shape.axes) != array.ndim:
        expected = " x ".join(map(str, shape.axes))
        raise ModelError(
            f"{path} is {array.dtype} {array.shape}, expected {expected} {axes}, finite numbers"
        )
    return array.tobytes() if is_bytes else array.astype(wanted, copy=False)
