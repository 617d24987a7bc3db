"""Sketch: a tiny picture of the expected error over the workspace, in characters."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.model.model import Model

SHADES = "░▒▓█"
PLAIN = ".:+#"
_WIDTH, _MOST = 44, 16
_TALL = 2.1  # a character's height over its width


def show_sketch(model: Model) -> None:
    """Print the picture where standard output is a terminal, and nothing elsewhere."""
    if not sys.stdout.isatty():
        return
    encoding = (sys.stdout.encoding or "").lower()
    shades = SHADES if encoding.startswith("utf") else PLAIN
    print("\n".join(sketch(model, shades)))


def sketch(model: Model, shades: str = SHADES, width: int = _WIDTH) -> list[str]:
    """Return the lines of a picture of the workspace, some `width` characters wide, and a legend.

    `shades` are characters from the least to the greatest error.
    """
    import numpy as np

    from calib.show.error_scale import ErrorScale
    from calib.show.workspace import cell_means, downwards, extent, sensory_errors

    x, errors = model.sensory.weights, sensory_errors(model)
    known = np.isfinite(errors)
    if known.any():
        x, errors = x[known], errors[known]
    low, span = x.min(axis=0), np.ptp(x, axis=0)
    cell = max(span[0] / width, span[1] / (_MOST * _TALL), 1e-300)
    columns = int(span[0] / cell) + 1
    rows = int(span[1] / (cell * _TALL)) + 1
    mean = cell_means(x[:, :2], errors, low[:2], cell * np.array([1.0, _TALL]), (rows, columns))
    scale = ErrorScale.of(errors, model.about.unit, extent(model))
    step = np.minimum(scale.share(mean) * len(shades), len(shades) - 1)
    lines = ["".join(" " if np.isnan(s) else shades[int(s)] for s in row).rstrip() for row in step]
    text = f"expected error (95 %): {scale.words()}"
    if not scale.rounding:
        text = f"{text}  {shades[0]} low  {shades[-1]} high"
    upwards = lines if downwards(model.about.unit) else lines[::-1]
    return [*upwards, text]
