"""Checked: values and arrays of a stranger's file, each of the type and shape that it must have.

What a dataclass holds is written by `plain_fields` and read by `given_fields`, as its annotations
say.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ..common.checks import LARGEST
from ..errors import ModelError

_LONGEST = 1000
"""Characters of a text."""

_WHOLE = 2**53

POSITIVE = 1e-300
"""The least number above zero that an array may hold."""

WHOLE = "whole numbers"
"""Stands for unsigned integers of any width: as few bytes as the numbers need."""


def plain_fields(value: Any, names: Iterable[str]) -> dict[str, Any]:
    """Fields of a dataclass, JSON-ready where they are plain data."""
    return {name: getattr(value, name) for name in names}


def given(kind: Any, value: Any, where: str) -> Any:
    """A value of a type: a dataclass, a tuple, a mapping, a number, a text, true or false.

    `where` is what an error calls it.  Raises ModelError if the value is of another type.
    """
    if is_dataclass(kind) and isinstance(value, Mapping):
        assert isinstance(kind, type)  # noqa: S101
        return kind(**given_fields(kind, value, where))
    parts = get_args(kind)
    if get_origin(kind) is UnionType:  # X | None
        return None if value is None else given(parts[0], value, where)
    if get_origin(kind) in (dict, Mapping) and isinstance(value, Mapping):
        return {str(k): given(parts[1], v, f"{where}.{k}") for k, v in value.items()}
    if get_origin(kind) is tuple and isinstance(value, list | tuple):
        if parts[-1] is ...:
            parts = (parts[0],) * len(value)
        if len(parts) == len(value):
            return tuple(given(p, v, where) for p, v in zip(parts, value, strict=True))
    number = isinstance(value, int | float) and not isinstance(value, bool)
    fits = {
        str: isinstance(value, str) and len(value) <= _LONGEST,
        bool: isinstance(value, bool),
        dict: isinstance(value, dict),
        int: number and isinstance(value, int) and abs(value) < _WHOLE,
        float: number and abs(value) < LARGEST,  # nor are infinities and NaN below it
    }
    if not fits.get(kind, False):
        raise ModelError(f"{where} is {value!r:.60}, expected {kind}")
    return float(value) if kind is float else value


def given_fields(
    kind: Any, header: Any, where: str, names: Iterable[str] | None = None
) -> dict[str, Any]:
    """Fields of a dataclass, all or some, from an object that may hold more keys."""
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)] if names is None else names
    return {name: given_key(hints[name], header, name, where) for name in names}


def given_key(kind: Any, header: Any, name: str, where: str) -> Any:
    """The value of a type that an object has at a key."""
    if name not in given(dict, header, where):
        raise ModelError(f"{where}: {name!r} is missing")
    return given(kind, header[name], f"{where}.{name}")


def refuse_impossible(impossible: Mapping[str, bool], where: str) -> None:
    """Refuse values of the right type that are impossible, by what was expected."""
    for expected, wrong in impossible.items():
        if wrong:
            raise ModelError(f"{where}: expected {expected}")


@dataclass(frozen=True)
class Tensors:
    """The tensors of a file whose names begin with a prefix."""

    arrays: Mapping[str, NDArray[Any]]
    prefix: str = ""

    def __contains__(self, name: str) -> bool:
        return self.prefix + name in self.arrays

    def under(self, prefix: str) -> Tensors:
        """Tensors whose names go on with a further prefix."""
        return Tensors(self.arrays, self.prefix + prefix)

    def take(
        self,
        name: str,
        shape: tuple[int, ...],
        kind: str = "float64",
        least: float = -LARGEST,
    ) -> NDArray[Any]:
        """Return a tensor, floats of any width as float64; -1 in `shape` stands for any length.

        Raises ModelError if it is not there, has another shape or type, or a value that is not
        finite or below `least`.
        """
        name = self.prefix + name
        if name not in self.arrays:
            raise ModelError(f"array {name!r} is missing")
        array = self.arrays[name]
        fits = array.dtype.kind == "u" if kind == WHOLE else array.dtype == kind
        lengths = len(shape) == array.ndim and all(
            n in (-1, m) for n, m in zip(shape, array.shape, strict=True)
        )
        if not (fits and lengths):
            raise ModelError(f"{name} is {array.dtype} {array.shape}, expected {kind} {shape}")
        if array.dtype.kind != "f":
            return array
        array = array.astype(float, copy=False)
        if not (np.abs(array) < LARGEST).all():  # nor is NaN below it
            raise ModelError(f"{name} holds a value that is not finite, or beyond {LARGEST:g}")
        if (array < least).any():
            raise ModelError(f"{name} holds a value below {least:g}")
        return array
