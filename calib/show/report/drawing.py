"""Drawing: what all figures share: their size, ink, colours, units, and how they become files."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...common.arrays import Array
from ...common.wording import for_people, printable
from ..error_scale import STOPS, UNKNOWN, ErrorScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

WIDTH = 3.65  # inches: half of the page's column, and all of a telephone's
ACCENT = "#1c7ed6"
SECOND = "#e8590c"
GREY = "#8b97a3"
# the page's own colours, until a figure is written, as figure.mplstyle has them, and on paper
_INK = {"#010203": ("currentColor", "#1d2730"), "#020304": ("var(--rule)", "#cfd6dc")}


def settings(*, paper: bool = False) -> Any:
    """Matplotlib's settings for the figures, to be used in a with statement."""
    import matplotlib as mpl

    file = Path(__file__).with_name("figure.mplstyle")
    style: Any = mpl.rc_params_from_file(file, use_default_template=False)
    if paper:
        for name, value in list(style.items()):
            if isinstance(value, str) and value in _INK:
                style[name] = _INK[value][1]
    return mpl.rc_context(style)


def panels(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of this height [inch], apart from any window system, and its axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, 1, squeeze=False)[:, 0])


def plain_text(name: str) -> str:
    r"""Return a name from a file as a figure shows it: never as a formula, on one line.

    Examples
    --------
    >>> plain_text(r"$\foo$")
    '\\$\\foo\\$'
    """
    return printable(name).replace("$", r"\$")


def label(name: str, unit: str) -> tuple[float, str]:
    """Factor from a unit to the one that figures show, and the label of an axis."""
    factor, shown = for_people(unit)
    return factor, f"{plain_text(name)} [{plain_text(shown)}]"


def colour_map(unknown: str = "none") -> Colormap:
    """Colours of errors, those of the preview, and one for what is not known."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("calib", list(STOPS)).with_extremes(
        bad=unknown
    )


def colour_bar(figure: Figure, image: Any, axes: list[Axes], text: str) -> Any:
    """Add a bar that tells what the colours mean."""
    bar = figure.colorbar(
        image,
        ax=axes,
        location="bottom",
        shrink=0.9,
        pad=0.02,
        aspect=30,
        fraction=0.06,
    )
    bar.set_label(text)
    bar.outline.set_visible(False)
    return bar


def error_bar(
    figure: Figure, image: Any, axes: list[Axes], scale: ErrorScale, text: str
) -> None:
    """Add a bar with the ticks of a scale of errors."""
    places, words = zip(*scale.ticks(3), strict=True)
    if scale.empty:
        colour_bar(figure, image, axes, f"{text}: {words[0]}").set_ticks([])
    else:
        colour_bar(figure, image, axes, text).set_ticks(
            list(places), labels=list(words)
        )


def draw_lattice(
    ax: Axes, points: Array, edges: Any, errors: Array, scale: ErrorScale, **style: Any
) -> LineCollection:
    """Draw edges (m, 2) between nodes (n, 2), coloured by the errors (n,) of their ends."""
    from matplotlib.collections import LineCollection

    lines = LineCollection(
        list(points[edges]),
        array=np.ma.masked_invalid(scale.share(errors)[edges].mean(axis=1)),
        cmap=colour_map(unknown=UNKNOWN),
        rasterized=True,  # ten thousand lines as vectors would make the page ten times as large
        **style,
    )
    lines.set_clim(0.0, 1.0)
    ax.add_collection(lines)
    return lines


def to_svg(figure: Figure, name: str, words: str) -> str:
    """Return a figure as SVG for a page; `words` say what it shows."""
    svg = to_file(figure, "svg").decode("utf-8")
    svg = svg[svg.index("<svg") :]
    for ink, (page, _) in _INK.items():  # which matplotlib cannot name
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
    ):  # laid out here, since savefig draws a figure twice to lay it out
        engine.execute(figure)
        figure.set_layout_engine("none")
    if kind == "png":
        metadata: Any = {"Software": None}
        figure.savefig(
            buffer, format=kind, dpi=144, facecolor="white", metadata=metadata
        )
        return buffer.getvalue()
    figure.savefig(buffer, format=kind, dpi=130)
    return re.sub(rb"<metadata>.*?</metadata>", b"", buffer.getvalue(), flags=re.DOTALL)
