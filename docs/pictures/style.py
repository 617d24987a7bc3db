"""Style: what all pictures share, readable at 700 pixels on light ground."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from calib.maps.map import Map
from calib.show.error_scale import STOPS, UNKNOWN

FOLDER = Path(__file__).parents[1] / "img"
SCALE = LinearSegmentedColormap.from_list("calib", STOPS)
FIRST, SECOND, THIRD = STOPS[0], STOPS[5], STOPS[7]
INK, FAINT, GREY = "#1d2730", "#cfd6dc", UNKNOWN
_DPI = 125
_SETTINGS = {
    "font.size": 10,
    "axes.titlesize": 10,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": GREY,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def panels(columns: int, height: float, **options: Any) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure of 1,000 pixels' width with its panels in a row; `height` in inches."""
    mpl.rcParams.update(_SETTINGS)
    figure = Figure(figsize=(8.0, height), dpi=_DPI, layout="constrained")
    return figure, figure.subplots(1, columns, squeeze=False, **options)[0]


def lattice(ax: Axes, network: Map, factor: float = 1.0, **options: Any) -> LineCollection:
    """Draw a map's lattice lines in its own space."""
    points = network.weights * factor
    lines = LineCollection(points[network.edges], **{"linewidths": 0.7, "color": GREY, **options})
    ax.add_collection(lines)
    ax.autoscale()
    return lines


def plane(ax: Axes, title: str = "") -> None:
    """Mark a panel as the workspace, in mm."""
    ax.set(xlabel="x [mm]", ylabel="y [mm]", title=title, aspect="equal")


def edge_means(network: Map, value: NDArray[Any]) -> NDArray[Any]:
    """Mean of a node's value over the two ends of each edge."""
    return value[network.edges].mean(axis=1)


def save(figure: Figure, name: str) -> None:
    """Write a picture with 256 colours, which keeps it small."""
    FOLDER.mkdir(exist_ok=True)
    raw = io.BytesIO()
    figure.savefig(raw, facecolor="white", metadata={"Software": None})
    image = Image.open(raw).convert("RGB").quantize(256, method=Image.Quantize.MEDIANCUT)
    image.save(FOLDER / f"{name}.png", optimize=True)
