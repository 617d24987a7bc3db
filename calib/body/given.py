"""Given: a JSON header of a stranger's file, read key by key; every value checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import ModelError


class Given:
    """A header of a stranger's file, read key by key."""

    def __init__(self, header: Any, where: str) -> None:
        if not isinstance(header, Mapping):
            raise ModelError(f"{where}: expected an object")
        self.header, self.where = header, where

    def value(self, key: str) -> Any:
        """Value of a key, or an error that names it."""
        if key not in self.header:
            raise ModelError(f"{self.where}: {key!r} is missing")
        return self.header[key]

    def refuse(self, key: str, expected: str) -> ModelError:
        """Error for a value that is not what is expected."""
        return ModelError(f"{self.where}: {key!r} is {self.header[key]!r}, expected {expected}")

    def mapping(self, key: str) -> Mapping[str, Any]:
        """An object."""
        value = self.value(key)
        if not isinstance(value, Mapping):
            raise self.refuse(key, "an object")
        return value

    def text(self, key: str) -> str:
        """A short text."""
        value = self.value(key)
        if not isinstance(value, str) or len(value) > 1000:
            raise self.refuse(key, "a short text")
        return value

    def truth(self, key: str) -> bool:
        """True or false."""
        value = self.value(key)
        if not isinstance(value, bool):
            raise self.refuse(key, "true or false")
        return value

    def number(self, key: str, least: float = -np.inf) -> float:
        """A finite number of at least `least`."""
        value = self.value(key)
        if not _is_number(value) or value < least:
            limit = "" if least == -np.inf else f" of at least {least:g}"
            raise self.refuse(key, f"a finite number{limit}")
        return float(value)

    def count(self, key: str) -> int:
        """A whole number, 0 or more."""
        value = self.value(key)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**53:
            raise self.refuse(key, "a count")
        return value

    def sign(self, key: str) -> int:
        """1 or -1."""
        if self.value(key) not in (1, -1) or isinstance(self.value(key), bool):
            raise self.refuse(key, "1 or -1")
        return int(self.value(key))

    def _items(self, key: str, size: int | None) -> list[Any]:
        value = self.value(key)
        if not isinstance(value, list) or (size is not None and len(value) != size):
            raise self.refuse(key, "a list" if size is None else f"a list of {size}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Short texts."""
        items = self._items(key, None)
        if not all(isinstance(v, str) and len(v) <= 1000 for v in items):
            raise self.refuse(key, "short texts")
        return tuple(items)

    def truths(self, key: str, size: int) -> tuple[bool, ...]:
        """`size` values that are true or false."""
        items = self._items(key, size)
        if not all(isinstance(v, bool) for v in items):
            raise self.refuse(key, "true or false each")
        return tuple(items)

    def numbers(self, key: str, size: int) -> list[float]:
        """`size` finite numbers."""
        items = self._items(key, size)
        if not all(_is_number(v) for v in items):
            raise self.refuse(key, "finite numbers")
        return [float(v) for v in items]

    def signs(self, key: str, size: int) -> tuple[int, ...]:
        """`size` values that are 1 or -1."""
        items = self._items(key, size)
        if not all(v in (1, -1) and not isinstance(v, bool) for v in items):
            raise self.refuse(key, "1 or -1 each")
        return tuple(int(v) for v in items)


def _is_number(value: Any) -> bool:
    """Whether a JSON value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300  # false for NaN and infinities
