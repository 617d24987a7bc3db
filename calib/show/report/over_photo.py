"""The map over a photo of the arm: lattice, border, and arrows from seen to predicted tips."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrows import Arrows
from ..error_scale import ErrorScale
from ..workspace import border, drawn_edges, extent, sensory_errors
from .maps import WIDE, colour_bar
from .style import colour_map, new_figure

if TYPE_CHECKING:
    from ...model.photo import Photo
    from .evidence import Evidence

BORDER, ARROW = "#12b886", "#e8590c"
_FAR = 5.0  # times the median edge
_DOT: dict[str, Any] = {"ms": 3.0, "mfc": "#ffffff", "mec": "#1d2730", "mew": 0.6}


def over_photo(evidence: Evidence) -> Any:
    """Draw the sensory map over the model's photo; None where it has none."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    model, photo = evidence.model, evidence.model.photo
    if photo is None or len(model.axes) != 2:
        return None
    pixels = photo.pixels()
    left, right, low, high = photo.box
    # beside it the colour bar, below it the legend
    figure = new_figure(WIDE, (WIDE - 1.0) * len(pixels) / pixels.shape[1] + 0.65)
    ax = figure.subplots()
    # a lighter photo leaves the colours to what is drawn over it
    ax.imshow(pixels, extent=photo.box, interpolation="antialiased", aspect="equal")
    ax.imshow([[1.0]], extent=photo.box, cmap="gray", vmin=0, vmax=1, alpha=0.18, aspect="equal")
    ax.set(xlim=(left, right), ylim=(low, high), xticks=[], yticks=[])
    for spine in ax.spines.values():
        spine.set_visible(False)
    errors = sensory_errors(model)
    scale = ErrorScale.of(errors, model.about.unit, extent(model))
    edges = drawn_edges(model.sensory)
    long = np.linalg.norm(np.diff(model.sensory.weights[edges], axis=1)[:, 0], axis=1)
    # an edge that is far longer than others leads across what the arm does not reach
    edges = edges[np.isfinite(errors[edges]).all(axis=1) & (long < _FAR * np.median(long))]
    lines = LineCollection(
        list(model.sensory.weights[edges]),
        array=scale.share(errors)[edges].mean(axis=1),
        cmap=colour_map(),
        linewidths=0.8,
        alpha=0.85,
        rasterized=True,
    )
    lines.set_clim(0.0, 1.0)
    ax.add_collection(lines, autolim=False)
    around = LineCollection(list(border(model)), colors=BORDER, linewidths=2.2, capstyle="round")
    ax.add_collection(around, autolim=False)
    words = {"what the learned range reaches": Line2D([], [], color=BORDER, lw=2.2)}
    if label := _arrows(ax, evidence, photo):
        words[label] = Line2D([], [], color=ARROW, lw=1.4, marker="o", **_DOT)
    figure.legend(words.values(), words, loc="outside lower left", ncols=1)
    colour_bar(figure, lines, [ax], scale, "expected error")
    return figure


def _arrows(ax: Any, evidence: Evidence, photo: Photo) -> str:
    """Draw where tips were seen, and arrows to where the model has them; say what they mean."""
    found = evidence.residuals
    if found is None:
        return ""
    arrows = Arrows.of(evidence.model, found.q, found.x, photo.box[1] - photo.box[0])
    if arrows is None:
        return ""
    ax.quiver(
        *arrows.seen.T,
        *(arrows.ends - arrows.seen).T,
        color=ARROW,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.0028,
        headwidth=4.5,
        headlength=5.0,
        zorder=4,
    )
    ax.plot(*arrows.seen.T, "o", zorder=5, **_DOT)
    return arrows.words
