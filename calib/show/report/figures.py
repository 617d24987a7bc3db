"""Figures: errors over both spaces and by socket, lattices, U-matrix, the map over a photo.

Their ink follows the page, light, dark or on paper.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import for_people, length_in_words, printable
from ...maps.map import Map
from ...model.model import Model
from ...model.nominal import nominal_arm
from ...samples.samples import Samples
from ...training.evaluate import Residuals
from ..error_scale import STOPS, UNKNOWN, ErrorScale
from ..workspace import drawn_edges, extent, node_errors, outline

WIDE = 7.4  # inches, the page's column

# the page's own colours, until a figure is written, as figure.mplstyle has them, and on paper
_INK = {"#010203": ("currentColor", "#1d2730"), "#020304": ("var(--rule)", "#cfd6dc")}
_BINS = 36
_PAPERS = "activity"  # the readout of the paper, beside the default
_BORDER, _ARROW = "#12b886", "#e8590c"
_FAR = 5.0  # times the median edge
_ARROWS, _LONG = 300, 0.06  # how many, and how long the longest are, of the picture's width
_CELLS: dict[str, Any] = {"origin": "lower", "aspect": "auto", "interpolation": "nearest"}


def heat_maps(model: Model, residuals: Residuals | None, direction: str) -> Any:
    """Errors of a direction, "forward" or "inverse", over positions; in a plane over joints too."""
    if residuals is None:
        return None
    found = residuals.errors if direction == "forward" else residuals.distance
    flat, factor = len(model.axes) == 2, label("", model.about.unit)[0]
    readouts = [r for r in (model.default_readout, _PAPERS) if r in found][: 2 if flat else 1]
    figure, grid = panels(len(readouts), 2 if flat else 3, 2.9 * len(readouts) if flat else 2.3)
    for row, readout in zip(grid, readouts, strict=True):
        scale = ErrorScale.of(found[readout], model.about.unit, extent(model))
        for ax, view in zip(row, ((0, 1), (0, 2), (1, 2))[: 1 if flat else 3], strict=False):
            image = _heat(ax, residuals.x[:, view] * factor, found[readout], scale)
            _name_axes(ax, model, view)
        if flat:
            row[0].set_title(f"{readout}: workspace")
            joints = residuals.q[:, :2] * _name_joints(row[1], model)
            _heat(row[1], joints, found[readout], scale)
            row[1].set_title(f"{readout}: joint space")
        error_bar(figure, image, row, scale, "mean error")
    return figure


def _name_joints(ax: Any, model: Model) -> Array:
    """Name the axes of the first two joints; return the factors (2,) for what they show."""
    about = model.about
    named = zip(about.joint_names[:2], about.units_of_joints, strict=False)
    factors, names = zip(*(label(*each) for each in named), strict=True)
    ax.set(xlabel=names[0], ylabel=names[1])
    return np.array(factors)


def _name_axes(ax: Any, model: Model, view: tuple[int, int] = (0, 1)) -> float:
    """Name the axes of two coordinates; return the factor for what they show."""
    (factor, across), (_, up) = (label("xyz"[k], model.about.unit) for k in view)
    ax.set(xlabel=across, ylabel=up, aspect="equal")
    ax.locator_params(nbins=4 if len(model.axes) == 3 else 6)
    if model.about.unit == "px":  # a picture's y runs down
        ax.invert_yaxis()
    return factor


def _heat(ax: Any, points: Array, errors: Array, scale: ErrorScale) -> Any:
    """Mean error in the cells of a grid over points (n, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    high = np.where(high > low, high, low + 1.0)  # a joint that never moved has no range
    (x, y), ends = points.T, np.stack([low, high], axis=1)
    count, total = (np.histogram2d(x, y, _BINS, ends, weights=w)[0] for w in (None, errors))
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    shown = np.ma.masked_invalid(scale.share(mean.T))
    return ax.imshow(shown, extent=ends.ravel(), cmap=colour_map(), vmin=0.0, vmax=1.0, **_CELLS)


def lattices(model: Model) -> Any:
    """Both lattices in their spaces, coloured by the expected error."""
    figure, [axes] = panels(1, 2, 3.5)
    errors = node_errors(model)
    scale = ErrorScale.of(np.concatenate(errors), model.about.unit, extent(model))
    factors: list[Any] = [_name_joints(axes[0], model), _name_axes(axes[1], model)]
    parts = {"motor": model.motor, "sensory": model.sensory}
    for ax, by, values, (what, part) in zip(axes, factors, errors, parts.items(), strict=True):
        points = part.weights[:, :2] * by
        lines = draw_lattice(ax, points, drawn_edges(part), values, scale, linewidths=0.7)
        ax.autoscale()
        ax.set_title(f"{what} map, {'x'.join(map(str, part.lattice.shape))} nodes")
    error_bar(figure, lines, axes, scale, "expected error")
    return figure


def u_matrices(model: Model) -> Any:
    """U-matrix of both maps, over their lattices; of three axes the mean over the third."""
    figure, [axes] = panels(1, 2, 2.9)
    for ax, name, part in zip(
        axes, ("motor", "sensory"), (model.motor, model.sensory), strict=True
    ):
        values, shape = u_matrix(part), part.lattice.shape
        if len(shape) == 1:  # a graph: its nodes have no place but where they stand
            image = ax.scatter(*part.units[:, :2].T, c=values, s=4, cmap="cividis", rasterized=True)
            ax.set(xlabel="first coordinate [range]", ylabel="second")
        else:
            shown = values.reshape(*shape[:2], -1).mean(axis=-1).T
            image = ax.imshow(shown, vmax=np.quantile(shown, 0.995), cmap="cividis", **_CELLS)
            ax.set(xlabel="first lattice axis [nodes]", ylabel="second [nodes]")
        ax.set_title(f"{name} map")
        colour_bar(figure, image, ax, "distance [ranges]")
    return figure


def u_matrix(part: Map) -> Array:
    """Mean distance (nodes,) of each node to the nodes that it is joined to, in the unit box."""
    a, b = part.edges.T
    gap = np.linalg.norm(part.scale.difference(part.units[a], part.units[b]), axis=1)
    ends = part.edges.T.ravel()
    count = np.bincount(ends, minlength=part.size)
    return np.bincount(ends, np.tile(gap, 2), part.size) / np.maximum(count, 1)


def over_photo(model: Model, residuals: Residuals | None) -> Any:
    """Draw the sensory map over the model's photo; None where it has none."""
    from matplotlib.collections import LineCollection

    photo, unit = model.photo, model.about.unit
    if photo is None or len(model.axes) != 2:
        return None
    pixels = photo.pixels()
    left, right, low, high = photo.box
    # beside it the colour bar, below it the legend
    figure, [[ax]] = panels(1, 1, (WIDE - 1.0) * len(pixels) / pixels.shape[1] + 0.65)
    # a lighter photo leaves the colours to what is drawn over it
    ax.imshow(pixels, extent=photo.box, interpolation="antialiased", aspect="equal")
    ax.imshow([[1.0]], extent=photo.box, cmap="gray", vmin=0, vmax=1, alpha=0.18, aspect="equal")
    errors, nodes, edges = node_errors(model)[1], model.sensory.weights, drawn_edges(model.sensory)
    scale = ErrorScale.of(errors, unit, extent(model))
    long = np.linalg.norm(np.diff(nodes[edges], axis=1)[:, 0], axis=1)
    # an edge that is far longer than others leads across what the arm does not reach
    edges = edges[np.isfinite(errors[edges]).all(axis=1) & (long < _FAR * np.median(long))]
    lines = draw_lattice(ax, nodes, edges, errors, scale, linewidths=0.8, alpha=0.85)
    ax.set(xlim=(left, right), ylim=(low, high), xticks=[], yticks=[])
    around = LineCollection(list(outline(model)), colors=_BORDER, linewidths=2.2)
    around.set_label("what the learned range reaches")
    ax.add_collection(around, autolim=False)
    if residuals is not None:
        some = thinned(len(residuals.q), _ARROWS)
        seen, miss = residuals.x[some], residuals.forward[model.default_readout][some]
        away = np.linalg.norm(miss, axis=1)
        length = max(float(np.quantile(away, 0.95)), 1e-9)
        times = int(float(f"{max(_LONG * (right - left) / length, 1.0):.0e}"))
        words = (
            f"from a seen tip to the predicted one: {length_in_words(float(away.mean()), unit)} "
        )
        words += f"on average, drawn {times:,} times as long"
        style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "zorder": 4}
        ax.quiver(*seen.T, *(times * miss).T, color=_ARROW, width=0.0028, **style)
        ax.plot(*seen.T, "o", ms=3.0, mfc="#ffffff", mec="#1d2730", label=words, zorder=5)
    figure.legend(loc="outside lower left", ncols=1)
    error_bar(figure, lines, [ax], scale, "expected error")
    return figure


def by_socket(model: Model, log: Samples | None) -> Any:
    """Distances of tips from the mean of their socket, by the drawing and as learned."""
    if log is None or log.touch is None:
        return None
    touch, q = log.touch, model.about.joints_of(log)
    tips = {"as learned": model.forward(q)}
    if model.about.urdf:
        tips["as drawn"] = nominal_arm(model).forward(q)
    figure, [[ax]] = panels(1, 1, 1.0 + 0.32 * len(touch.sockets))
    for up, (text, tip) in zip((-0.16, 0.16), tips.items(), strict=False):
        off = 1e3 * np.linalg.norm(tip - touch.means(tip)[touch.number], axis=1)
        off[touch.number < 0] = np.nan  # a row of a sensor is in no socket
        ax.plot(off, touch.number + up, ".", alpha=0.5, label=text)
    ax.set_yticks(range(len(touch.sockets)), [plain_text(" ".join(s)) for s in touch.sockets])
    ax.set(xscale="log", xlabel="distance from the mean of all tips in that socket [mm]")
    ax.xaxis.set_major_formatter("{x:g}")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


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
