"""Figures of an arm: how accurate, what is off, where, and why so, one function each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import for_people
from ..causes import error_curve
from ..error_scale import ErrorScale, colours, number, unit_for
from ..robot import Robot
from ..settings import SETTINGS, Z95
from ..setup import SENSOR, Thing, things_of
from ..study import StudiedRows, Study
from ..workspace import bound_field, extent
from .drawing import (
    ACCENT,
    GREY,
    INK,
    RULE,
    SECOND,
    error_bar,
    name_axes,
    named_rows,
    panels,
    plain_text,
    smooth_field,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def accuracy(study: Study) -> Figure | None:
    """Mean errors with their intervals as bars."""
    bars = study.bars
    if not bars:
        return None
    means, halves = np.array([[bar.mean, bar.half] for bar in bars]).T
    factor, unit = unit_for(
        float((means + halves).max()), study.model.about.unit
    )
    names = []
    for bar in bars:
        name = f"{bar.name}: {number(factor * bar.mean)} {unit}"
        names.append(
            f"{name} ± {number(factor * bar.half, 2)}" if bar.half else name
        )
    figure, ax = named_rows(
        names, f"mean error of the tip, 95 % interval [{unit}]"
    )
    shades = [GREY] * (len(bars) - 1) + [ACCENT]
    rows = range(len(bars))
    errors = factor * halves
    ax.barh(rows, factor * means, 0.34, color=shades, xerr=errors, ecolor=INK)
    ax.set_xlim(left=0.0)
    return figure


def causes(study: Study) -> Figure | None:
    """What is off: each cause by how far it moves the tip, with its interval."""
    largest = study.certain[: SETTINGS.causes]
    if not largest:
        return None
    factor, unit = unit_for(largest[0].effect, study.model.about.unit)
    names = [cause.words for cause in largest]
    figure, ax = named_rows(names, f"moves the tip by, rms [{unit}]")
    effects = [
        [factor * cause.effect, factor * cause.effect_half] for cause in largest
    ]
    sizes, halves = np.array(effects).T
    ax.errorbar(
        sizes, range(len(names)), xerr=halves, fmt="o", ms=5, elinewidth=2.2
    )
    ax.set_xlim(left=0.0)
    return figure


def setup(study: Study) -> Figure | None:
    """Where camera, board and sockets are, to scale with the arm, from the side and from above."""
    about = study.model.about
    things = things_of(study.model)
    robot = Robot.of(about)
    if robot is None or all(thing.name.startswith(SENSOR) for thing in things):
        return None
    q = (about.lower + about.upper) / 2
    if study.rows is not None:
        q = study.rows.q[len(study.rows.q) // 2]
    frames = np.array([frames[0] for frames in robot.poses(q).values()])
    return draw_setup(frames, things)


def draw_setup(frames: Array, things: Sequence[Thing]) -> Figure:
    """Things around links at transforms (n, 4, 4), that of the tip last."""
    bones = frames[:, :3, 3]
    placed = [thing.placed(frames[-1]) for thing in things]
    points = np.vstack([bones, *placed])
    across = int(np.argmax(np.ptp(points[:, :2], axis=0)))
    views = ((across, 2), (across, 1 - across))
    figure, axes = panels(
        [0.35 + 2.9 * _aspect(points, view) for view in views]
    )
    kinds = list(dict.fromkeys(thing.kind for thing in things))
    for ax, view in zip(axes, views, strict=True):
        ax.plot(
            *1e3 * bones[:, view].T, "o-", color=GREY, lw=3, ms=5, label="arm"
        )
        ax.plot(*1e3 * bones[0, view], "s", color=INK, ms=6, label="base")
        for number_of_kind, kind in enumerate(kinds):
            ax.plot([], [], color=f"C{number_of_kind}", label=kind)
        for thing, corners in zip(things, placed, strict=True):
            colour = f"C{kinds.index(thing.kind)}"
            lines = 1e3 * corners[np.array(thing.pairs)][:, :, view]
            ax.plot(*lines.transpose(2, 1, 0), color=colour)
        name_axes(ax, "m", view)
        ax.margins(0.08)
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=4)
    return figure


def where(study: Study) -> Figure | None:
    """The model's bound as a field over the workspace, rows in the colour of their errors."""
    model = study.model
    unit = model.about.unit
    x, bound = bound_field(model)
    if not len(x):  # the bound is a tenth of the reach or more everywhere
        return None
    rows = study.rows
    errors = bound if rows is None else np.append(bound, rows.distance)
    scale = ErrorScale.of(errors, unit, extent(model))
    factor = for_people(unit)[0]
    heights = [0.35 + 2.9 * _aspect(x, view) for view in study.views]
    heights[-1] += 0.8
    figure, axes = panels(heights)
    for ax, view in zip(axes, study.views, strict=True):
        image = smooth_field(ax, factor * x[:, view], scale.share(bound))
        if rows is not None:
            some = thinned(len(rows.x), SETTINGS.dots)
            tints = colours(scale.share(rows.distance[some])) / 255
            across, up = factor * rows.x[some][:, view].T
            ax.scatter(across, up, 9, tints, linewidths=0.5, rasterized=True)
            if rows.left_out is not None:
                ax.plot(
                    *factor * rows.left_out[:, view].T, "x", color=INK, ms=4
                )
        name_axes(ax, unit, view)
    error_bar(
        figure, image, axes, scale, "95 % bound (field), error of rows (dots)"
    )
    return figure


def coverage(study: Study) -> Figure | None:
    """Which part of each joint's range the rows covered, a strip a joint."""
    if study.rows is None:
        return None
    about = study.model.about
    u = study.model.motor.scale.to_unit(study.rows.q)
    u = u[thinned(len(u), SETTINGS.dots)]
    names = []
    for k, joint in enumerate(about.joint_names):
        factor, unit = for_people(about.units_of_joints[k])
        low = number(factor * about.lower[k])
        high = number(factor * about.upper[k])
        names.append(f"{joint}: {low} to {high} {unit}")
    figure, ax = named_rows(names, "share of the range [%]")
    shade = max(0.08, min(1.0, 60.0 / len(u)))
    ax.barh(range(len(names)), 100.0, 0.34, color="none", edgecolor=RULE)
    ax.eventplot(100.0 * u.T, linelengths=0.34, alpha=shade, rasterized=True)
    ax.set_xlim(0.0, 100.0)
    return figure


def joints(study: Study) -> Figure | None:
    """What rows say of each joint's error, with the learned error curve and its band."""
    rows = study.rows
    body = study.model.body
    about = study.model.about
    if (
        rows is None
        or body is None
        or body.structure.dof != len(about.joint_names)
    ):
        return None
    structure = body.structure
    turning = np.flatnonzero(structure.revolute).tolist()
    if not turning:
        return None
    some = thinned(len(rows.q), SETTINGS.dots)
    outputs = structure.blocks[0]
    offsets = structure.groups["offset"]
    levers = structure.linearise(rows.q[some], body.beta, offsets)[1][
        :, :outputs
    ]
    figure, axes = panels([1.25] * len(turning))
    for ax, k in zip(axes, turning, strict=True):
        lever = levers[:, :, k]
        length = np.linalg.norm(lever, axis=1)
        long = length > SETTINGS.lever * length.max()
        angle = (rows.held_out[some] * lever).sum(axis=1)[long] / length[
            long
        ] ** 2
        q = rows.q[some][long, k]
        grid = np.linspace(about.lower[k], about.upper[k], 200)
        curve, half = error_curve(body, k, grid)
        readings = 1e3 * (angle + np.interp(q, grid, curve))
        grid = np.degrees(grid)
        curve = 1e3 * curve
        half = 1e3 * half
        ax.plot(np.degrees(q), readings, ".", color=GREY, rasterized=True)
        ax.fill_between(
            grid, curve - half, curve + half, color=ACCENT, alpha=0.3
        )
        ax.plot(grid, curve, color=ACCENT)
        most = 1.2 * max(
            np.quantile(np.abs(readings), 0.97), np.abs(curve).max(), 1e-9
        )
        ax.set_ylim(-most, most)
        ax.set_title(plain_text(structure.joint_names[k]))
        ax.locator_params(nbins=4)
    axes[-1].set_xlabel("joint value [deg]")
    figure.supylabel("error of the joint [mrad]", fontsize=8.5)
    return figure


def order(study: Study, window: int = 15) -> Figure | None:
    """Held-out errors in the order of the log, where drift and steps show."""
    rows = study.rows
    if rows is None or study.model.about.simulation is not None:
        return None
    factor, unit = unit_for(
        float(np.median(rows.distance)), study.model.about.unit
    )
    errors = factor * rows.distance
    numbers = np.arange(1, len(errors) + 1)
    figure, (ax,) = panels([1.7])
    ax.plot(numbers, errors, ".", color=GREY, rasterized=True)
    if len(errors) >= 2 * window:
        windows = np.lib.stride_tricks.sliding_window_view(errors, window)
        middles = numbers[window // 2 :][: len(windows)]
        ax.plot(middles, np.median(windows, axis=1))
    ax.set(
        xlabel="row of the log",
        ylabel=f"error [{plain_text(unit)}]",
        ylim=(0, None),
    )
    return figure


def arrows(study: Study) -> Figure | None:
    """Held-out errors in space, as arrows from the predicted to the measured position."""
    if study.rows is None:
        return None
    x, error, times = long_errors(study.rows)
    unit = study.model.about.unit
    factor = for_people(unit)[0]
    views = study.views[:2]
    figure, axes = panels([0.5 + 2.9 * _aspect(x, view) for view in views])
    for ax, view in zip(axes, views, strict=True):
        start = factor * (x - error)[:, view].T
        along = factor * error[:, view].T
        drawn = ax.quiver(
            *start,
            *along,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color=SECOND,
        )
        drawn.set_rasterized(True)
        ax.update_datalim(factor * x[:, view])  # the axes hold both ends
        ax.margins(0.08)
        name_axes(ax, unit, view)
    axes[0].set_title(f"errors, drawn {number(times)} times as long")
    return figure


def long_errors(rows: StudiedRows) -> tuple[Array, Array, float]:
    """Positions (n, m) of some rows, their errors drawn out, and how many times."""
    some = thinned(len(rows.x), SETTINGS.arrows)
    x = rows.x[some]
    error = rows.held_out[some]
    length = float(np.quantile(np.linalg.norm(error, axis=1), 0.95))
    longest = SETTINGS.arrow * float(np.ptp(x, axis=0).max())
    times = float(f"{max(longest / max(length, 1e-12), 1.0):.0e}")
    return x, times * error, times


def trust(study: Study) -> Figure | None:
    """Share of rows within the p % bound against p; a bound that holds follows the diagonal."""
    from scipy.special import chdtri

    rows = study.rows
    if rows is None or study.model.about.simulation is not None:
        return None
    bound = study.model.expected_error(rows.q)
    outputs = rows.x.shape[1]
    p = np.linspace(0.02, 0.99, 60)
    radius = np.sqrt(chdtri(outputs, 1.0 - p) / chdtri(outputs, 0.05))
    ratio = rows.distance / np.maximum(bound, 1e-300)
    share = (ratio[:, None] <= radius).mean(axis=0)
    percent = 100 * p
    chance = 100 * Z95 * np.sqrt(p * (1.0 - p) / len(ratio))
    figure, (ax,) = panels([2.4])
    ax.fill_between(
        percent, percent - chance, percent + chance, color=GREY, alpha=0.3
    )
    ax.plot(percent, percent, color=GREY)
    ax.plot(percent, 100 * share, color=ACCENT)
    ax.set(xlim=(0, 100), xlabel="bound that should hold [%]")
    ax.set(ylim=(0, 100), ylabel="rows within [%]")
    return figure


def sockets(study: Study) -> Figure | None:
    """Distances of tips from their socket, as delivered and held out, by socket."""
    rows = study.rows
    if rows is None or rows.verdict is not None:
        return None
    places, socket_of_row = np.unique(rows.x, axis=0, return_inverse=True)
    if 3 * len(places) > len(rows.x):  # no touches
        return None
    names = [f"socket {k + 1}" for k in range(len(places))]
    figure, ax = named_rows(names, "distance from the socket [mm]")
    errors = {"held out": rows.held_out}
    if study.delivered is not None:
        errors = {"as delivered": study.delivered, **errors}
    for k, (name, error) in enumerate(errors.items()):
        row = socket_of_row.ravel() + 0.2 * k - 0.1
        ax.plot(
            1e3 * np.linalg.norm(error, axis=1), row, ".", alpha=0.6, label=name
        )
    ax.set_xlim(left=0.0)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _aspect(x: Array, view: Sequence[int], most: float = 1.3) -> float:
    """Height over width of positions (n, m) in a view."""
    width, height = np.maximum(np.ptp(x[:, view], axis=0), 1e-9)
    return min(float(height / width), most)
