"""Fields: any dataclass as plain data and arrays, and back, as its own annotations say.

Arrays are annotated with their axes, see `calib.common.arrays.Shape`: they become tensors that are
named by their place, such as ``about.lower``.  Everything else becomes JSON.  What is read may come
from a stranger: types, shapes, and that numbers are finite, are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import pack, unpack
from ..common.arrays import TRIANGLE, Shape
from ..common.rows import LARGEST
from ..errors import ModelError

Tensors = dict[str, NDArray[Any]]
Kinds = Mapping[Any, tuple[type, ...]]
"""Classes that may stand for a base class; a key `kind` tells which."""

_MISSING = object()  # of no type


class _Hint(NamedTuple):
    """What an annotation says."""

    kinds: tuple[Any, ...]  # types that a value may have
    mark: Any  # `Shape` of an array, `Own` of an object with axes of its own
    optional: bool

    @staticmethod
    def of(kind: Any) -> _Hint:
        kinds: tuple[Any, ...] = (kind,)
        if get_origin(kind) in (UnionType, Union):
            kinds = tuple(each for each in get_args(kind) if each is not NoneType)
        optional, mark = NoneType in get_args(kind), None
        if get_origin(kinds[0]) is Annotated:
            *kinds, mark = get_args(kinds[0])  # type: ignore[assignment]
        return _Hint(tuple(kinds), mark, optional)


def write(value: Any, kind: Any, kinds: Kinds) -> tuple[Any, Tensors]:
    """A value of a type as JSON-ready data, and its arrays by name."""
    tensors: Tensors = {}

    def told(value: Any, hint: _Hint, path: str) -> Any:
        if not is_dataclass(value):
            return _json(value)
        own: Any = type(value)
        parts = {"kind": _name(own)} if len(_classes(hint, kinds)) > 1 else {}
        for name, inner in _hints(own).items():
            part, place = getattr(value, name), _under(path, name)
            if not isinstance(inner.mark, Shape):
                parts[name] = told(part, inner, place)
            elif part is not None:
                tensors[place] = _kept(part, inner.mark)
        return parts

    return told(value, _Hint.of(kind), ""), tensors


def read(kind: Any, told: Any, tensors: Tensors, kinds: Kinds) -> Any:
    """The value of a type that was written; ModelError where something is wrong with it."""

    def given(hint: _Hint, told: Any, path: str, sizes: dict[str, int]) -> Any:
        if isinstance(hint.mark, Shape):
            if path in tensors:
                return _checked(tensors[path], hint, path, sizes)
            if hint.optional:
                return None
            raise ModelError(f"array {path!r} is missing")
        if told is None and hint.optional:
            return None
        classes = _classes(hint, kinds)
        if not is_dataclass(classes[0]):
            return _value(hint.kinds[0], told, path)
        if not isinstance(told, Mapping):
            raise ModelError(f"{path} is {told!r:.60}, expected an object")
        found = {_name(each): each for each in classes}
        own: Any = classes[0] if len(classes) == 1 else found.get(told.get("kind", ""))
        if own is None:
            raise ModelError(f"{path} is of kind {told.get('kind')!r:.60}, expected {list(found)}")
        inner = hint.mark.inner(sizes) if hint.mark else sizes
        values = {
            name: given(part, told.get(name, _MISSING), _under(path, name), inner)
            for name, part in _hints(own).items()
        }
        if hint.mark:
            hint.mark.outer(inner, sizes)
        return own(**values)

    return given(_Hint.of(kind), told, "", {})


def _classes(hint: _Hint, kinds: Kinds) -> tuple[Any, ...]:
    return tuple(each for kind in hint.kinds for each in kinds.get(kind, (kind,)))


def _under(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _name(own: type) -> str:
    return str(getattr(own, "kind", own.__name__.lower()))


@cache
def _hints(kind: Any) -> dict[str, _Hint]:
    """What the annotations of a dataclass's fields say, but for those that no file keeps."""
    hints = get_type_hints(kind, include_extras=True)
    kept = (each.name for each in fields(kind) if each.metadata.get("kept", True))
    return {name: _Hint.of(hints[name]) for name in kept}


def _json(value: Any) -> Any:
    """Plain data: tuples as lists, infinite numbers and those that are none as null."""
    if isinstance(value, Mapping):
        return {str(key): _json(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_json(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _value(kind: Any, value: Any, path: str) -> Any:
    """A tuple, a mapping, a number, a text, true or false of a type."""
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any and value is not _MISSING:
        return value
    if kind is float and value is None:
        return math.inf
    if origin is Mapping and isinstance(value, Mapping):
        return {str(key): _value(parts[1], part, path) for key, part in value.items()}
    if origin is tuple and isinstance(value, list):
        each = (parts[0],) * len(value) if parts[-1] is ... else parts
        if len(each) == len(value):
            return tuple(_value(p, v, path) for p, v in zip(each, value, strict=True))
    fits = type(value) is kind or (kind is float and type(value) is int)
    # nor are infinities and NaN below the largest
    if fits and (kind not in (int, float) or abs(value) < LARGEST):
        return kind(value)
    raise ModelError(f"{path} is {value!r:.60}, expected {kind}")


def _kept(value: Any, shape: Shape) -> NDArray[Any]:
    """An array as a file keeps it: whole numbers in as few bytes as they need."""
    array: Any = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value
    array = pack(array) if shape.kept == TRIANGLE else array
    floats = array.dtype.kind == "f"
    kind = shape.stored if floats else np.min_scalar_type(int(array.max(initial=0)))
    return np.ascontiguousarray(array.astype(kind))


def _checked(array: NDArray[Any], hint: _Hint, path: str, sizes: dict[str, int]) -> Any:
    """An array of the type and shape that its annotation says, with finite numbers."""
    kind, shape = hint.kinds[0], hint.mark
    wanted = np.dtype(np.uint8 if kind is bytes else get_args(get_args(kind)[1])[0])
    fits = array.dtype.kind == "u"
    if wanted.kind == "f":
        fits = array.dtype == shape.stored and bool((np.abs(array.astype(float)) < LARGEST).all())
        if fits and shape.kept == TRIANGLE:
            size = math.isqrt(2 * array.size)
            fits = array.ndim == 1 and array.size == size * (size + 1) // 2
            array = unpack(array, size) if fits else array
    axes = [
        sizes.setdefault(axis, n) if isinstance(axis, str) else axis
        for axis, n in zip(shape.axes, array.shape, strict=False)
    ]
    if not fits or axes != list(array.shape) or len(shape.axes) != array.ndim:
        expected = " x ".join(map(str, shape.axes))
        raise ModelError(
            f"{path} is {array.dtype} {array.shape}, expected {expected} {axes}, finite numbers"
        )
    return array.tobytes() if kind is bytes else array.astype(wanted, copy=False)
