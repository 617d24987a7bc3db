"""Photo: a model's picture as a layer of the preview, where its positions are drawn."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrows import Arrows
from .canvas import Canvas
from .placement import Placement

if TYPE_CHECKING:
    from ...model.model import Model
    from ...samples.samples import Samples

Array = NDArray[np.float64]

LAYER, ARROWS = "Photo", "Residuals"
ARROW, SEEN = "#e8590c", "#ffffff"


def corners(model: Model, placement: Placement) -> Array:
    """Return the photo's corners in the scene, (4, 3) from the lower left; (0, 3) without one."""
    if model.photo is None or len(model.axes) != 2:
        return np.empty((0, 3))
    left, right, low, high = model.photo.box
    return placement.lift([[left, low], [right, low], [right, high], [left, high]])


def draw_photo(canvas: Canvas, model: Model, places: Array) -> None:
    """Draw a model's photo between its corners (4, 3)."""
    if model.photo is not None:
        content = base64.b64encode(model.photo.jpeg).decode("ascii")
        canvas.image(f"{LAYER}/picture", places, f"data:image/jpeg;base64,{content}")


def arrows(model: Model, samples: Samples | None) -> Arrows | None:
    """Return arrows of a log's rows, or of those that the model keeps."""
    rows = samples or model.rows
    if rows is None or model.photo is None:
        return None
    left, right, *_ = model.photo.box
    return Arrows.of(model, rows.q, rows.x, right - left)


def draw_arrows(canvas: Canvas, seen: Array, ends: Array, dot: float) -> None:
    """Draw arrows between points (n, 3) of the scene as lines that start at dots."""
    n = len(seen)
    pairs = np.arange(2 * n).reshape(2, n).T
    canvas.lines(f"{ARROWS}/lines", np.concatenate([seen, ends]), pairs, ARROW)
    canvas.points(f"{ARROWS}/seen", seen, SEEN, dot)
