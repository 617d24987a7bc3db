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

    def _fits(self, key: str, fits: bool, expected: str) -> Any:
        """The value of a key, or an error that says what was expected."""
        if not fits:
            raise ModelError(f"{self.where}: {key!r} is {self.header[key]!r}, expected {expected}")
        return self.header[key]

    def mapping(self, key: str) -> Mapping[str, Any]:
        """An object."""
        return dict(self._fits(key, isinstance(self.value(key), Mapping), "an object"))

    def text(self, key: str) -> str:
        """A short text."""
        return str(self._fits(key, _is_text(self.value(key)), "a short text"))

    def truth(self, key: str) -> bool:
        """True or false."""
        return bool(self._fits(key, isinstance(self.value(key), bool), "true or false"))

    def number(self, key: str, least: float = -np.inf) -> float:
        """A finite number of at least `least`."""
        value = self.value(key)
        limit = "" if least == -np.inf else f" of at least {least:g}"
        return float(
            self._fits(key, _is_number(value) and value >= least, f"a finite number{limit}")
        )

    def count(self, key: str) -> int:
        """A whole number, 0 or more."""
        value = self.value(key)
        whole = isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53
        return int(self._fits(key, whole, "a count"))

    def sign(self, key: str) -> int:
        """1 or -1."""
        return int(self._fits(key, _is_sign(self.value(key)), "1 or -1"))

    def _listed(self, key: str, fits: Any, size: int | None, what: str) -> list[Any]:
        value = self.value(key)
        good = isinstance(value, list | tuple) and len(value) == (
            len(value) if size is None else size
        )
        expected = f"a list{'' if size is None else f' of {size}'} of {what}"
        return list(self._fits(key, good and all(map(fits, value)), expected))

    def texts(self, key: str) -> tuple[str, ...]:
        """Short texts."""
        return tuple(self._listed(key, _is_text, None, "short texts"))

    def truths(self, key: str, size: int) -> tuple[bool, ...]:
        """`size` values that are true or false."""
        return tuple(self._listed(key, lambda v: isinstance(v, bool), size, "true or false"))

    def numbers(self, key: str, size: int) -> tuple[float, ...]:
        """`size` finite numbers."""
        return tuple(float(v) for v in self._listed(key, _is_number, size, "finite numbers"))

    def signs(self, key: str, size: int) -> tuple[int, ...]:
        """`size` values that are 1 or -1."""
        return tuple(int(v) for v in self._listed(key, _is_sign, size, "1 or -1"))


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= 1000


def _is_sign(value: Any) -> bool:
    return value in (1, -1) and not isinstance(value, bool)


def _is_number(value: Any) -> bool:
    """Whether a JSON value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300  # false for NaN and infinities
