"""Fields: any dataclass as plain data and arrays, and back, as its own annotations say.

Arrays are annotated with their axes, see `calib.common.arrays.Shape`: they become tensors that are
named by their place, such as ``about.lower``.  Everything else becomes JSON.  What is read may come
from a stranger: types, shapes, and that numbers are finite, are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import pack, unpack
from ..common.arrays import TRIANGLE, Own, Shape
from ..common.rows import LARGEST
from ..errors import ModelError

Tensors = dict[str, NDArray[Any]]
Kinds = Mapping[type, tuple[type, ...]]
"""Classes that may stand for a base class; a key `kind` tells which."""

_MISSING = object()  # of no type


@dataclass(frozen=True)
class _Hint:
    """What an annotation says."""

    kinds: tuple[Any, ...]  # types that a value may have
    shape: Shape | None = None  # of an array
    own: Own | None = None  # of an object with axes of its own
    optional: bool = False

    @staticmethod
    def of(kind: object) -> _Hint:
        kinds: tuple[Any, ...] = (kind,)
        if get_origin(kind) in (UnionType, Union):
            kinds = tuple(one for one in get_args(kind) if one is not NoneType)
        optional = NoneType in get_args(kind)
        if get_origin(kinds[0]) is not Annotated:
            return _Hint(kinds, optional=optional)
        annotated, mark = get_args(kinds[0])
        if isinstance(mark, Shape):
            return _Hint((annotated,), shape=mark, optional=optional)
        return _Hint((annotated,), own=mark, optional=optional)

    @property
    def item(self) -> _Hint | None:
        """What each item of a tuple of objects is; None of anything else."""
        if get_origin(self.kinds[0]) is not tuple:
            return None
        item = _Hint.of(get_args(self.kinds[0])[0])
        return item if is_dataclass(item.kinds[0]) else None


def write(value: object, kind: object, kinds: Kinds) -> tuple[dict[str, Any], Tensors]:
    """A value of a type as JSON-ready data, and its arrays by name."""
    tensors: Tensors = {}

    def data_of(value: Any, hint: _Hint, path: str) -> Any:
        if hint.item is not None:
            return [
                data_of(each, hint.item, _under(path, str(k)))
                for k, each in enumerate(value)
            ]
        if not is_dataclass(value):
            return _json(value)
        data: dict[str, Any] = {}
        if len(_classes(hint, kinds)) > 1:
            data["kind"] = _name(type(value))
        for name, inner in _hints(value.__class__).items():
            part = getattr(value, name)
            place = _under(path, name)
            if inner.shape is None:
                data[name] = data_of(part, inner, place)
            elif part is not None:
                tensors[place] = _stored(part, inner.shape)
        return data

    return data_of(value, _Hint.of(kind), ""), tensors


def read(kind: object, data: object, tensors: Tensors, kinds: Kinds) -> Any:
    """The value of a type that was written; ModelError where something is wrong with it."""

    def value_of(hint: _Hint, data: Any, path: str, sizes: dict[str, int]) -> Any:
        if hint.shape is not None:
            if path in tensors:
                return _checked(tensors[path], hint.kinds[0], hint.shape, path, sizes)
            if hint.optional:
                return None
            raise ModelError(f"array {path!r} is missing")
        if data is None and hint.optional:
            return None
        item = hint.item
        if item is not None:
            if not isinstance(data, list):
                raise ModelError(f"{path} is {data!r:.60}, expected a list")
            places = [_under(path, str(k)) for k in range(len(data))]
            return tuple(
                value_of(item, each, place, {})
                for each, place in zip(data, places, strict=True)
            )
        classes = _classes(hint, kinds)
        if not is_dataclass(classes[0]):
            return _plain(hint.kinds[0], data, path)
        return object_of(classes, hint, data, path, sizes)

    def object_of(
        classes: tuple[Any, ...],
        hint: _Hint,
        data: Any,
        path: str,
        sizes: dict[str, int],
    ) -> Any:
        if not isinstance(data, Mapping):
            raise ModelError(f"{path} is {data!r:.60}, expected an object")
        chosen = classes[0]
        if len(classes) > 1:
            named = {_name(each): each for each in classes}
            chosen = named.get(data.get("kind", ""))
            if chosen is None:
                kind = data.get("kind")
                raise ModelError(
                    f"{path} is of kind {kind!r:.60}, expected {list(named)}"
                )
        inner = sizes if hint.own is None else hint.own.inner(sizes)
        values = {
            name: value_of(part, data.get(name, _MISSING), _under(path, name), inner)
            for name, part in _hints(chosen).items()
        }
        if hint.own is not None:
            hint.own.outer(inner, sizes)
        return chosen(**values)

    return value_of(_Hint.of(kind), data, "", {})


def _classes(hint: _Hint, kinds: Kinds) -> tuple[Any, ...]:
    """Classes that a value may be of."""
    classes: list[Any] = []
    for kind in hint.kinds:
        classes += kinds.get(kind, (kind,))
    return tuple(classes)


def _under(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _name(kind: type) -> str:
    return str(getattr(kind, "kind", kind.__name__.lower()))


@cache
def _hints(kind: Any) -> dict[str, _Hint]:
    """What the annotations of a dataclass's fields say, but for those that no file keeps."""
    hints = get_type_hints(kind, include_extras=True)
    names = [field.name for field in fields(kind) if field.metadata.get("kept", True)]
    return {name: _Hint.of(hints[name]) for name in names}


def _json(value: Any) -> Any:
    """Plain data: tuples as lists, infinite numbers and those that are none as null."""
    if isinstance(value, Mapping):
        return {str(key): _json(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_json(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _plain(kind: Any, value: Any, path: str) -> Any:
    """A tuple, a mapping, a number, a text, true or false of a type."""
    origin = get_origin(kind)
    parts = get_args(kind)
    if kind is Any and value is not _MISSING:
        return value
    if kind is float and value is None:
        return math.inf
    if origin is Mapping and isinstance(value, Mapping):
        return {str(key): _plain(parts[1], part, path) for key, part in value.items()}
    if origin is tuple and isinstance(value, list):
        items = parts
        if parts[-1] is ...:
            items = (parts[0],) * len(value)
        if len(items) == len(value):
            return tuple(_plain(p, v, path) for p, v in zip(items, value, strict=True))
    fits = type(value) is kind or (kind is float and type(value) is int)
    # nor are infinities and NaN below the largest
    if fits and (kind not in (int, float) or abs(value) < LARGEST):
        return kind(value)
    raise ModelError(f"{path} is {value!r:.60}, expected {kind}")


def _stored(value: Any, shape: Shape) -> NDArray[Any]:
    """An array as a file keeps it: whole numbers in as few bytes as they need."""
    array: NDArray[Any] = (
        np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value
    )
    if shape.kept == TRIANGLE:
        array = pack(array)
    kind: Any = shape.stored
    if array.dtype.kind != "f":
        kind = np.min_scalar_type(int(array.max(initial=0)))
    return np.ascontiguousarray(array.astype(kind))


def _checked(
    array: NDArray[Any], kind: Any, shape: Shape, path: str, sizes: dict[str, int]
) -> Any:
    """An array of the type and shape that its annotation says, with finite numbers."""
    wanted = np.dtype(np.uint8 if kind is bytes else get_args(get_args(kind)[1])[0])
    if wanted.kind == "f":
        fits = array.dtype == shape.stored and bool(
            (np.abs(array.astype(float)) < LARGEST).all()
        )
        if fits and shape.kept == TRIANGLE:
            size = math.isqrt(2 * array.size)
            fits = array.ndim == 1 and array.size == size * (size + 1) // 2
            array = unpack(array, size) if fits else array
    else:
        fits = array.dtype.kind == "u"
    axes: list[int] = []
    for axis, length in zip(shape.axes, array.shape, strict=False):
        axes.append(sizes.setdefault(axis, length) if isinstance(axis, str) else axis)
    if not fits or axes != list(array.shape) or len(shape.axes) != array.ndim:
        expected = " x ".join(map(str, shape.axes))
        raise ModelError(
            f"{path} is {array.dtype} {array.shape}, expected {expected} {axes}, finite numbers"
        )
    return array.tobytes() if kind is bytes else array.astype(wanted, copy=False)
