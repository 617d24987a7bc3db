"""The paper's figures: lattices with error heat, before and after a change, and curves.

Matplotlib is imported when a figure is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..common.atomic import atomic_write
from .adaptation import Episode
from .setting import NETWORKS, Setting
from .trial import SAME_SCHEDULE, activity_errors, association

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..maps.association import Association
    from ..maps.map import Map


def lattice_figure(setting: Setting, path: Path) -> None:
    """Motor and sensory lattice of SOM and VDSOM, coloured by the error of each winner.

    Both at the same schedule, the one at which the paper's ratio appears.
    """
    figure = _figure(9.6, 8.2)
    axes = figure.subplots(2, 2)
    seed = setting.seeds[0]
    samples = setting.babble(seed)
    simulation = samples.simulation
    assert simulation is not None  # noqa: S101
    q = simulation.draw(
        60_000 if not setting.quick else 5_000, np.random.default_rng(seed + 5)
    )
    x = simulation.exact(q)
    drawn: list[tuple[str, Association, Array, Array]] = []
    for network in NETWORKS:
        setting.report(0.5 * len(drawn), f"lattices of the {network}")
        pair = association(samples, network, SAME_SCHEDULE, setting.side, seed)
        errors = activity_errors(pair, q, x)
        forward = (
            np.linalg.norm(errors[:, :2] * pair.sensory.scale.span, axis=1)
            * 1e3
        )
        inverse = np.degrees(
            np.linalg.norm(errors[:, 2:] * pair.motor.scale.span, axis=1)
        )
        drawn.append((network, pair, forward, inverse))
    top = [float(np.quantile(errors, 0.99)) for errors in drawn[0][2:]]
    for row, (network, pair, forward, inverse) in zip(axes, drawn, strict=True):
        parts = (
            (
                pair.motor,
                q,
                forward,
                np.degrees(1.0),
                "deg",
                "forward error [mm]",
                top[0],
            ),
            (
                pair.sensory,
                x,
                inverse,
                1e3,
                "mm",
                "inverse error [deg]",
                top[1],
            ),
        )
        for ax, (net, points, error, factor, unit, label, most) in zip(
            row, parts, strict=True
        ):
            which, names = (
                ("sensory", "xy") if unit == "mm" else ("motor", setting.joints)
            )
            _draw_lattice(
                ax, net, _node_means(net, points, error), factor, most, label
            )
            ax.set(xlabel=f"{names[0]} [{unit}]", ylabel=f"{names[1]} [{unit}]")
            ax.set_title(f"{network.upper()}, {which} map")
            ax.set_aspect("equal" if unit == "mm" else "auto")
    figure.suptitle(
        f"{setting.side}x{setting.side} nodes, {setting.samples:,} samples, {SAME_SCHEDULE}, "
        "readout activity",
        fontsize=9,
    )
    _save(figure, path)


def changed_figure(episodes: Mapping[str, Episode], path: Path) -> None:
    """Sensory map before a change, with its distortion there, and after it has followed."""
    figure = _figure(12.4, 3.0 * len(episodes))
    axes = np.atleast_2d(
        figure.subplots(len(episodes), 3, sharex="row", sharey="row")
    )
    for row, (name, e) in zip(axes, episodes.items(), strict=True):
        span = float(e.before.sensory.scale.span.mean()) * 1e3
        sensory = (
            e.before.sensory,
            e.after.sensory,
        )  # in the unit box, then in mm
        old, new = (
            n.nearest(n.scale.to_unit(e.x))[0][:, 0] * span for n in sensory
        )
        most = float(np.quantile(old, 0.98))
        error = (
            np.linalg.norm(e.after.forward(e.q, "activity") - e.x, axis=1) * 1e3
        )
        seen = np.isfinite(error)
        heat = _node_means(e.after.sensory, e.x[seen], error[seen])
        panels = (
            (
                e.before.sensory,
                _node_means(e.before.sensory, e.x, old),
                most,
                "distortion [mm]",
            ),
            (
                e.after.sensory,
                _node_means(e.after.sensory, e.x, new),
                most,
                "distortion [mm]",
            ),
            (
                e.after.sensory,
                heat,
                float(np.nanquantile(heat, 0.99)),
                "forward error [mm]",
            ),
        )
        titles = (
            f"link {name}, before adapting",
            "after adapting",
            "error after adapting",
        )
        for ax, (net, values, top, label), title in zip(
            row, panels, titles, strict=True
        ):
            ax.plot(
                *(e.x[::20] * 1e3).T,
                ".",
                color="#b8c2cb",
                markersize=1.2,
                zorder=0,
            )
            _draw_lattice(ax, net, values, 1e3, top, label)
            ax.set(
                title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal"
            )
    _save(figure, path)


def curves_figure(episodes: Mapping[str, Episode], path: Path) -> None:
    """Distortion, error, radius and learning rate along the stream after a change."""
    figure = _figure(9.6, 6.2)
    axes = figure.subplots(2, 2, sharex=True)
    colours = ("#1c7ed6", "#e8590c")
    for colour, (name, e) in zip(colours, episodes.items(), strict=True):
        n = np.array([s.samples for s in e.steps])
        series = (
            (axes[0, 0], [s.zeta_sensory for s in e.steps], "-", name),
            (
                axes[0, 0],
                [s.threshold for s in e.steps],
                ":",
                f"{name}: threshold",
            ),
            (axes[0, 1], [1e3 * s.error for s in e.steps], "-", name),
            (axes[1, 0], [s.sigma for s in e.steps], "-", name),
            (axes[1, 1], [s.eta for s in e.steps], "-", f"{name}: eta"),
            (axes[1, 1], [s.beta for s in e.steps], "--", f"{name}: beta"),
        )
        for ax, values, dash, label in series:
            ax.plot(n, values, dash, color=colour, label=label, linewidth=1.4)
        axes[0, 0].axhline(e.distortion["trained"], color=colour, linewidth=0.6)
    labels = (
        "distortion zeta, eq. 9 [unit box]",
        "error before learning a sample [mm]",
        "sigma, eq. 10 [nodes]",
        "eta and beta, eq. 12",
    )
    for ax, label in zip(axes.ravel(), labels, strict=True):
        ax.set(ylabel=label)
        ax.grid(alpha=0.3)
        ax.legend(frameon=False, fontsize=8)
    axes[0, 0].set_yscale("log")
    axes[0, 1].set_yscale("log")
    axes[0, 1].set_yticks(
        [1, 2, 5, 10, 20, 50], labels=["1", "2", "5", "10", "20", "50"]
    )
    axes[0, 1].minorticks_off()
    for ax in axes[1]:
        ax.set_xlabel("samples after the change")
        ax.locator_params(axis="x", nbins=5)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    atomic_write(path, partial(figure.savefig, format="png", dpi=160))


def _node_means(net: Map, points: Array, values: Array) -> Array:
    """Mean value of the points that each node wins, (nodes,); NaN where it wins none."""
    winner = net.winners(points)
    count = np.bincount(winner, minlength=net.size)
    total = np.bincount(winner, values, net.size)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _draw_lattice(
    ax: Axes, net: Map, heat: Array, factor: float, most: float, label: str
) -> None:
    """Draw the edges of a map, coloured by the mean of their nodes' values, up to `most`."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    a, b = net.edges.T
    both = np.stack([heat[a], heat[b]])
    points = net.weights[:, :2] * factor
    with np.errstate(
        invalid="ignore"
    ):  # NaN between nodes without a value: grey
        colour = np.nansum(both, axis=0) / np.isfinite(both).sum(axis=0)
    grey = colormaps["plasma"].with_extremes(bad="#d5dbe0")
    segments = list(np.stack([points[a], points[b]], axis=1))
    lines = LineCollection(segments, cmap=grey, linewidths=0.7)
    lines.set_array(np.ma.masked_invalid(colour))
    lines.set_clim(0.0, most)
    ax.add_collection(lines)
    ax.autoscale()
    bar = ax.figure.colorbar(
        lines, ax=ax, shrink=0.7, aspect=18, pad=0.02, extend="max"
    )
    bar.set_label(label)
    bar.outline.set_visible(False)


def _figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], apart from any window system."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
