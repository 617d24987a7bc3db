"""Fields: any dataclass as plain data and arrays, and back, according to its annotations.

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

from ..body.covariance import pack_root, unpack_root
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import TRIANGLE, Shape
from ..common.inputs import LARGEST
from ..errors import ModelError

Tensor = NDArray[np.generic]
Tensors = dict[str, Tensor]
T = TypeVar("T")
Sizes = dict[str, int]
"""Lengths of axes, by their names."""

KINDS: Mapping[type, tuple[type, ...]] = {
    Structure: (PlanarStructure, SpatialStructure)
}
"""The subclasses of base classes; a key `kind` names the subclass in a file."""


@dataclass(frozen=True)
class Hint:
    """An annotation, resolved."""

    kinds: tuple[type, ...]  # types that a value may have
    optional: bool
    shape: Shape | None  # of an array

    @property
    def classes(self) -> dict[str, type]:
        """Classes that an object may be of, by name."""
        return {
            str(getattr(one, "kind", one.__name__.lower())): one
            for kind in self.kinds
            for one in KINDS.get(kind, (kind,))
        }


def hint_of(annotation: object) -> Hint:
    """Return an annotation, resolved."""
    kinds: tuple[type, ...] = (annotation,)  # type: ignore[assignment]
    if get_origin(annotation) in (UnionType, Union):
        kinds = get_args(annotation)
    optional = NoneType in kinds
    kinds = tuple(kind for kind in kinds if kind is not NoneType)
    shape = None
    if get_origin(kinds[0]) is Annotated:
        kind, shape = get_args(kinds[0])
        kinds = (kind,)
    return Hint(kinds, optional, shape)


@cache
def hints_of(kind: type) -> dict[str, Hint]:
    """Return the annotations of a dataclass's fields, but for those that no file keeps."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        part.name: hint_of(hints[part.name])
        for part in fields(kind)
        if part.metadata.get("kept", True)
    }


def write(value: object, kind: type) -> tuple[dict[str, object], Tensors]:
    """Return a dataclass of a type as JSON-ready data, and its arrays by name."""
    codec = Codec()
    data = codec.data_of(value, hint_of(kind), "")
    assert isinstance(data, dict)  # noqa: S101 - of a dataclass
    return data, codec.tensors


def read(kind: type[T], data: object, tensors: Tensors) -> T:
    """Return the value of a type that was written; ModelError where something is wrong with it."""
    value = Codec(tensors).value_of(data, hint_of(kind), "")
    assert isinstance(value, kind)  # noqa: S101 - for the types
    return value


@dataclass(frozen=True)
class Codec:
    """Values as plain data, and tensors apart from them."""

    tensors: Tensors = field(default_factory=dict)

    def data_of(self, value: object, hint: Hint, path: str) -> object:
        """Return a value as plain data; infinite numbers and those that are none are null."""
        if isinstance(value, tuple | list):
            kinds = get_args(hint.kinds[0])
            item = hint_of(kinds[0] if kinds else object)
            return [
                self.data_of(part, item, _under(path, str(k)))
                for k, part in enumerate(value)
            ]
        if isinstance(value, Mapping):
            return {
                str(key): self.data_of(part, hint_of(object), path)
                for key, part in value.items()
            }
        if isinstance(value, float) and not math.isfinite(value):
            return None
        kind: type = type(value)
        if not is_dataclass(kind):
            return value
        data: dict[str, object] = {}
        classes = hint.classes
        if len(classes) > 1:
            names = list(classes)
            data["kind"] = names[list(classes.values()).index(kind)]
        for name, inner in hints_of(kind).items():
            part = getattr(value, name)
            place = _under(path, name)
            if inner.shape is None:
                data[name] = self.data_of(part, inner, place)
            elif part is not None:
                self.tensors[place] = _file_array(part, inner.shape)
        return data

    def value_of(self, data: object, hint: Hint, path: str) -> object:
        """Return the value at a place."""
        kind = hint.kinds[0]
        if kind is Any or (data is None and hint.optional):
            return data
        if isinstance(data, list) and get_origin(kind) is tuple:
            return self._tuple_of(data, get_args(kind), path)
        if not isinstance(data, Mapping):
            return _plain_value(data, kind, path)
        if get_origin(kind) is not Mapping:
            return self.object_of(data, hint, path)
        item = hint_of(get_args(kind)[1])
        return {
            str(key): self.value_of(part, item, path)
            for key, part in data.items()
        }

    def _tuple_of(
        self, data: list[object], kinds: tuple[object, ...], path: str
    ) -> tuple[object, ...]:
        """Return a tuple of some types, the first of them repeated before an ellipsis."""
        if kinds[-1] is ...:
            kinds = (kinds[0],) * len(data)
        if len(kinds) != len(data):
            raise ModelError(f"{path} has {len(data)} items, expected {kinds}")
        return tuple(
            self.value_of(part, hint_of(kind), _under(path, str(k)))
            for k, (part, kind) in enumerate(zip(data, kinds, strict=True))
        )

    def object_of(
        self, data: Mapping[str, object], hint: Hint, path: str
    ) -> object:
        """Return the object at a place, whose axes of one name are of one length."""
        classes = hint.classes
        name = next(iter(classes))
        if len(classes) > 1:
            name = str(data.get("kind"))
        if name not in classes:
            raise ModelError(
                f"{path} is an object of no kind, expected {list(classes)}"
            )
        kind = classes[name]
        sizes: Sizes = {}
        values: dict[str, object] = {}
        for name, inner in hints_of(kind).items():
            place = _under(path, name)
            tensor = self.tensors.get(place)
            if inner.shape is None:
                values[name] = self.value_of(data.get(name, ...), inner, place)
            elif tensor is not None:
                values[name] = _valid_array(tensor, inner, place, sizes)
            elif inner.optional:
                values[name] = None
            else:
                raise ModelError(f"array {place!r} is missing")
        return kind(**values)


def _plain_value(data: object, kind: type, path: str) -> object:
    """Return a number, a word or a truth value of a type."""
    if kind is float and data is None:
        return math.inf
    if type(data) is int or type(data) is float:
        # nor are infinities and NaN below the largest
        if kind in (type(data), float) and abs(data) < LARGEST:
            return kind(data)
    elif type(data) is kind:
        return data
    raise ModelError(f"{path} is {data!r:.60}, expected {kind}")


def _under(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _file_array(value: Tensor, shape: Shape) -> Tensor:
    """Return an array as a file keeps it: whole numbers in as few bytes as they need."""
    array = (
        pack_root(value.astype(float)) if shape.storage == TRIANGLE else value
    )
    kind: np.dtype[np.generic] = shape.dtype
    if array.dtype.kind != "f":
        kind = np.min_scalar_type(int(array.max(initial=0)))
    return np.ascontiguousarray(array.astype(kind))


def _valid_array(array: Tensor, hint: Hint, path: str, sizes: Sizes) -> object:
    """Return an array of the type and shape of its annotation, with finite numbers."""
    shape = hint.shape or Shape()
    # NDArray[float64] is ndarray[..., dtype[float64]]
    wanted = np.dtype(get_args(get_args(hint.kinds[0])[1])[0])
    fits = array.dtype.kind == "u"
    if wanted.kind == "f":
        fits = array.dtype == shape.dtype
        fits = fits and bool((np.abs(array.astype(float)) < LARGEST).all())
    size = math.isqrt(2 * array.size)
    if shape.storage == TRIANGLE and array.shape == (size * (size + 1) // 2,):
        array = unpack_root(array.astype(np.float32), size)
    axes = [
        sizes.setdefault(axis, length) if isinstance(axis, str) else axis
        for axis, length in zip(shape.axes, array.shape, strict=False)
    ]
    if not fits or axes != list(array.shape) or len(shape.axes) != array.ndim:
        expected = " x ".join(map(str, shape.axes))
        raise ModelError(
            f"{path} is {array.dtype} {array.shape}, expected {expected} {axes}, finite numbers"
        )
    return array.astype(wanted, copy=False)
