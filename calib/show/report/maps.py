"""Figures of maps: lattices, U-matrix, links, and a map over a photo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import length_in_words
from ...maps.association import Association
from ...maps.map import Map
from ..error_scale import ErrorScale, number
from ..settings import AMOUNTS, LIMITS
from ..workspace import drawn_edges, extent, node_errors, outline
from .drawing import GREY, SECOND, colour_bar, draw_lattice, error_bar, panels
from .figures import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BORDER = "#12b886"
_CELLS: dict[str, Any] = {
    "origin": "lower",
    "aspect": "auto",
    "interpolation": "nearest",
}


def lattices(study: Study) -> Figure | None:
    """Both lattices of a planar arm in their spaces, coloured by the expected error."""
    model = study.model
    if len(model.axes) == 3:
        return None
    figure, axes = panels(2, 6.9)
    errors = node_errors(model)
    scale = ErrorScale.of(np.concatenate(errors), model.about.unit, extent(model))
    for ax, part, values in zip(
        axes, (model.motor, model.sensory), errors, strict=True
    ):
        edges = drawn_edges(part)
        lines = draw_lattice(
            ax, part.units[:, :2], edges, values, scale, linewidths=0.7
        )
        ax.autoscale()
    axes[0].set(
        title="motor map", xlabel="first joint [range]", ylabel="second joint [range]"
    )
    axes[1].set(title="sensory map", xlabel="x [range]", ylabel="y [range]")
    error_bar(figure, lines, axes, scale, "expected error")
    return figure


def u_matrices(study: Study) -> Figure | None:
    """U-matrix of both maps of a planar arm: ridges are folds and borders."""
    if len(study.model.axes) == 3:
        return None
    return _u_matrices(
        {"motor map": study.model.motor, "sensory map": study.model.sensory}
    )


def figures_of_maps(maps: Map | Association) -> dict[str, Figure]:
    """Return the figures of a map, or of two with their links, by name."""
    parts = (
        {"map": maps}
        if isinstance(maps, Map)
        else {
            "motor map": maps.motor,
            "sensory map": maps.sensory,
        }
    )
    figure, axes = panels(len(parts), 0.3 + 3.2 * len(parts))
    for ax, (name, part) in zip(axes, parts.items(), strict=True):
        _draw_nodes(ax, part)
        ax.set(title=name, xlabel="first coordinate [range]", ylabel="second [range]")
    drawn = {"lattices": figure, "u_matrices": _u_matrices(parts)}
    if isinstance(maps, Association):
        drawn["links"] = _links(maps)
    return drawn


def _draw_nodes(ax: Axes, part: Map) -> None:
    """Draw the nodes of a map, joined to their neighbours; of three axes the middle sheet."""
    from matplotlib.collections import LineCollection

    edges = drawn_edges(part)
    sheet = _middle_sheet(part)
    edges = edges[sheet[edges].all(axis=1)]
    points = part.units[:, : min(part.units.shape[1], 2)]
    if points.shape[1] == 1:
        points = np.column_stack([points[:, 0], np.zeros(len(points))])
    ax.add_collection(LineCollection(list(points[edges]), colors=GREY, linewidths=0.6))
    ax.plot(*points[sheet].T, ".", color=SECOND, markersize=2, rasterized=True)


def _middle_sheet(part: Map) -> Array:
    """Which nodes (nodes,) are drawn: of a lattice with three axes those of its middle sheet."""
    shape = part.lattice.shape
    if len(shape) < 3:
        return np.ones(part.size, dtype=bool)
    third = np.indices(shape)[2].ravel()
    return np.asarray(third == shape[2] // 2)


def _links(maps: Association) -> Figure:
    """How many partners nodes have: few where the map knows one way, more at folds."""
    figure, (ax,) = panels(1, 1.9)
    strong = maps.links > 0.1 * maps.links.max()
    counts = np.asarray(strong.sum(axis=0)).ravel()
    ax.hist(counts, bins=list(np.arange(counts.max() + 2) - 0.5), color=GREY)
    ax.set(xlabel="strong links of a sensory node", ylabel="nodes")
    return figure


def _u_matrices(parts: dict[str, Map]) -> Figure:
    """U-matrices over the lattices, or over the first two coordinates of a graph."""
    figure, axes = panels(len(parts), 0.3 + 3.0 * len(parts))
    for ax, (name, part) in zip(axes, parts.items(), strict=True):
        values = u_matrix(part)
        shape = part.lattice.shape
        if len(shape) == 1:  # a graph: its nodes have no place but where they stand
            image: Any = ax.scatter(
                part.units[:, 0],
                part.units[:, 1],
                c=values,
                s=4,
                cmap="cividis",
                rasterized=True,
            )
            ax.set(xlabel="first coordinate [range]", ylabel="second [range]")
        else:
            grid = values.reshape(*shape[:2], -1).mean(axis=-1).T
            image = ax.imshow(
                grid, vmax=np.quantile(grid, 0.995), cmap="cividis", **_CELLS
            )
            ax.set(xlabel="first lattice axis [nodes]", ylabel="second [nodes]")
        ax.set_title(name)
        colour_bar(figure, image, [ax], "distance to the neighbours [range]")
    return figure


def u_matrix(part: Map) -> Array:
    """Mean distance (nodes,) of each node to the nodes that it is joined to, in the unit box."""
    first, second = part.edges.T
    gap = np.linalg.norm(
        part.scale.difference(part.units[first], part.units[second]), axis=1
    )
    ends = part.edges.T.ravel()
    count = np.bincount(ends, minlength=part.size)
    return np.bincount(ends, np.tile(gap, 2), part.size) / np.maximum(count, 1)


def photo(study: Study) -> Figure | None:
    """The sensory map over the model's photo, with arrows from seen tips to predicted ones."""
    from matplotlib.collections import LineCollection

    model = study.model
    if model.photo is None or len(model.axes) != 2:
        return None
    pixels = model.photo.pixels()
    left, right, low, high = model.photo.box
    figure, (ax,) = panels(1, 3.5 * len(pixels) / pixels.shape[1] + 0.9)
    # a lighter photo leaves the colours to what is drawn over it
    ax.imshow(
        pixels, extent=model.photo.box, interpolation="antialiased", aspect="equal"
    )
    ax.imshow(
        [[1.0]],
        extent=model.photo.box,
        cmap="gray",
        vmin=0,
        vmax=1,
        alpha=0.18,
        aspect="equal",
    )
    errors = node_errors(model)[1]
    nodes = model.sensory.weights
    edges = drawn_edges(model.sensory)
    scale = ErrorScale.of(errors, model.about.unit, extent(model))
    long = np.linalg.norm(np.diff(nodes[edges], axis=1)[:, 0], axis=1)
    edges = edges[
        np.isfinite(errors[edges]).all(axis=1)
        & (long < LIMITS.long_edge * np.median(long))
    ]
    lines = draw_lattice(ax, nodes, edges, errors, scale, linewidths=0.8, alpha=0.85)
    ax.set(xlim=(left, right), ylim=(low, high), xticks=[], yticks=[])
    border = LineCollection(list(outline(model)), colors=_BORDER, linewidths=2.2)
    ax.add_collection(border, autolim=False)
    if study.rows is not None:
        some = thinned(len(study.rows.q), AMOUNTS.arrows)
        x = study.rows.x[some]
        error = study.rows.held_out[some]
        length = max(float(np.quantile(np.linalg.norm(error, axis=1), 0.95)), 1e-9)
        times = float(f"{max(LIMITS.arrow * (right - left) / length, 1.0):.0e}")
        tips = x - times * error
        ax.plot(
            *np.stack([x, tips], axis=1).transpose(2, 1, 0), color=SECOND, linewidth=0.9
        )
        ax.plot(*x.T, "o", ms=2.5, mfc="#ffffff", mec="#1d2730")
        mean = length_in_words(float(study.rows.distance.mean()), model.about.unit)
        ax.set_title(
            f"errors ({mean} on average) drawn {number(times)} times as long",
            fontsize=8,
        )
    error_bar(figure, lines, [ax], scale, "expected error")
    return figure
