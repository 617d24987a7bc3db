"""Figures of the maps: errors over both spaces, lattices, U-matrix and hits, all over a photo."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...maps.map import Map
from ...model.about import About
from ..arrows import Arrows
from ..error_scale import UNKNOWN, ErrorScale
from ..workspace import (
    downwards,
    drawn_edges,
    motor_errors,
    outline,
    sensory_errors,
)
from .evidence import Evidence
from .style import colour_map, new_figure, plain_text
from .tables import figure_unit

_BINS = 36
_PAPERS = "activity"  # the readout of the paper, beside the default
WIDE = 7.4  # inches, the page's column
BORDER, ARROW = "#12b886", "#e8590c"
_FAR = 5.0  # times the median edge
PROJECTIONS = {2: ((0, 1),), 3: ((0, 1), (0, 2), (1, 2))}
"""Pairs of coordinates in which positions in a plane, and in space, are seen."""


def joint_axis(about: About, k: int) -> tuple[float, str]:
    """Factor from a joint's SI unit to the one that figures show, and the axis' label."""
    name = plain_text(about.joint_names[k])
    return (math.degrees(1.0), f"{name} [deg]") if about.revolute[k] else (1e3, f"{name} [mm]")


def heat_maps(evidence: Evidence, direction: str) -> Any:
    """Errors of a direction, "forward" or "inverse", over positions; in a plane over joints too.

    Positions in space are seen along each axis of the sensor.
    """
    residuals, model = evidence.residuals, evidence.model
    if residuals is None:
        return None
    found = residuals.errors if direction == "forward" else residuals.distance
    views, flat = PROJECTIONS[len(model.axes)], len(model.axes) == 2
    readouts = [r for r in (model.default_readout, _PAPERS) if r in found][: 2 if flat else 1]
    figure = new_figure(WIDE, 2.9 * len(readouts) if flat else 2.3)
    grid = figure.subplots(len(readouts), 2 if flat else 3, squeeze=False)
    factor, _ = figure_unit(evidence.unit)
    for row, readout in zip(grid, readouts, strict=True):
        errors = found[readout]
        scale = ErrorScale.of(errors, evidence.unit, evidence.extent)
        for ax, view in zip(row, views, strict=False):
            image = _heat(ax, residuals.x[:, view] * factor, errors, scale)
            name_axes(ax, evidence, view)
        if flat:
            row[0].set_title(f"{readout}: workspace")
            _heat(row[1], residuals.q[:, :2] * _name_joints(row[1], model.about), errors, scale)
            row[1].set_title(f"{readout}: joint space")
        _colour_bar(figure, image, row, scale)
    return figure


def _name_joints(ax: Any, about: About) -> Array:
    """Name the axes of the first two joints; return the factors (2,) for what they show."""
    factors, names = zip(*(joint_axis(about, k) for k in (0, 1)), strict=True)
    ax.set(xlabel=names[0], ylabel=names[1])
    return np.array(factors)


def name_axes(ax: Any, evidence: Evidence, view: tuple[int, int] = (0, 1)) -> None:
    """Name the axes of positions, of which two coordinates are seen; a picture's y runs down."""
    _, unit = figure_unit(evidence.unit)
    across, up = ("xyz"[k] for k in view)
    ax.set(xlabel=f"{across} [{unit}]", ylabel=f"{up} [{unit}]", aspect="equal")
    if len(evidence.model.axes) == 3:
        ax.locator_params(nbins=4)  # three figures in a row have room for few labels
    if downwards(evidence.unit):
        ax.invert_yaxis()


def lattices(evidence: Evidence) -> Any:
    """Both lattices in their spaces, coloured by the expected error."""
    model = evidence.model
    figure = new_figure(WIDE, 3.5)
    axes = figure.subplots(1, 2)
    errors = [motor_errors(model), sensory_errors(model)]
    scale = ErrorScale.of(np.concatenate(errors), evidence.unit, evidence.extent)
    factors: list[Any] = [_name_joints(axes[0], model.about), figure_unit(evidence.unit)[0]]
    parts = {"motor": model.motor, "sensory": model.sensory}
    for ax, by, values, (what, part) in zip(axes, factors, errors, parts.items(), strict=True):
        points, edges = part.weights[:, :2] * by, drawn_edges(part)
        lines = _lattice(ax, points, edges, values, scale, linewidths=0.7)
        ax.autoscale()
        ax.set_title(f"{what} map, {'x'.join(map(str, part.lattice.shape))} nodes")
    name_axes(axes[1], evidence)
    _colour_bar(figure, lines, axes, scale, "expected error")
    return figure


def _lattice(
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


def node_maps(evidence: Evidence) -> Any:
    """U-matrix and hits of both maps, as the users of such maps expect them."""
    model = evidence.model
    figure = new_figure(WIDE, 5.6)
    grid = figure.subplots(2, 2).T
    parts = {"motor": (model.motor, evidence.u), "sensory": (model.sensory, evidence.v)}
    for axes, (name, (part, samples)) in zip(grid, parts.items(), strict=True):
        _nodes(figure, axes[0], part, u_matrix(part), f"{name} map: U-matrix", "distance [ranges]")
        _nodes(figure, axes[1], part, hits(part, samples), f"{name} map: hits", "samples")
    return figure


def u_matrix(part: Map) -> Array:
    """Mean distance (nodes,) of each node to the nodes that it is joined to, in the unit box."""
    a, b = part.edges.T
    gap = np.linalg.norm(part.scale.difference(part.units[a], part.units[b]), axis=1)
    total = np.bincount(a, gap, part.size) + np.bincount(b, gap, part.size)
    count = np.bincount(a, minlength=part.size) + np.bincount(b, minlength=part.size)
    return np.asarray(total / np.maximum(count, 1))


def hits(part: Map, u: Array) -> Array:
    """How many samples (n, d) of the unit box each node won, (nodes,)."""
    if not len(u):
        return np.full(part.size, np.nan)
    return np.bincount(part.nearest(u)[1][:, 0], minlength=part.size).astype(float)


def _nodes(figure: Any, ax: Any, part: Map, values: Array, title: str, unit: str) -> None:
    """Draw a value for each node; of a lattice of three axes the mean or the sum over the third."""
    ax.set_title(title)
    if np.isnan(values).all():
        ax.text(0.5, 0.5, "not measured", ha="center", transform=ax.transAxes)
        ax.set(xticks=[], yticks=[])
        return
    shape = part.lattice.shape
    if len(shape) == 1:  # a graph: its nodes have no place but where they stand
        image = ax.scatter(*part.units[:, :2].T, c=values, s=4, cmap="cividis", rasterized=True)
        ax.set(xlabel="first coordinate [range]", ylabel="second")
    else:
        grid = values.reshape(*shape[:2], -1)
        # hits of nodes behind each other add up, distances do not
        how = "sum" if unit == "samples" else "mean"
        most = float(np.quantile(values, 0.995)) if len(shape) == 2 else None
        shown = getattr(grid, how)(axis=-1).T
        style: dict[str, Any] = {"cmap": "cividis", "interpolation": "nearest", "aspect": "auto"}
        image = ax.imshow(shown, origin="lower", vmax=most, **style)
        ax.set(xlabel="first lattice axis [nodes]", ylabel="second [nodes]")
        if len(shape) == 3:
            ax.set_title(f"{title} ({how} over the third axis)")
    bar = figure.colorbar(image, ax=ax, shrink=0.9, pad=0.01, aspect=24)
    bar.set_label(unit)
    bar.outline.set_visible(False)


def _colour_bar(
    figure: Any, image: Any, axes: Any, scale: ErrorScale, label: str = "mean error"
) -> None:
    """Add a bar that tells what the colours mean."""
    bar = figure.colorbar(image, ax=list(np.ravel(axes)), shrink=0.9, pad=0.01, aspect=24)
    if scale.rounding:
        bar.set_ticks([])
        label = f"{label}: {scale.words()}"
    else:
        places, words = zip(*scale.ticks(5), strict=True)
        bar.set_ticks(list(places), labels=list(words))
    bar.set_label(label)
    bar.outline.set_visible(False)


def _heat(ax: Any, points: Array, errors: Array, scale: ErrorScale) -> Any:
    """Mean error in the cells of a grid over points (n, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    # a joint that never moved has a range of no width
    span = np.where(high > low, high - low, 1.0)
    (x, y), ends = points.T, np.stack([low, low + span], axis=1)[::-1]
    count, total = (np.histogram2d(y, x, _BINS, ends, weights=w)[0] for w in (None, errors))
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return ax.imshow(
        np.ma.masked_invalid(scale.share(mean)),
        origin="lower",
        extent=(low[0], low[0] + span[0], low[1], low[1] + span[1]),
        aspect="auto",
        cmap=colour_map(),
        vmin=0.0,
        vmax=1.0,
        interpolation="nearest",
    )


def over_photo(evidence: Evidence) -> Any:
    """Draw the sensory map over the model's photo; None where it has none."""
    from matplotlib.collections import LineCollection

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
    for spine in ax.spines.values():
        spine.set_visible(False)
    errors, nodes = sensory_errors(model), model.sensory.weights
    scale = ErrorScale.of(errors, evidence.unit, evidence.extent)
    edges = drawn_edges(model.sensory)
    long = np.linalg.norm(np.diff(nodes[edges], axis=1)[:, 0], axis=1)
    # an edge that is far longer than others leads across what the arm does not reach
    edges = edges[np.isfinite(errors[edges]).all(axis=1) & (long < _FAR * np.median(long))]
    lines = _lattice(ax, nodes, edges, errors, scale, linewidths=0.8, alpha=0.85)
    ax.set(xlim=(left, right), ylim=(low, high), xticks=[], yticks=[])
    around = LineCollection(list(outline(model)), colors=BORDER, linewidths=2.2, capstyle="round")
    around.set_label("what the learned range reaches")
    ax.add_collection(around, autolim=False)
    found = evidence.residuals
    arrows = None if found is None else Arrows.of(model, found.q, found.x, right - left)
    if arrows is not None:
        style = {"width": 0.0028, "headwidth": 4.5, "headlength": 5.0, "zorder": 4}
        ends = (arrows.ends - arrows.seen).T
        ax.quiver(
            *arrows.seen.T, *ends, color=ARROW, angles="xy", scale_units="xy", scale=1.0, **style
        )
        dots = {"mfc": "#ffffff", "mec": "#1d2730", "mew": 0.6, "color": ARROW}
        ax.plot(*arrows.seen.T, "o", ms=3.0, label=arrows.words, zorder=5, **dots)
    figure.legend(loc="outside lower left", ncols=1)
    _colour_bar(figure, lines, [ax], scale, "expected error")
    return figure
