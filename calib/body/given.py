"""Given: values of a stranger's JSON as the annotations of a dataclass say, every one checked."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from ..errors import ModelError

_LONGEST = 1000
"""Characters of a text."""

_LARGEST = 1e300
"""No number is so large; infinities and NaN are not below it either."""

_WHOLE = 2**53


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
    if get_origin(kind) is dict and isinstance(value, Mapping):
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
        int: number and isinstance(value, int) and abs(value) < _WHOLE,
        float: number and abs(value) < _LARGEST,
        Any: True,
    }
    if not fits.get(kind, False):
        raise ModelError(f"{where} is {value!r:.60}, expected {kind}")
    return float(value) if kind is float else value


def given_fields(
    kind: Any, header: Mapping[str, Any], where: str, leave: Collection[str] = ()
) -> dict[str, Any]:
    """The fields of a dataclass but those to `leave`, from an object that may hold more keys."""
    hints, found = get_type_hints(kind), {}
    for name in (field.name for field in fields(kind) if field.name not in leave):
        if name not in header:
            raise ModelError(f"{where}: {name!r} is missing")
        found[name] = given(hints[name], header[name], f"{where}.{name}")
    return found


def refuse(impossible: Mapping[str, bool], where: str) -> None:
    """Refuse values of the right type that are impossible, by what was expected."""
    for expected, wrong in impossible.items():
        if wrong:
            raise ModelError(f"{where}: expected {expected}")
