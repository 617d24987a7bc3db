"""Drawing: what all figures share: their size, ink, colours, axes, and how they become files."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...common.arrays import Array
from ...common.wording import for_people, printable
from ..error_scale import STOPS, UNKNOWN, ErrorScale
from ..settings import SETTINGS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

WIDTH = 3.65  # inches: half of the page's column, and all of a telephone's
ACCENT = "#1c7ed6"
SECOND = "#e8590c"
GREY = "#8b97a3"
INK = "#010203"
RULE = "#020304"
# the page's own colours, which Matplotlib cannot name, and those on paper
_OF_PAGE = {INK: "currentColor", RULE: "var(--rule)"}
_ON_PAPER = {INK: "#1d2730", RULE: "#cfd6dc"}


def settings(*, paper: bool = False) -> AbstractContextManager[None]:
    """Matplotlib's settings for the figures, to be used in a with statement."""
    import matplotlib as mpl

    file = Path(__file__).with_name("figure.mplstyle")
    style = mpl.rc_params_from_file(file, use_default_template=False)
    if paper:
        inks = {
            name: value
            for name, value in style.items()
            if str(value) in _ON_PAPER
        }
        style.update({name: _ON_PAPER[ink] for name, ink in inks.items()})
    return mpl.rc_context(style)


def panels(heights: Sequence[float]) -> tuple[Figure, list[Axes]]:
    """Return a figure, apart from any window system, and its axes of these heights [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

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
            plain_text(name),
            (0.0, row),
            (0, 7),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
        )
    ax.set(ylim=(len(names) - 0.6, -0.75), yticks=[], xlabel=plain_text(label))
    ax.locator_params(axis="x", nbins=4)
    ax.spines[["left", "right", "top"]].set_visible(False)
    return figure, ax


def plain_text(name: str) -> str:
    r"""Return a name from a file as a figure shows it: never as a formula, on one line.

    Examples
    --------
    >>> plain_text(r"$\foo$")
    '\\$\\foo\\$'
    """
    return printable(name).replace("$", r"\$")


def name_axes(ax: Axes, unit: str, view: tuple[int, int] = (0, 1)) -> None:
    """Name the axes of two coordinates, in a unit for people."""
    shown = plain_text(for_people(unit)[1])
    across, up = ("xyz"[k] for k in view)
    ax.set(
        xlabel=f"{across} [{shown}]", ylabel=f"{up} [{shown}]", aspect="equal"
    )
    ax.locator_params(nbins=4)
    if unit == "px":  # a picture's y runs down
        ax.invert_yaxis()


def colour_map(unknown: str = "none") -> Colormap:
    """Colours of errors, those of the preview, and one for what is not known."""
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("calib", list(STOPS))
    return colours.with_extremes(bad=unknown)


def smooth_field(
    ax: Axes, points: Array, share: Array, cells: int = 110
) -> ScalarMappable:
    """Draw the mean of values (n,) over a grid of points (n, 2), nothing far from them."""
    from scipy.ndimage import gaussian_filter

    low = points.min(axis=0)
    high = points.max(axis=0)
    margin = 0.06 * (high - low).max()
    box = np.column_stack([low - margin, high + margin])
    finite = np.isfinite(share)
    x, y = points[finite].T
    counts = np.histogram2d(x, y, cells, box.tolist())[0]
    sums = np.histogram2d(x, y, cells, box.tolist(), weights=share[finite])[0]
    weight = gaussian_filter(counts, 2.6)
    total = gaussian_filter(sums, 2.6)
    thin = weight < SETTINGS.thin * np.median(weight[counts > 0])
    grid = np.ma.masked_where(thin, total / np.maximum(weight, 1e-12))
    ends = tuple(box.ravel())
    return ax.imshow(grid.T, extent=ends, cmap=colour_map(), vmin=0.0, vmax=1.0)


def error_bar(
    figure: Figure,
    image: ScalarMappable,
    axes: list[Axes],
    scale: ErrorScale,
    label: str,
) -> None:
    """Add a bar with the ticks of a scale of errors."""
    places, words = zip(*scale.ticks(), strict=True)
    if scale.empty:
        colour_bar(figure, image, axes, f"{label}: {words[0]}").set_ticks([])
    else:
        colour_bar(figure, image, axes, label).set_ticks(places, labels=words)


def colour_bar(
    figure: Figure, image: ScalarMappable, axes: list[Axes], label: str
) -> Colorbar:
    """Add a bar that tells what the colours mean."""
    bar = figure.colorbar(
        image,
        ax=axes,
        label=label,
        location="bottom",
        shrink=0.9,
        pad=0.02,
        aspect=30,
    )
    bar.outline.set_visible(False)
    return bar


def draw_lattice(
    ax: Axes,
    points: Array,
    edges: NDArray[np.intp],
    errors: Array,
    scale: ErrorScale,
    linewidth: float = 0.7,
) -> LineCollection:
    """Draw edges (m, 2) between nodes (n, 2), coloured by the errors (n,) of their ends."""
    from matplotlib.collections import LineCollection

    lines = LineCollection(
        list(points[edges]),
        array=np.ma.masked_invalid(scale.share(errors)[edges].mean(axis=1)),
        cmap=colour_map(unknown=UNKNOWN),
        linewidths=linewidth,
        rasterized=True,  # ten thousand lines as vectors would make the page ten times as large
    )
    lines.set_clim(0.0, 1.0)
    ax.add_collection(lines)
    return lines


def to_svg(figure: Figure, name: str, words: str) -> str:
    """Return a figure as SVG for a page; `words` say what it shows."""
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
    buffer = io.BytesIO()
    engine = figure.get_layout_engine()
    if (
        engine is not None
    ):  # laid out here: savefig draws a figure twice to lay it out
        engine.execute(figure)
        figure.set_layout_engine("none")
    if kind == "png":
        metadata = {"Software": None}
        figure.savefig(
            buffer, format=kind, dpi=144, facecolor="white", metadata=metadata
        )
    else:
        figure.savefig(buffer, format=kind, dpi=130)
    return re.sub(
        rb"<metadata>.*?</metadata>", b"", buffer.getvalue(), flags=re.DOTALL
    )
