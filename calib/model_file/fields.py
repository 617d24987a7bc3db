"""Fields: any dataclass as plain data and arrays, and back, as its own annotations say.

Arrays are annotated with their axes, see `calib.common.arrays.Shape`: they become tensors that are
named by their place, such as ``motor.scale.lower``.  Everything else becomes JSON.  What is read
may come from a stranger: types, shapes, and that numbers are finite, are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import TRIANGLE, Own, Shape
from ..common.checks import LARGEST
from ..errors import ModelError

Tensors = Mapping[str, NDArray[Any]]
Kinds = Mapping[type, tuple[type, ...]]
"""Classes that may stand for a base class; a key `kind` tells which."""

Possible = Mapping[type, Callable[[Any], bool]]
"""Of a class: whether a value makes sense."""

_WHOLE = 2**53
_NOTHING = object()  # a tensor leaves no trace in the JSON


@dataclass(frozen=True)
class Format:
    """How the values of a file are written and read."""

    kinds: Kinds = field(default_factory=dict)
    possible: Possible = field(default_factory=dict)

    def write(self, value: Any, kind: Any) -> tuple[Any, dict[str, NDArray[Any]]]:
        """A value of a type as JSON-ready data, and its arrays by name."""
        tensors: dict[str, NDArray[Any]] = {}
        return self._told(value, kind, "", tensors), tensors

    def read(self, kind: Any, told: Any, tensors: Tensors) -> Any:
        """The value of a type that was written; ModelError where something is wrong with it."""
        return self._given(kind, told, tensors, "", {})

    def _classes(self, kinds: tuple[Any, ...]) -> tuple[type, ...]:
        return tuple(c for kind in kinds for c in self.kinds.get(kind, (kind,)))

    def _told(self, value: Any, kind: Any, path: str, tensors: dict[str, NDArray[Any]]) -> Any:
        kinds, marks, _ = _plain(kind)
        if isinstance(value, np.ndarray | bytes):
            shape = next((mark for mark in marks if isinstance(mark, Shape)), Shape("bytes"))
            tensors[path] = _kept(value, shape)
            return _NOTHING
        if value is None and (_is_array(kinds[0]) or kinds[0] is bytes):
            return _NOTHING
        if is_dataclass(value):
            own: Any = type(value)
            hints = _hints(own)
            told = {
                f.name: self._told(getattr(value, f.name), hints[f.name], _under(path, f.name),
                                   tensors)
                for f in fields(value)
            }  # fmt: skip
            told = {name: part for name, part in told.items() if part is not _NOTHING}
            several = len(self._classes(kinds)) > 1
            return {"kind": _name(own), **told} if several else told
        return _json(value)

    def _given(
        self, kind: Any, told: Any, tensors: Tensors, path: str, sizes: dict[str, int]
    ) -> Any:
        kinds, marks, optional = _plain(kind)
        if _is_array(kinds[0]) or kinds[0] is bytes:
            shape = next((mark for mark in marks if isinstance(mark, Shape)), Shape("bytes"))
            if path not in tensors and optional:
                return None
            if path not in tensors:
                raise ModelError(f"array {path!r} is missing")
            array = _checked(tensors[path], kinds[0], shape, path, sizes)
            return array.tobytes() if kinds[0] is bytes else array
        if told is _NOTHING:
            raise ModelError(f"{path!r} is missing")
        if told is None and optional:
            return None
        classes = self._classes(kinds)
        if not is_dataclass(classes[0]):
            return _value(kinds[0], told, path)
        if not isinstance(told, Mapping):
            raise ModelError(f"{path} is {told!r:.60}, expected an object")
        found = {_name(each): each for each in classes}
        own = classes[0] if len(classes) == 1 else found.get(told.get("kind"))  # type: ignore[arg-type]
        if own is None:
            raise ModelError(f"{path} is of kind {told.get('kind')!r:.60}, expected {list(found)}")
        mark = next((mark for mark in marks if isinstance(mark, Own)), None)
        inner = sizes if mark is None else mark.inner(sizes)
        hints = _hints(own)
        values = {
            f.name: self._given(
                hints[f.name], told.get(f.name, _NOTHING), tensors, _under(path, f.name), inner
            )
            for f in fields(own)
        }
        if mark is not None:
            mark.outer(inner, sizes)
        value = own(**values)
        if not self.possible.get(own, lambda _: True)(value):
            raise ModelError(f"{path} makes no sense")
        return value


def _under(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _name(own: type) -> str:
    return str(getattr(own, "kind", own.__name__.lower()))


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _plain(kind: Any) -> tuple[tuple[Any, ...], tuple[Any, ...], bool]:
    """Types that an annotation allows, its marks, and whether there may be nothing."""
    marks: tuple[Any, ...] = ()
    if get_origin(kind) is Annotated:
        kind, *more = get_args(kind)
        marks = tuple(more)
    if get_origin(kind) not in (UnionType, Union):
        return (kind,), marks, False
    parts = get_args(kind)
    inner = tuple(part for part in parts if part is not NoneType)
    if len(inner) == 1 and get_origin(inner[0]) is Annotated:
        kinds, more_marks, _ = _plain(inner[0])
        return kinds, (*marks, *more_marks), NoneType in parts
    return inner, marks, NoneType in parts


def _is_array(kind: Any) -> bool:
    return get_origin(kind) is np.ndarray


def _json(value: Any) -> Any:
    """Plain data: tuples as lists, infinite numbers and those that are none as null."""
    if isinstance(value, Mapping):
        return {str(key): _json(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_json(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _value(kind: Any, value: Any, path: str) -> Any:
    """A tuple, a mapping, a number, a text, true or false of a type."""
    if kind is Any:
        return value
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (dict, Mapping) or getattr(origin, "__name__", "") == "Mapping":
        if isinstance(value, Mapping):
            return {str(k): _value(parts[1], v, _under(path, str(k))) for k, v in value.items()}
    elif origin is tuple and isinstance(value, list | tuple):
        if parts[-1] is ...:
            parts = (parts[0],) * len(value)
        if len(parts) == len(value):
            return tuple(_value(p, v, path) for p, v in zip(parts, value, strict=True))
    if kind is float and value is None:
        return math.inf
    number = isinstance(value, int | float) and not isinstance(value, bool)
    fits = {
        str: isinstance(value, str),
        bool: isinstance(value, bool),
        int: number and isinstance(value, int) and abs(value) < _WHOLE,
        float: number and abs(value) < LARGEST,  # nor are infinities and NaN below it
    }
    if not fits.get(kind, False):
        raise ModelError(f"{path} is {value!r:.60}, expected {kind}")
    return float(value) if kind is float else value


def _kept(value: Any, shape: Shape) -> NDArray[Any]:
    """An array as a file keeps it: whole numbers in as few bytes as they need."""
    array = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value
    if shape.kept == TRIANGLE:
        array = _packed(array)
    elif array.dtype.kind == "f":
        array = array.astype(shape.kept)
    else:
        most = int(array.max(initial=0))
        array = array.astype(np.min_scalar_type(most))
    return np.ascontiguousarray(array)


def _checked(
    array: NDArray[Any], kind: Any, shape: Shape, path: str, sizes: dict[str, int]
) -> NDArray[Any]:
    """An array of the type and shape that its annotation says, with finite numbers."""
    wanted = np.dtype(np.uint8) if kind is bytes else np.dtype(get_args(get_args(kind)[1])[0])
    floats = wanted.kind == "f"
    fits = array.dtype == shape.stored if floats else array.dtype.kind == "u"
    if floats and not (fits and (np.abs(array.astype(float)) < LARGEST).all()):
        raise ModelError(f"{path} is {array.dtype}, expected finite numbers of {shape.stored}")
    if floats:
        array = array.astype(float, copy=False)
        if shape.kept == TRIANGLE:
            array = _unpacked(array, path)
    axes = [sizes.setdefault(a, n) if isinstance(a, str) else a
            for a, n in zip(shape.axes, array.shape, strict=False)]  # fmt: skip
    if not fits or axes != list(array.shape) or len(shape.axes) != array.ndim:
        expected = " x ".join(map(str, shape.axes))
        raise ModelError(f"{path} is {array.dtype} {array.shape}, expected {expected} {axes}")
    if wanted.kind == "b":
        return array.astype(bool)
    return array.astype(wanted, copy=False)


def _packed(root: NDArray[Any]) -> NDArray[Any]:
    from ..body.covariance import pack

    return pack(root)


def _unpacked(packed: NDArray[Any], path: str) -> NDArray[Any]:
    from ..body.covariance import unpack

    size = math.isqrt(2 * packed.size)
    if packed.ndim != 1 or packed.size != size * (size + 1) // 2:
        raise ModelError(f"{path} has {packed.shape} numbers, expected those of a triangle")
    return unpack(packed, size)
