"""Figures: how accurate, what is off, where, and why so, one function each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...body.curves import waves_of
from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import for_people
from ...model.model import Model
from ...samples.samples import Samples
from ..causes import Cause, causes_of
from ..error_scale import ErrorScale, number, unit_for
from ..judged import Bar, JudgedRows, bars_of, rows_of
from ..robot import Robot
from ..settings import AMOUNTS, LIMITS, Z95
from ..setup import SENSOR, things_of
from ..workspace import bound_field, extent
from .drawing import (
    ACCENT,
    GREY,
    SECOND,
    colour_map,
    error_bar,
    label,
    panels,
    plain_text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FLAT = ((0, 1),)
_IN_SPACE = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class Study:
    """A model with all that figures tell of it, each found when it is first asked for."""

    model: Model
    log: Samples | None = None

    @cached_property
    def rows(self) -> JudgedRows | None:
        """The rows that the model is judged by."""
        return rows_of(self.model, self.log)

    @cached_property
    def bars(self) -> list[Bar]:
        """Mean errors as delivered, as calibrated, and on rows held out."""
        return [] if self.rows is None else bars_of(self.model, self.rows)

    @cached_property
    def causes(self) -> list[Cause]:
        """What is off, the largest effect on the tip first."""
        return causes_of(self.model)

    @property
    def certain(self) -> list[Cause]:
        """Causes whose intervals exclude nothing, but for those that hardly move the tip."""
        least = LIMITS.small * max((cause.effect for cause in self.causes), default=0.0)
        return [
            cause for cause in self.causes if cause.certain and cause.effect > least
        ]

    @property
    def views(self) -> tuple[tuple[int, int], ...]:
        """Pairs of coordinates that positions are projected on."""
        return _IN_SPACE if len(self.model.axes) == 3 else _FLAT


def accuracy(study: Study) -> Figure | None:
    """Mean errors with their intervals as bars."""
    bars = study.bars
    if not bars:
        return None
    largest = max(bar.high for bar in bars)
    factor, unit = unit_for(largest, study.model.about.unit)
    figure, (ax,) = panels(1, 0.45 + 0.4 * len(bars))
    for k, bar in enumerate(bars):
        low = factor * bar.low
        high = factor * bar.high
        ax.barh(
            k,
            factor * bar.mean,
            height=0.34,
            color=GREY if k < len(bars) - 1 else ACCENT,
        )
        ax.plot([low, high], [k, k], color="#010203", linewidth=1.2)
        words = f"{bar.name}: {number(factor * bar.mean)} {unit}"
        if bar.high > bar.low:
            words += f" ({number(low)} to {number(high)})"
        _above(ax, k, words)
    _rows_from_the_top(ax, len(bars))
    ax.set(
        xlim=(0.0, 1.05 * max(factor * largest, 1e-3)),
        xlabel=f"mean error of the tip, 95 % interval [{plain_text(unit)}]",
    )
    return figure


def causes(study: Study) -> Figure | None:
    """What is off: each cause by how far it moves the tip, with its interval."""
    largest = study.certain[: AMOUNTS.causes]
    if not largest:
        return None
    factor, unit = unit_for(largest[0].effect, study.model.about.unit)
    figure, (ax,) = panels(1, 0.45 + 0.34 * len(largest))
    for k, cause in enumerate(largest):
        size = factor * cause.effect
        half = factor * cause.effect_half
        ax.plot(
            [max(size - half, 0.0), size + half], [k, k], color=ACCENT, linewidth=2.2
        )
        ax.plot(size, k, "o", color=ACCENT, markersize=5)
        _above(ax, k, plain_text(cause_words(cause)))
    _rows_from_the_top(ax, len(largest))
    ax.set(xlim=(0.0, None), xlabel=f"moves the tip by, rms [{plain_text(unit)}]")
    return figure


def cause_words(cause: Cause) -> str:
    """A cause with its value and interval: "elbow: zero +0.56 ± 0.003 deg"."""
    factor, unit = for_people(cause.unit)
    if cause.unit == "1":
        factor = 100.0
        unit = "%"
    value = number(abs(factor * cause.value))
    if not cause.half:
        return f"{cause.name} {value} {unit}"
    sign = "+" if cause.value > 0 else "−"
    return f"{cause.name} {sign}{value} ± {number(float(f'{factor * cause.half:.2g}'))} {unit}"


def setup(study: Study) -> Figure | None:
    """Where camera, board and sockets are, to scale with the arm, from the side and from above."""
    things = things_of(study.model)
    robot = Robot.of(study.model.about)
    if robot is None or all(thing.name == SENSOR for thing in things):
        return None
    middle = (study.model.about.lower + study.model.about.upper) / 2
    q = middle if study.rows is None else study.rows.q[len(study.rows.q) // 2]
    poses = robot.poses(q)
    bones = np.array([poses[link][0, :3, 3] for link in robot.links])
    names = [thing.name.partition(" ")[0] for thing in things]
    figure, axes = panels(2, 6.2)
    for ax, (across, up) in zip(axes, ((0, 2), (0, 1)), strict=True):
        ax.plot(
            1e3 * bones[:, across], 1e3 * bones[:, up], "-o", color=GREY, linewidth=3
        )
        ax.plot(0.0, 0.0, "s", color="#010203", markersize=6)
        for k, thing in enumerate(things):
            frame = (
                poses[robot.links[-1]][0] @ thing.frame
                if thing.carried
                else thing.frame
            )
            points = 1e3 * (thing.points @ frame[:3, :3].T + frame[:3, 3])
            colour = ACCENT if names[k] == names[0] else SECOND
            for pair in thing.pairs:
                ax.plot(
                    *points[list(pair)][:, [across, up]].T, color=colour, linewidth=1.2
                )
            name = thing.name.partition(" ")[0]
            ax.plot([], [], color=colour, label="_" if name in names[:k] else name)
        ax.set(
            xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", aspect="equal"
        )
        ax.margins(0.08)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2
    )
    return figure


def where(study: Study) -> Figure | None:
    """The model's bound as a field over the workspace, rows in the colour of their errors."""
    model = study.model
    factor = for_people(model.about.unit)[0]
    x, bound = bound_field(model)
    if not len(x):  # the bound is a tenth of the reach or more everywhere
        return None
    errors = [bound]
    if study.rows is not None:
        errors.append(study.rows.distance)
    scale = ErrorScale.of(np.concatenate(errors), model.about.unit, extent(model))
    sides = np.ptp(x, axis=0)
    heights = [min(sides[up] / sides[across], 1.3) for across, up in study.views]
    figure, axes = panels(
        len(heights), 0.8 + sum(0.35 + 2.9 * height for height in heights)
    )
    image: Any = None
    for ax, view in zip(axes, study.views, strict=True):
        grid, box = _smooth(x[:, view], scale.share(bound))
        image = ax.imshow(
            grid,
            extent=tuple(factor * box),
            origin="lower",
            cmap=colour_map(),
            vmin=0.0,
            vmax=1.0,
            interpolation="bilinear",
        )
        if study.rows is not None:
            _dots(ax, study.rows, view, factor, scale)
        name_axes(ax, model, view)
    error_bar(figure, image, axes, scale, "95 % bound (field), error of rows (dots)")
    return figure


def coverage(study: Study) -> Figure | None:
    """Which part of each joint's range the rows covered, a strip a joint."""
    model = study.model
    if study.rows is None:
        return None
    u = model.motor.scale.to_unit(study.rows.q)
    u = u[thinned(len(u), AMOUNTS.dots)]
    names = model.about.joint_names
    figure, (ax,) = panels(1, 0.45 + 0.36 * len(names))
    shade = max(0.08, min(1.0, 60.0 / len(u)))
    for k, name in enumerate(names):
        factor, unit = for_people(model.about.units_of_joints[k])
        low = factor * model.about.lower[k]
        high = factor * model.about.upper[k]
        ax.barh(k, 100.0, height=0.34, color="none", edgecolor="#020304", linewidth=0.8)
        ax.vlines(
            100.0 * u[:, k],
            k - 0.17,
            k + 0.17,
            color=ACCENT,
            alpha=shade,
            linewidth=1.2,
            rasterized=True,
        )
        _above(ax, k, plain_text(f"{name}: {number(low)} to {number(high)} {unit}"))
    _rows_from_the_top(ax, len(names))
    ax.set(xlim=(0.0, 100.0), xlabel="share of the range [%]")
    return figure


def joints(study: Study) -> Figure | None:
    """What rows say of each joint's error, with the learned error curve and its band."""
    model = study.model
    rows = study.rows
    if (
        rows is None
        or model.body is None
        or model.body.structure.dof != model.motor.units.shape[1]
    ):
        return None
    some = thinned(len(rows.q), AMOUNTS.dots)
    structure = model.body.structure
    turning = np.flatnonzero(structure.revolute)
    figure, axes = panels(len(turning), 0.4 + 1.15 * len(turning))
    offsets = structure.groups["offset"]
    outputs = structure.blocks[0]
    levers = structure.linearise(rows.q[some], model.body.beta, offsets)[1][:, :outputs]
    for ax, k in zip(axes, turning.tolist(), strict=True):
        lever = levers[:, :, k]
        length = np.linalg.norm(lever, axis=1)
        says = length > LIMITS.lever * length.max()
        angle = (rows.held_out[some] * lever).sum(axis=1)[says] / length[says] ** 2
        q = rows.q[some][says, k]
        grid = np.linspace(model.about.lower[k], model.about.upper[k], 200)
        curve, half = _curve(model, k, grid)
        readings = angle + np.interp(q, grid, curve)
        ax.plot(
            np.degrees(q),
            1e3 * readings,
            ".",
            color=GREY,
            markersize=3,
            rasterized=True,
        )
        ax.fill_between(
            np.degrees(grid),
            1e3 * (curve - half),
            1e3 * (curve + half),
            color=ACCENT,
            alpha=0.3,
        )
        ax.plot(np.degrees(grid), 1e3 * curve, color=ACCENT, linewidth=1.2)
        most = (
            float(np.quantile(np.abs(readings), 0.97))
            + float(np.abs(curve).max())
            + 1e-12
        )
        ax.set(ylim=(-1.2e3 * most, 1.2e3 * most))
        ax.locator_params(axis="x", nbins=4)
        ax.locator_params(axis="y", nbins=3)
        ax.set_title(plain_text(structure.joint_names[k]), loc="left")
    axes[-1].set_xlabel("joint value [deg]")
    figure.supylabel("error of the joint [mrad]", fontsize=8.5)
    return figure


def _curve(model: Model, joint: int, q: Array) -> tuple[Array, Array]:
    """Learned error curve (n,) of a joint and half of its 95 % band [rad] at values (n,)."""
    body: Any = model.body
    indices = body.structure.groups[f"curve.{joint}"]
    if not len(indices) or not np.isin(indices, body.active).all():
        return np.zeros(len(q)), np.zeros(len(q))
    waves = waves_of(q).T
    root = body.root[np.searchsorted(body.active, indices)]
    return waves @ body.beta[indices], Z95 * np.linalg.norm(waves @ root, axis=1)


def order(study: Study) -> Figure | None:
    """Held-out errors in the order of the log, where drift and steps show."""
    rows = study.rows
    if rows is None or study.model.about.simulation is not None:
        return None
    factor, unit = unit_for(float(np.median(rows.distance)), study.model.about.unit)
    errors = factor * rows.distance
    figure, (ax,) = panels(1, 1.7)
    ax.plot(
        np.arange(1, len(errors) + 1),
        errors,
        ".",
        color=GREY,
        markersize=3,
        rasterized=True,
    )
    if len(errors) >= 2 * AMOUNTS.window:
        windows = np.lib.stride_tricks.sliding_window_view(errors, AMOUNTS.window)
        middle = np.arange(len(windows)) + AMOUNTS.window // 2 + 1
        ax.plot(middle, np.median(windows, axis=1), color=ACCENT, linewidth=1.2)
    ax.set(
        xlabel="row of the log", ylabel=f"error [{plain_text(unit)}]", ylim=(0.0, None)
    )
    return figure


def arrows(study: Study) -> Figure | None:
    """Held-out errors in space, as arrows from the predicted to the measured position."""
    model = study.model
    rows = study.rows
    if rows is None:
        return None
    some = thinned(len(rows.q), AMOUNTS.arrows)
    x = rows.x[some]
    error = rows.held_out[some]
    sides = np.maximum(np.ptp(x, axis=0), 1e-9)
    length = max(float(np.quantile(np.linalg.norm(error, axis=1), 0.95)), 1e-12)
    times = float(f"{max(LIMITS.arrow * sides.max() / length, 1.0):.0e}")
    views = study.views[:2]
    factor = for_people(model.about.unit)[0]
    heights = [min(sides[up] / sides[across], 1.3) for across, up in views]
    figure, axes = panels(
        len(views), 0.3 + sum(0.45 + 2.9 * height for height in heights)
    )
    for ax, view in zip(axes, views, strict=True):
        ax.quiver(
            *(factor * x[:, view]).T,
            *(factor * times * error[:, view]).T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.005,
            color=SECOND,
            rasterized=True,
        )
        name_axes(ax, model, view)
    axes[0].set_title(f"errors, drawn {number(times)} times as long", loc="left")
    return figure


def trust(study: Study) -> Figure | None:
    """Share of rows within the p % bound against p; a bound that holds follows the diagonal."""
    from scipy.special import chdtri

    model = study.model
    rows = study.rows
    if rows is None or model.about.simulation is not None:
        return None
    bound = model.expected_error(rows.q)
    outputs = rows.x.shape[1]
    p = np.linspace(0.02, 0.99, 60)
    radius = np.sqrt(chdtri(outputs, 1.0 - p) / chdtri(outputs, 0.05))
    ratio = rows.distance / np.maximum(bound, 1e-300)
    share = (ratio[:, None] <= radius).mean(axis=0)
    chance = Z95 * np.sqrt(p * (1.0 - p) / len(ratio))
    figure, (ax,) = panels(1, 2.4)
    ax.fill_between(
        100 * p, 100 * (p - chance), 100 * (p + chance), color=GREY, alpha=0.3
    )
    ax.plot([0, 100], [0, 100], color=GREY, linewidth=0.8)
    ax.plot(100 * p, 100 * share, color=ACCENT, linewidth=1.6)
    ax.set(
        xlim=(0, 100),
        ylim=(0, 100),
        xlabel="bound that should hold [%]",
        ylabel="rows within [%]",
    )
    return figure


def sockets(study: Study) -> Figure | None:
    """Distances of tips from their socket, as delivered and held out, by socket."""
    rows = study.rows
    if rows is None or study.model.body is None or rows.fresh:
        return None
    places, number_of = np.unique(rows.x, axis=0, return_inverse=True)
    if len(places) > len(rows.x) // 3:  # no touches
        return None
    figure, (ax,) = panels(1, 0.8 + 0.4 * len(places))
    for name, errors, up, colour in (
        ("as delivered", rows.delivered, -0.16, GREY),
        ("held out", rows.held_out, 0.16, ACCENT),
    ):
        if errors is not None:
            off = 1e3 * np.linalg.norm(errors, axis=1)
            ax.plot(
                off, number_of.ravel() + up, ".", color=colour, alpha=0.6, label=name
            )
    ax.set_yticks(range(len(places)), [f"socket {k + 1}" for k in range(len(places))])
    ax.set(xlabel="distance from the socket [mm]", xlim=(0.0, None))
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def name_axes(ax: Axes, model: Model, view: tuple[int, int] = (0, 1)) -> None:
    """Name the axes of two coordinates."""
    across, up = ("xyz"[k] for k in view)
    ax.set(
        xlabel=label(across, model.about.unit)[1],
        ylabel=label(up, model.about.unit)[1],
        aspect="equal",
    )
    ax.locator_params(nbins=4)
    if model.about.unit == "px":  # a picture's y runs down
        ax.invert_yaxis()


def _above(ax: Axes, row: int, words: str) -> None:
    """Write words above a row, from the left edge on."""
    ax.annotate(
        words,
        (0.0, row),
        (0, 7),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
    )


def _rows_from_the_top(ax: Axes, count: int) -> None:
    """Make room for rows of bars with words above, the first on top, without a frame."""
    ax.set(ylim=(count - 0.6, -0.75), yticks=[])
    ax.locator_params(axis="x", nbins=4)
    ax.spines[["left", "right", "top"]].set_visible(False)


def _smooth(points: Array, share: Array) -> tuple[Any, Array]:
    """Mean of values (n,) over a grid of points (n, 2), masked far from them, and its box (4,)."""
    from scipy.ndimage import gaussian_filter

    cells = 110
    low = points.min(axis=0)
    high = points.max(axis=0)
    margin = 0.06 * (high - low).max()
    box = np.column_stack([low - margin, high + margin])
    finite = np.isfinite(share)
    x, y = points[finite].T
    counts = np.histogram2d(x, y, cells, box.tolist())[0]
    sums = np.histogram2d(x, y, cells, box.tolist(), weights=share[finite])[0]
    weight = gaussian_filter(counts, 2.6)
    total = gaussian_filter(sums, 2.6)
    thin = weight < LIMITS.thin * np.median(weight[counts > 0])
    grid = np.ma.masked_where(thin, total / np.maximum(weight, 1e-12))
    return grid.T, box.ravel()


def _dots(
    ax: Axes, rows: JudgedRows, view: tuple[int, int], factor: float, scale: ErrorScale
) -> None:
    """Draw rows in the colour of their errors, and crosses for those that were left out."""
    some = thinned(len(rows.x), AMOUNTS.dots)
    ax.scatter(
        factor * rows.x[some, view[0]],
        factor * rows.x[some, view[1]],
        c=scale.share(rows.distance[some]),
        cmap=colour_map(),
        vmin=0.0,
        vmax=1.0,
        s=9,
        linewidths=0.5,
        edgecolors="white",
        rasterized=True,
    )
    if rows.left_out is not None:
        ax.plot(
            *(factor * rows.left_out[:, view]).T, "x", color="#010203", markersize=4
        )
