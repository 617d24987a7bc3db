"""Photo: a picture of the arm by the camera that measured it, for drawing a map over it."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError

_LARGEST = 3_000_000  # bytes
_START = b"\xff\xd8\xff"  # of a JPEG


@dataclass(frozen=True)
class Photo:
    """A picture whose borders are known positions.

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
