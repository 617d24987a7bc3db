"""Figures of maps: lattices, U-matrix, links, and a map over a photo."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...common.arrays import Array
from ...maps.association import Association
from ...maps.map import Map
from ..error_scale import ErrorScale
from ..study import Study
from ..workspace import drawn_edges, extent, node_errors
from .drawing import GREY, INK, colour_bar, draw_lattice, panels


def lattices(study: Study) -> Figure | None:
    """Both lattices of a planar arm in their spaces, coloured by the expected error."""
    model = study.model
    if study.suffix or len(model.axes) == 3:
        return None
    errors = node_errors(model)
    unit = model.about.unit
    scale = ErrorScale.of(np.concatenate(errors), unit, extent(model))
    shares = [scale.share(som) for som in errors]
    return _lattices(model.association, shares, "expected error", scale)


def u_matrices(study: Study) -> Figure | None:
    """U-matrix of both maps of a planar arm: ridges are folds and borders."""
    if study.suffix or len(study.model.axes) == 3:
        return None
    return _u_matrices(study.model.association)


def figures_of_maps(maps: Map | Association) -> dict[str, Figure]:
    """Return the figures of a map, or of two with their links, by name."""
    gaps = [som.spacings for som in _parts(maps).values()]
    shares = [gap / gap.max() for gap in gaps]
    drawn = {
        "lattices": _lattices(
            maps, shares, "distance to the neighbours [largest]"
        ),
        "u_matrices": _u_matrices(maps),
    }
    if isinstance(maps, Association):
        drawn["links"] = _links(maps)
    return drawn


def _parts(maps: Map | Association) -> dict[str, Map]:
    if isinstance(maps, Map):
        return {"map": maps}
    return {"motor map": maps.motor, "sensory map": maps.sensory}


def _lattices(
    maps: Map | Association,
    shares: list[Array],
    label: str,
    scale: ErrorScale | None = None,
) -> Figure:
    """Lattices in the colour of their nodes' shares (nodes,) of a scale."""
    figure, axes = panels([3.3] * len(shares))
    parts = _parts(maps).items()
    for ax, (name, som), share in zip(axes, parts, shares, strict=True):
        points = _two_coordinates(ax, som, name)
        lines = draw_lattice(ax, points, drawn_edges(som), share, 1.0)
    colour_bar(figure, lines, axes, label, scale)
    return figure


def _two_coordinates(ax: Axes, som: Map, name: str) -> Array:
    """The first two coordinates (nodes, 2) of a map's nodes; of a line the second is 0."""
    ax.set(title=name, xlabel="first coordinate [range]")
    ax.set_ylabel("second [range]")
    return np.column_stack([som.units, np.zeros(som.size)])[:, :2]


def _links(maps: Association) -> Figure:
    """How many partners nodes have: few where the map knows one way, more at folds."""
    figure, (ax,) = panels([1.9])
    strong = maps.links > 0.1 * maps.links.max()
    counts = np.asarray(strong.sum(axis=0)).ravel()
    ax.hist(counts, bins=list(np.arange(counts.max() + 2) - 0.5), color=GREY)
    ax.set(xlabel="strong links of a sensory node", ylabel="nodes")
    return figure


def _u_matrices(maps: Map | Association) -> Figure:
    """U-matrices over the lattices, or over the first two coordinates of a graph."""
    parts = _parts(maps)
    figure, axes = panels([3.1] * len(parts))
    for ax, (name, som) in zip(axes, parts.items(), strict=True):
        shape = som.lattice.shape
        if len(shape) == 1:
            # a graph: its nodes have no place but their own
            x, y = _two_coordinates(ax, som, name).T
            shown = ax.scatter(x, y, 4, som.spacings, linewidths=0.0)
            colour_bar(
                figure, shown, [ax], "distance to the neighbours [range]"
            )
            continue
        grid = som.spacings.reshape(*shape[:2], -1).mean(axis=-1).T
        image = ax.imshow(grid, interpolation="nearest")
        axis = "first lattice axis [nodes]"
        ax.set(title=name, xlabel=axis, ylabel="second")
        colour_bar(figure, image, [ax], "distance to the neighbours [range]")
    return figure


def photo(study: Study) -> Figure | None:
    """The map and the rows over the model's photo."""
    model = study.model
    if model.photo is None or len(model.axes) != 2:
        return None
    pixels = model.photo.pixels()
    box = model.photo.box
    figure, (ax,) = panels([3.5 * len(pixels) / pixels.shape[1] + 0.9])
    # a lighter photo leaves the colours to what is drawn over it
    lighter = (46 + 0.82 * pixels).astype(np.uint8)
    smooth = "antialiased"
    ax.imshow(lighter, extent=box, origin="upper", interpolation=smooth)
    errors = node_errors(model)[1]
    edges = drawn_edges(model.sensory)
    reached = np.isfinite(errors[edges]).all(axis=1)
    scale = ErrorScale.of(errors, model.about.unit, extent(model))
    share = scale.share(errors)
    nodes = model.sensory.weights
    lines = draw_lattice(ax, nodes, edges[reached], share, 1.0)
    if study.rows is not None:
        x, y = study.rows.x.T
        ax.plot(x, y, "o", ms=2.5, mfc="#ffffff", mec=INK)
    ax.set(xlim=box[:2], ylim=box[2:], xticks=[], yticks=[])
    colour_bar(figure, lines, [ax], "expected error", scale)
    return figure
