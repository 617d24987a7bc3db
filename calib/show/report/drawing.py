"""Drawing: what all figures share: their size, ink, colours, axes, and how they become files."""

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
from matplotlib import rc_context, style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

from ...common.arrays import Array, Index
from ...common.wording import LONGEST, for_people, one_line, printable
from ..error_scale import STOPS, UNKNOWN, ErrorScale

WIDTH = 3.65  # inches: half of the page's column, and all of a telephone's
ACCENT = "#1c7ed6"
SECOND = "#e8590c"
GREY = "#8b97a3"
INK = "#1d2730"
RULE = "#cfd6dc"
# colours of paper that a page, light or dark, has its own for
_OF_PAGE = {INK: "currentColor", RULE: "var(--rule)"}


def settings() -> AbstractContextManager[None]:
    """Matplotlib's settings for the figures, to be used in a with statement."""
    return style.context(Path(__file__).with_name("figure.mplstyle"))


def panels(heights: Sequence[float]) -> tuple[Figure, list[Axes]]:
    """Return a figure, apart from any window system, and its axes of these heights [inch]."""
    figure = Figure(figsize=(WIDTH, sum(heights)))
    FigureCanvasAgg(figure)
    axes = figure.subplots(
        len(heights), 1, squeeze=False, height_ratios=heights
    )
    return figure, list(axes[:, 0])


def named_rows(names: Sequence[str], label: str) -> tuple[Figure, Axes]:
    """Return a figure with a row for each name, written above it, the first on top."""
    figure, (ax,) = panels([0.45 + 0.4 * len(names)])
    for row, name in enumerate(names):
        ax.annotate(
            one_line(name, LONGEST.name),
            (0.0, row),
            (0, 7),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            in_layout=False,
        )
    ax.set(ylim=(len(names) - 0.6, -0.75), yticks=[], xlabel=label)
    ax.locator_params(axis="x", nbins=4)
    ax.spines[["left", "right", "top"]].set_visible(False)
    return figure, ax


def projections(
    x: Array, views: Sequence[tuple[int, int]], unit: str, below: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes to scale for each view of positions (n, m) [unit].

    views : pairs of coordinates
    below : room for a bar of colours [inch]
    """
    shown = printable(for_people(unit)[1])
    extents = np.maximum(np.ptp(x, axis=0), 1e-9)
    heights = [
        0.35 + 2.9 * min(extents[up] / extents[across], 1.3)
        for across, up in views
    ]
    heights[-1] += below
    figure, axes = panels(heights)
    for ax, view in zip(axes, views, strict=True):
        across, up = (f"{'xyz'[k]} [{shown}]" for k in view)
        ax.set(xlabel=across, ylabel=up, aspect="equal")
        ax.locator_params(nbins=4)
        ax.margins(0.08)
        if unit == "px":  # a picture's y runs down
            ax.invert_yaxis()
    return figure, axes


def colour_map() -> Colormap:
    """Colours of errors, those of the preview, and one for what is not known."""
    colours = LinearSegmentedColormap.from_list("calib", list(STOPS))
    return colours.with_extremes(bad=UNKNOWN)


def colour_bar(
    figure: Figure,
    image: ScalarMappable,
    axes: list[Axes],
    label: str,
    scale: ErrorScale | None = None,
) -> None:
    """Add a bar with the meaning of the colours, with the ticks of a scale of errors."""
    bar = figure.colorbar(
        image, ax=axes, label=label, location="bottom", pad=0.02, aspect=30
    )
    bar.outline.set_visible(False)
    if scale is not None:
        places, words = zip(*scale.ticks(), strict=True)
        bar.set_ticks(places, labels=words)


def draw_lattice(
    ax: Axes, points: Array, edges: Index, values: Array, top: float
) -> LineCollection:
    """Draw edges (m, 2) between nodes (n, 2), coloured by the values (n,) of their ends."""
    lines = LineCollection(
        list(points[edges]),
        array=np.ma.masked_invalid(values[edges].mean(axis=1)),
        cmap=colour_map(),
        linewidths=0.7,
        rasterized=True,  # ten thousand lines as vectors would make the page ten times as large
    )
    lines.set_clim(0.0, top)
    ax.add_collection(lines)
    ax.autoscale()
    return lines


def to_svg(figure: Figure, name: str, words: str) -> str:
    """Return a figure as SVG for a page; `words` describe it."""
    svg = to_file(figure, "svg").decode("utf-8")
    svg = svg[svg.index("<svg") :]
    for ink, page in _OF_PAGE.items():
        svg = svg.replace(ink, page)
    # two equal images, such as colour bars, get one name, which nothing refers to
    svg = re.sub(r'\bid="image[0-9a-f]+"', "", svg)
    # several figures share one page: their names must not meet
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="|url\()#', rf"\1#{name}-", svg)
    return svg.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)


def to_file(figure: Figure, kind: str) -> bytes:
    """Return a figure as "png" or "svg", the first on white, without date and program."""
    engine = figure.get_layout_engine()
    if engine is not None:
        # laid out here: savefig draws a figure twice to lay it out
        engine.execute(figure)
        figure.set_layout_engine("none")
    ground = "white" if kind == "png" else "none"
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "calib"}):  # the same names each time
        figure.savefig(buffer, format=kind, dpi=140, facecolor=ground)
    block = rb"<metadata>.*?</metadata>"
    return re.sub(block, b"", buffer.getvalue(), flags=re.DOTALL)
