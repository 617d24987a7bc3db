"""Types that signatures name, shapes that files check, and views that refuse a change."""

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Range = tuple[float, float]  # of a joint [rad or m]
Document = Mapping[str, Any]  # an object of JSON
_Number = TypeVar("_Number", bound=np.generic)

TRIANGLE = "triangle"
"""How a file keeps the root of a covariance: its triangle, in single precision."""


class Shape:
    """Axes of an array in an annotation, ``Annotated[Array, Shape("nodes", 3)]``.

    Axes of the same name are of the same length within one object of a model file; `storage` is
    the type that floating-point numbers have there.
    """

    def __init__(self, *axes: str | int, storage: str = "f8") -> None:
        self.axes = axes
        self.storage = storage

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Type of the numbers in a file."""
        return np.dtype("f4" if self.storage == TRIANGLE else self.storage)


def frozen(array: NDArray[_Number]) -> NDArray[_Number]:
    """A view of an array that refuses to be written through."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def freeze_copies(holder: object, *names: str) -> None:
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
