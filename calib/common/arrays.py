"""Arrays: the types that signatures name, and the shapes that files check."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

TRIANGLE = "triangle"
"""How a file keeps the root of a covariance: its triangle, in single precision."""


class Shape:
    """Axes of an array in an annotation, ``Annotated[Array, Shape("nodes", 3)]``.

    Axes of the same name are of the same length within one object of a model file; `kept` is the
    type that floating-point numbers have there.
    """

    def __init__(self, *axes: str | int, kept: str = "f8") -> None:
        self.axes, self.kept = axes, kept

    @property
    def stored(self) -> np.dtype[np.floating]:
        """Type of the numbers in a file."""
        return np.dtype("f4" if self.kept == TRIANGLE else self.kept)


class Own:
    """Axes of an object inside of another: names of its own, some of which are the other's."""

    def __init__(self, **shared: str) -> None:
        self.shared = shared

    def inner(self, sizes: dict[str, int]) -> dict[str, int]:
        """Lengths of its axes that are known from the other's."""
        return {own: sizes[name] for own, name in self.shared.items() if name in sizes}

    def outer(self, inner: dict[str, int], sizes: dict[str, int]) -> None:
        """Let the other know its lengths."""
        sizes.update({name: inner[own] for own, name in self.shared.items() if own in inner})
