"""Style: figures whose ink follows the page, light, dark or on paper."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

from ...common.wording import printable
from ..error_scale import STOPS

INK, FAINT = "#010203", "#020304"
"""Stand for the page's own colours until a figure is written; figure.mplstyle has them too."""

HUES = {
    "local": "#1c7ed6",
    "body": "#2f9e44",
    "linear": "#9c36b5",
    "activity": "#e8590c",
    "winner": "#7b8794",
}
"""Colours of the readouts; in figures their marks and dashes differ too."""
DASHES = {"local": "-", "body": "-.", "linear": (0, (5, 1)), "activity": "--", "winner": ":"}

_SETTINGS = Path(__file__).with_name("figure.mplstyle")
_PAPER = {INK: "#1d2730", FAINT: "#cfd6dc"}


def settings(*, paper: bool = False) -> Any:
    """Matplotlib's settings for the figures, to be used in a with statement.

    With `paper` the ink is dark, else it is the page's own.
    """
    import matplotlib as mpl

    chosen: Any = dict(mpl.rc_params_from_file(_SETTINGS, use_default_template=False))
    if paper:
        chosen |= {k: _PAPER[v] for k, v in chosen.items() if isinstance(v, str) and v in _PAPER}
    return mpl.rc_context(chosen)


def plain_text(name: str) -> str:
    r"""Return a name from a file as a figure shows it: never as a formula, on one line.

    Examples
    --------
    >>> plain_text(r"$\foo$")
    '\\$\\foo\\$'
    """
    return printable(name).replace("$", r"\$")


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of this size [inch], apart from any window system."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def colour_map(unknown: str = "none") -> Any:
    """Colours of errors, those of the preview, and one for what is not known."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("calib", list(STOPS)).with_extremes(bad=unknown)


def to_svg(figure: Any, name: str, words: str) -> str:
    """Return a figure as SVG for a page; `words` say what it shows."""
    buffer = io.StringIO()
    metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    # laid out here, since savefig draws a figure twice to lay it out
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    figure.savefig(buffer, format="svg", dpi=150, metadata=metadata)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    # the page's own colours, light or dark, which matplotlib cannot name
    svg = svg.replace(INK, "currentColor").replace(FAINT, "var(--rule)")
    # two equal images, such as colour bars, get one name, which nothing refers to
    svg = re.sub(r'\bid="image[0-9a-f]+"', "", svg)
    # several figures share one page: their names must not meet
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="|url\()#', rf"\1#{name}-", svg)
    # what matplotlib leaves of it names no source and no date, and is of no use in a page
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    return svg.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)


def to_png(figure: Any) -> bytes:
    """Return a figure, drawn with the ink of paper, as a PNG on white."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=144, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
