"""Measured: rows of its log and a photo by its camera, which a model keeps.

Use them to compare a model with what it was learned from, or to draw a map over the arm.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Shape
from ..common.frozen import ReadOnly
from ..errors import ModelError

_LARGEST = 3_000_000  # bytes
_START = b"\xff\xd8\xff"  # of a JPEG

MOST_ROWS = 5_000
"""Rows that are kept of a longer log, evenly spread over it."""


@dataclass(frozen=True)
class Photo:
    """A picture of the arm by the camera that measured it; its borders are known positions.

    Raises ValueError if it is no JPEG, too large, or the borders are no box.
    """

    jpeg: bytes  # the picture
    # [unit], positions of its left, right, lower and upper border. Of pixels the lower one is the
    # larger: they count from the top.
    box: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        left, right, low, high = self.box
        if not all(map(math.isfinite, self.box)) or left >= right or low == high:
            raise ValueError(f"{self.box} is no box")
        if not self.jpeg.startswith(_START) or len(self.jpeg) > _LARGEST:
            raise ValueError("the photo is no JPEG of at most 3 MB")

    def pixels(self) -> NDArray[np.uint8]:
        """Return red, green and blue (height, width, 3), the first row on top."""
        from PIL import Image

        try:
            with Image.open(io.BytesIO(self.jpeg)) as opened:
                return np.asarray(opened.convert("RGB"))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            raise ModelError(
                "the model's photo cannot be read", hint="keep another one with `photo`"
            ) from None


@dataclass(frozen=True, eq=False)
class Rows(ReadOnly):
    """Measured rows."""

    q: Annotated[Array, Shape("rows", "dof")]  # [rad or m], joint values
    x: Annotated[Array, Shape("rows", "width")]  # [unit], positions

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def of(q: Array, x: Array) -> Rows:
        """At most 5,000 of the rows of a log, evenly spread over it."""
        every = -(-len(q) // MOST_ROWS)
        return Rows(q[::every].copy(), x[::every].copy())
