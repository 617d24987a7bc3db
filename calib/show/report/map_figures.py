"""Figures of maps: lattices, U-matrix, links, and a map over a photo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...common.arrays import Array
from ...common.wording import length_in_words
from ...maps.association import Association
from ...maps.map import Map
from ..error_scale import ErrorScale, number
from ..placement import seen_by_sensor
from ..robot import Robot
from ..settings import SETTINGS
from ..study import Study
from ..workspace import drawn_edges, extent, node_errors
from .drawing import GREY, SECOND, colour_bar, draw_lattice, error_bar, panels
from .figures import long_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure


def lattices(study: Study) -> Figure | None:
    """Both lattices of a planar arm in their spaces, coloured by the expected error."""
    model = study.model
    if len(model.axes) == 3:
        return None
    errors = node_errors(model)
    scale = ErrorScale.of(
        np.concatenate(errors), model.about.unit, extent(model)
    )
    figure, axes = panels([3.2, 3.7])
    parts = _parts(model.association)
    for ax, (name, part), values in zip(
        axes, parts.items(), errors, strict=True
    ):
        points = _two_coordinates(ax, part, name)
        lines = draw_lattice(ax, points, drawn_edges(part), values, scale)
        ax.autoscale()
    error_bar(figure, lines, axes, scale, "expected error")
    return figure


def u_matrices(study: Study) -> Figure | None:
    """U-matrix of both maps of a planar arm: ridges are folds and borders."""
    if len(study.model.axes) == 3:
        return None
    return _u_matrices(_parts(study.model.association))


def figures_of_maps(maps: Map | Association) -> dict[str, Figure]:
    """Return the figures of a map, or of two with their links, by name."""
    parts = _parts(maps)
    figure, axes = panels([3.3] * len(parts))
    for ax, (name, part) in zip(axes, parts.items(), strict=True):
        x, y = _two_coordinates(ax, part, name).T
        edges = drawn_edges(part).T
        ax.plot(x[edges], y[edges], color=GREY, linewidth=0.6, rasterized=True)
        ax.plot(x, y, ".", color=SECOND, markersize=2, rasterized=True)
    drawn = {"lattices": figure, "u_matrices": _u_matrices(parts)}
    if isinstance(maps, Association):
        drawn["links"] = _links(maps)
    return drawn


def _parts(maps: Map | Association) -> dict[str, Map]:
    if isinstance(maps, Map):
        return {"map": maps}
    return {"motor map": maps.motor, "sensory map": maps.sensory}


def _two_coordinates(ax: Axes, part: Map, name: str) -> Array:
    """The first two coordinates (nodes, 2) of a map's nodes; of a line the second is 0."""
    ax.set(
        title=name, xlabel="first coordinate [range]", ylabel="second [range]"
    )
    if part.units.shape[1] == 1:
        return np.column_stack([part.units, np.zeros(part.size)])
    return part.units[:, :2]


def _links(maps: Association) -> Figure:
    """How many partners nodes have: few where the map knows one way, more at folds."""
    figure, (ax,) = panels([1.9])
    strong = maps.links > 0.1 * maps.links.max()
    counts = np.asarray(strong.sum(axis=0)).ravel()
    ax.hist(counts, bins=list(np.arange(counts.max() + 2) - 0.5), color=GREY)
    ax.set(xlabel="strong links of a sensory node", ylabel="nodes")
    return figure


def _u_matrices(parts: dict[str, Map]) -> Figure:
    """U-matrices over the lattices, or over the first two coordinates of a graph."""
    figure, axes = panels([3.1] * len(parts))
    for ax, (name, part) in zip(axes, parts.items(), strict=True):
        values = u_matrix(part)
        shape = part.lattice.shape
        image: ScalarMappable
        if (
            len(shape) == 1
        ):  # a graph: its nodes have no place but where they stand
            x, y = _two_coordinates(ax, part, name).T
            image = ax.scatter(x, y, 4, values, linewidths=0.0, rasterized=True)
        else:
            grid = values.reshape(*shape[:2], -1).mean(axis=-1).T
            top = np.quantile(grid, 0.995)
            image = ax.imshow(grid, vmax=top, interpolation="nearest")
            ax.set(
                title=name, xlabel="first lattice axis [nodes]", ylabel="second"
            )
        colour_bar(figure, image, [ax], "distance to the neighbours [range]")
    return figure


def u_matrix(part: Map) -> Array:
    """Mean distance (nodes,) of each node to the nodes that it is joined to, in the unit box."""
    first, second = part.edges.T
    apart = part.scale.difference(part.units[first], part.units[second])
    gap = np.linalg.norm(apart, axis=1)
    ends = part.edges.T.ravel()
    count = np.bincount(ends, minlength=part.size)
    return np.bincount(ends, np.tile(gap, 2), part.size) / np.maximum(count, 1)


def photo(study: Study) -> Figure | None:
    """The map, the arm and errors over the model's photo."""
    model = study.model
    if model.photo is None or len(model.axes) != 2:
        return None
    pixels = model.photo.pixels()
    box = model.photo.box
    figure, (ax,) = panels([3.5 * len(pixels) / pixels.shape[1] + 0.9])
    # a lighter photo leaves the colours to what is drawn over it
    lighter = (46 + 0.82 * pixels).astype(np.uint8)
    ax.imshow(lighter, extent=box, origin="upper", interpolation="antialiased")
    errors = node_errors(model)[1]
    nodes = model.sensory.weights
    edges = drawn_edges(model.sensory)
    scale = ErrorScale.of(errors, model.about.unit, extent(model))
    long = np.linalg.norm(np.diff(nodes[edges], axis=1)[:, 0], axis=1)
    reached = np.isfinite(errors[edges]).all(axis=1)
    edges = edges[reached & (long < SETTINGS.long_edge * np.median(long))]
    lines = draw_lattice(ax, nodes, edges, errors, scale)
    robot = Robot.of(model.about)
    if study.rows is not None:
        if robot is not None:
            bones = seen_by_sensor(model, robot.bones(study.rows.q[0]))
            if bones is not None:
                ax.plot(*bones.T, "-o", color="#f59f00", lw=3, ms=4, alpha=0.8)
        x, error, times = long_errors(study.rows)
        ends = np.stack([x, x - error], axis=1)
        ax.plot(*ends.transpose(2, 1, 0), color=SECOND, linewidth=0.9)
        ax.plot(*x.T, "o", ms=2.5, mfc="#ffffff", mec="#1d2730")
        mean = length_in_words(
            float(study.rows.distance.mean()), model.about.unit
        )
        title = (
            f"errors ({mean} on average) drawn {number(times)} times as long"
        )
        ax.set_title(title, fontsize=8)
    ax.set(xlim=box[:2], ylim=box[2:], xticks=[], yticks=[])
    error_bar(figure, lines, [ax], scale, "expected error")
    return figure
