"""Drawing: figures whose ink follows the page, light, dark or on paper."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...common.wording import for_people, printable
from ..error_scale import STOPS, UNKNOWN, ErrorScale

WIDE = 7.4  # inches, the page's column

# the page's own colours, until a figure is written, as figure.mplstyle has them, and on paper
_INK = {"#010203": ("currentColor", "#1d2730"), "#020304": ("var(--rule)", "#cfd6dc")}


def settings(*, paper: bool = False) -> Any:
    """Matplotlib's settings for the figures, to be used in a with statement."""
    import matplotlib as mpl

    file = Path(__file__).with_name("figure.mplstyle")
    chosen: Any = dict(mpl.rc_params_from_file(file, use_default_template=False))
    if paper:
        chosen |= {k: _INK[v][1] for k, v in chosen.items() if isinstance(v, str) and v in _INK}
    return mpl.rc_context(chosen)


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


def panels(rows: int, columns: int, height: float) -> tuple[Any, Any]:
    """Return a figure of this height [inch], apart from any window system, and its axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDE, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def colour_map(unknown: str = "none") -> Any:
    """Colours of errors, those of the preview, and one for what is not known."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("calib", list(STOPS)).with_extremes(bad=unknown)


def colour_bar(figure: Any, image: Any, axes: Any, text: str) -> Any:
    """Add a bar that tells what the colours mean."""
    bar = figure.colorbar(image, ax=list(np.ravel(axes)), shrink=0.9, pad=0.01, aspect=24)
    bar.set_label(text)
    bar.outline.set_visible(False)
    return bar


def error_bar(figure: Any, image: Any, axes: Any, scale: ErrorScale, text: str) -> None:
    """Add a bar with the ticks of a scale of errors."""
    places, words = zip(*scale.ticks(5), strict=True)
    bar = colour_bar(figure, image, axes, f"{text}: {words[0]}" if scale.empty else text)
    bar.set_ticks([] if scale.empty else list(places), labels=[] if scale.empty else list(words))


def draw_lattice(
    ax: Any, points: Array, edges: Any, errors: Array, scale: ErrorScale, **style: Any
) -> Any:
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


def to_svg(figure: Any, name: str, words: str) -> str:
    """Return a figure as SVG for a page; `words` say what it shows."""
    buffer = io.StringIO()
    # laid out here, since savefig draws a figure twice to lay it out
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    figure.savefig(buffer, format="svg", dpi=150)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    for ink, (own, _) in _INK.items():  # which matplotlib cannot name
        svg = svg.replace(ink, own)
    # two equal images, such as colour bars, get one name, which nothing refers to
    svg = re.sub(r'\bid="image[0-9a-f]+"', "", svg)
    # several figures share one page: their names must not meet
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="|url\()#', rf"\1#{name}-", svg)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)  # date and program
    return svg.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)


def to_png(figure: Any) -> bytes:
    """Return a figure, drawn with the ink of paper, as a PNG on white."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=144, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
