"""Figures of an arm: how accurate, what is off, where, and why so, one function each."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...common.arrays import Array
from ...common.rows import row_lengths, spread_rows
from ...common.wording import (
    ROUNDED_AWAY,
    by_name,
    for_people,
    number,
    printable,
    quantity,
    unit_for,
)
from ..deviations import error_curve
from ..error_scale import ErrorScale
from ..robot import Robot
from ..settings import SETTINGS
from ..setup import SENSOR, Thing, things_of
from ..study import Study
from ..workspace import bound_field, extent
from .drawing import (
    ACCENT,
    GREY,
    INK,
    RULE,
    SECOND,
    colour_bar,
    colour_map,
    named_rows,
    panels,
    projections,
)


def accuracy(study: Study) -> Figure | None:
    """Mean errors with their intervals."""
    bars = study.bars
    if not bars:
        return None
    unit = study.model.about.unit
    names = [
        f"{bar.name}: {quantity(bar.mean, unit, bar.half)}" for bar in bars
    ]
    sizes = [(bar.mean, bar.half) for bar in bars]
    return _intervals(
        names, sizes, unit, "mean error of the tip, 95 % interval"
    )


def causes(study: Study) -> Figure | None:
    """What is off: each deviation by how far it moves the tip, with its interval."""
    largest = study.certain[: SETTINGS.deviations]
    if study.suffix or not largest:  # shown with the first sensor
        return None
    names = [deviation.words for deviation in largest]
    sizes = []
    for deviation in largest:
        relative = deviation.half / abs(deviation.value)
        sizes.append((deviation.effect, deviation.effect * relative))
    unit = study.model.about.unit
    return _intervals(names, sizes, unit, "moves the tip by, rms")


def _intervals(
    names: Sequence[str],
    sizes: Sequence[tuple[float, float]],
    unit: str,
    label: str,
) -> Figure:
    """Sizes with half of their intervals [unit] as bars in named rows."""
    values, halves = np.array(sizes).T
    factor, shown = unit_for(float((values + halves).max()), unit)
    figure, ax = named_rows(names, printable(f"{label} [{shown}]"))
    rows = range(len(names))
    ax.barh(rows, factor * values, 0.34, color=ACCENT, alpha=0.45)
    ax.errorbar(factor * values, rows, xerr=factor * halves, fmt="o", color=INK)
    ax.set_xlim(0.0, max(ax.get_xlim()[1], factor * ROUNDED_AWAY))
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
    poses = robot.poses(q[None]).values()
    return draw_setup(np.concatenate(list(poses)), things)


def draw_setup(frames: Array, things: Sequence[Thing]) -> Figure:
    """Things around links at transforms (n, 4, 4), that of the tip last."""
    bones = frames[:, :3, 3]
    placed = [thing.at_tip(frames[-1]) for thing in things]
    points = np.vstack([bones, *placed])
    across = int(np.argmax(np.ptp(points[:, :2], axis=0)))
    views = ((across, 2), (across, 1 - across))
    figure, axes = projections(points, views, "m")
    kinds = list(dict.fromkeys(thing.kind for thing in things))
    for ax, view in zip(axes, views, strict=True):
        arm = 1e3 * bones[:, view].T
        ax.plot(*arm, "o-", color=GREY, lw=3, ms=5, label="arm")
        for thing, corners in zip(things, placed, strict=True):
            lines = 1e3 * corners[np.array(thing.pairs)][:, :, view]
            drawn = ax.plot(
                *lines.transpose(2, 1, 0), color=f"C{kinds.index(thing.kind)}"
            )
            drawn[0].set_label(thing.kind)
    handles, names = axes[0].get_legend_handles_labels()
    of_kinds = by_name(names, handles)
    figure.legend(
        of_kinds.values(), of_kinds, loc="outside lower center", ncols=4
    )
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
    figure, axes = projections(x, study.views, unit, below=0.8)
    colours = colour_map()
    for ax, view in zip(axes, study.views, strict=True):
        across, up = factor * x[:, view].T
        field = ax.hexbin(
            across,
            up,
            scale.share(bound),
            gridsize=30,
            cmap=colours,
            vmin=0.0,
            vmax=1.0,
            linewidths=0.1,
            rasterized=True,
        )
        if rows is None:
            continue
        spread = spread_rows(len(rows.x), SETTINGS.dots)
        across, up = factor * rows.x[spread][:, view].T
        tints = colours(scale.share(rows.distance[spread]))
        ax.scatter(across, up, 9, tints, linewidths=0.5, rasterized=True)
        if rows.left_out is not None:
            ax.plot(*factor * rows.left_out[:, view].T, "x", color=INK, ms=4)
    label = "95 % bound (field), error of rows (dots)"
    colour_bar(figure, field, axes, label, scale)
    return figure


def coverage(study: Study) -> Figure | None:
    """Which part of each joint's range the rows covered, a strip a joint."""
    if study.rows is None:
        return None
    about = study.model.about
    u = study.model.motor.scale.to_unit(study.rows.q)
    u = u[spread_rows(len(u), SETTINGS.dots)]
    units = about.units_of_joints
    ranges = zip(
        about.joint_names, about.lower, about.upper, units, strict=True
    )
    names = [
        f"{joint}: {quantity(lower, unit)} to {quantity(upper, unit)}"
        for joint, lower, upper, unit in ranges
    ]
    figure, ax = named_rows(names, "share of the range [%]")
    shade = max(0.08, min(1.0, 60.0 / len(u)))
    ax.barh(range(len(names)), 100.0, 0.34, color="none", edgecolor=RULE)
    ax.eventplot(100.0 * u.T, linelengths=0.34, alpha=shade, rasterized=True)
    ax.set_xlim(0.0, 100.0)
    return figure


def joints(study: Study) -> Figure | None:
    """Each joint's error by the rows, with the learned error curve and its band."""
    rows = study.rows
    body = study.model.body
    about = study.model.about
    if rows is None or body is None or study.exact:
        return None
    structure = body.structure
    if structure.dof != len(about.joint_names):
        return None
    spread = spread_rows(len(rows.q), SETTINGS.dots)
    q = rows.q[spread]
    offsets = structure.groups["offset"]
    slope = structure.linearise(q, body.beta, offsets)[1]
    levers = row_lengths(slope[:, : structure.blocks[0]])
    # a tip on a joint's axis shows nothing of that joint: its errors were given as 40 rad
    moves = levers.max(axis=0) > SETTINGS.hardly * levers.max()
    turning = np.flatnonzero(np.asarray(structure.revolute) & moves).tolist()
    if not turning:
        return None
    figure, axes = panels([1.25] * len(turning))
    for ax, k in zip(axes, turning, strict=True):
        grid = np.linspace(about.lower[k], about.upper[k], 200)
        curve, half = error_curve(body, k, grid)

        # what rows say that hold the joint by a long lever: what the model leaves, and the curve
        lever = slope[:, : structure.blocks[0], k]
        length = levers[:, k]
        long = length > SETTINGS.lever * length.max()
        along = (rows.held_out[spread] * lever).sum(axis=1)[long]
        learned = np.interp(q[long, k], grid, curve)
        readings = 1e3 * (along / length[long] ** 2 + learned)
        degrees = np.degrees(q[long, k])
        ax.plot(degrees, readings, ".", color=GREY, rasterized=True)

        # the learned curve and its band
        values = np.degrees(grid)
        band = 1e3 * np.array([curve - half, curve + half])
        ax.fill_between(values, *band, color=ACCENT, alpha=0.3)
        ax.plot(values, 1e3 * curve, color=ACCENT)
        ax.set_title(printable(structure.joint_names[k]))
        ax.locator_params(nbins=4)
    axes[-1].set_xlabel("joint value [deg]")
    figure.supylabel("error of the joint [mrad]", fontsize=8.5)
    return figure


def order(study: Study) -> Figure | None:
    """Held-out errors in the order of the log, where drift and steps show."""
    rows = study.rows
    if rows is None or study.model.about.simulation is not None:
        return None
    middle = float(np.median(rows.distance))
    factor, unit = unit_for(middle, study.model.about.unit)
    errors = factor * rows.distance
    numbers = np.arange(1, len(errors) + 1)
    figure, (ax,) = panels([1.7])
    ax.plot(numbers, errors, ".", color=GREY, rasterized=True)
    window = 15
    if len(errors) >= 2 * window:
        windows = np.lib.stride_tricks.sliding_window_view(errors, window)
        middles = numbers[window // 2 :][: len(windows)]
        ax.plot(middles, np.median(windows, axis=1))
    label = printable(f"error [{unit}]")
    ax.set(xlabel="row of the log", ylabel=label, ylim=(0, None))
    return figure


def arrows(study: Study) -> Figure | None:
    """Held-out errors in space, as arrows from the predicted to the measured position."""
    rows = study.rows
    if rows is None or study.exact:
        return None
    spread = spread_rows(len(rows.x), SETTINGS.arrows)
    unit = study.model.about.unit
    factor = for_people(unit)[0]
    x = factor * rows.x[spread]
    error = factor * rows.held_out[spread]
    length = float(np.quantile(row_lengths(error), 0.95))
    longest = SETTINGS.arrow * float(np.ptp(x, axis=0).max())
    times = float(f"{max(longest / max(length, 1e-12), 1.0):.0e}")
    views = study.views[:2]
    figure, axes = projections(x, views, unit)
    for ax, view in zip(axes, views, strict=True):
        ends = np.stack([x - times * error, x])[:, :, view]
        # a line to each dot, where it was measured
        ax.plot(*ends.transpose(2, 0, 1), color=SECOND, lw=0.8, rasterized=True)
        ax.plot(*ends[1].T, ".", color=SECOND, rasterized=True)
    axes[0].set_title(f"errors, drawn {number(times)} times as long")
    return figure
