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
from ..common.rows import group_means, row_lengths
from ..show.report.drawing import ACCENT, SECOND, draw_lattice
from .adaptation import FollowedChange
from .setting import NETWORKS, Setting
from .trial import SAME_SCHEDULE, activity_errors, association

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..maps.map import Map


def lattice_figure(setting: Setting, path: Path) -> None:
    """Motor and sensory lattice of SOM and VDSOM, coloured by the error of each winner.

    Both at the same schedule, the one at which the paper's ratio appears.
    """
    figure = _figure(9.6, 8.2)
    seed = setting.seeds[0]
    samples = setting.babble(seed)
    simulation = samples.simulation
    assert simulation is not None  # noqa: S101
    count = 5_000 if setting.quick else 60_000
    q = simulation.draw(count, np.random.default_rng(seed + 5))
    x = simulation.exact(q)
    tops: list[float] = []
    for row, network in enumerate(NETWORKS):
        setting.report(0.5 * row, f"lattices of the {network}")
        pair = association(samples, network, SAME_SCHEDULE, setting.side, seed)
        motor = pair.motor
        sensory = pair.sensory
        errors = activity_errors(pair, q, x)
        reached = row_lengths(errors[:, :2] * sensory.scale.span)
        turned = row_lengths(errors[:, 2:] * motor.scale.span)
        forward = 1e3 * reached
        inverse = np.degrees(turned)
        if not tops:  # the colours of the first network are those of both
            tops = [np.quantile(error, 0.99) for error in (forward, inverse)]
        ax = figure.add_subplot(2, 2, 2 * row + 1)
        heat = _node_means(motor, q, forward)
        _draw_map(ax, motor, heat, 180 / np.pi, tops[0], "forward error [mm]")
        title = f"{network.upper()}, motor map"
        ax.set(title=title, xlabel="shoulder [deg]", ylabel="elbow [deg]")
        ax = figure.add_subplot(2, 2, 2 * row + 2, aspect="equal")
        heat = _node_means(sensory, x, inverse)
        _draw_map(ax, sensory, heat, 1e3, tops[1], "inverse error [deg]")
        title = f"{network.upper()}, sensory map"
        ax.set(title=title, xlabel="x [mm]", ylabel="y [mm]")
    figure.suptitle(
        f"{setting.side}x{setting.side} nodes, {setting.samples:,} samples, {SAME_SCHEDULE}, "
        "readout activity",
        fontsize=9,
    )
    _save(figure, path)


def change_figure(followed: Mapping[str, FollowedChange], path: Path) -> None:
    """Sensory map before a change, with its distortion there, and after it has followed."""
    figure = _figure(12.4, 3.0 * len(followed))
    rows = figure.subplots(
        len(followed), 3, sharex="row", sharey="row", squeeze=False
    )
    for row, (name, change) in zip(rows, followed.items(), strict=True):
        before = change.before.sensory
        after = change.after.sensory
        reached = change.after.forward(change.q, "activity")
        error = 1e3 * row_lengths(reached - change.x)
        answered = np.isfinite(error)
        heat = _node_means(after, change.x[answered], error[answered])
        old = _distortion(before, change.x)
        top = float(np.nanquantile(old, 0.98))
        most = float(np.nanquantile(heat, 0.99))
        panels = {
            f"link {name}, before adapting": (before, old, top),
            "after adapting": (after, _distortion(after, change.x), top),
            "error after adapting": (after, heat, most),
        }
        labels = ("distortion [mm]", "distortion [mm]", "forward error [mm]")
        for ax, title, label in zip(row, panels, labels, strict=True):
            net, values, highest = panels[title]
            across, up = 1e3 * change.x[::20].T
            ax.plot(across, up, ".", color="#b8c2cb", markersize=1.2, zorder=0)
            _draw_map(ax, net, values, 1e3, highest, label)
            ax.set(
                title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal"
            )
    _save(figure, path)


def curves_figure(followed: Mapping[str, FollowedChange], path: Path) -> None:
    """Distortion, error, radius and learning rate along the stream after a change."""
    figure = _figure(9.6, 6.2)
    axes = figure.subplots(2, 2, sharex=True)
    (zeta, error), (sigma, rates) = axes
    for colour, (name, change) in zip(
        (ACCENT, SECOND), followed.items(), strict=True
    ):
        steps = change.steps
        samples = [step.samples for step in steps]
        series = (
            (zeta, [step.zeta_sensory for step in steps], "-", ""),
            (zeta, [step.threshold for step in steps], ":", ": threshold"),
            (error, [1e3 * step.error for step in steps], "-", ""),
            (sigma, [step.sigma for step in steps], "-", ""),
            (rates, [step.eta for step in steps], "-", ": eta"),
            (rates, [step.beta for step in steps], "--", ": beta"),
        )
        for ax, values, dash, label in series:
            ax.plot(samples, values, dash, color=colour, label=name + label)
        zeta.axhline(change.distortion["trained"], color=colour, linewidth=0.6)
    zeta.set(ylabel="distortion zeta, eq. 9 [unit box]", yscale="log")
    error.set(ylabel="error before learning a sample [mm]", yscale="log")
    after = "samples after the change"
    sigma.set(ylabel="sigma, eq. 10 [nodes]", xlabel=after)
    rates.set(ylabel="eta and beta, eq. 12", xlabel=after)
    for ax in axes.flat:
        ax.grid(alpha=0.3)
        ax.legend(frameon=False, fontsize=8)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    atomic_write(path, partial(figure.savefig, format="png", dpi=160))


def _distortion(net: Map, x: Array) -> Array:
    """Mean distance [mm] of the positions (n, 2) that each node wins, (nodes,)."""
    distance = net.nearest(net.scale.to_unit(x))[0][:, 0]
    return _node_means(net, x, 1e3 * net.scale.span.mean() * distance)


def _node_means(net: Map, points: Array, values: Array) -> Array:
    """Mean value of the points that each node wins, (nodes,); NaN where it wins none."""
    return group_means(net.winners(points), values, net.size)


def _draw_map(
    ax: Axes, net: Map, heat: Array, factor: float, top: float, label: str
) -> None:
    """Draw the edges of a map, coloured by the mean of their nodes' values, up to `top`."""
    points = factor * net.weights[:, :2]
    lines = draw_lattice(ax, points, net.edges, heat, top)
    bar = ax.figure.colorbar(lines, ax=ax, shrink=0.7, extend="max")
    bar.set_label(label)


def _figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], apart from any window system."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
