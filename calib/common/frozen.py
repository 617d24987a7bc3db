"""Read-only views: what a model holds can be looked at, not changed behind its back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A view of an array that refuses to be written through."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def own_floats(holder: object, *names: str) -> None:
    """Let a frozen dataclass hold read-only copies of arrays of numbers, in its `__post_init__`."""
    for name in names:
        array = np.array(getattr(holder, name), dtype=float)
        array.setflags(write=False)
        object.__setattr__(holder, name, array)


def freeze(holder: object, *names: str) -> None:
    """Let arrays of a frozen dataclass be read-only views, in its `__post_init__`."""
    for name in names:
        value = getattr(holder, name)
        if isinstance(value, np.ndarray):
            object.__setattr__(holder, name, frozen(value))


class ReadOnly:
    """Base of a frozen dataclass whose arrays are all read-only views."""

    def __post_init__(self) -> None:
        freeze(self, *vars(self))
