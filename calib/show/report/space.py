"""Figures of arms in space: errors in three projections, by joint, and the joints' own curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...body.curves import powers
from ...common.rows import thinned
from ...model.model import Model
from ..error_scale import length_in_words
from .evidence import Evidence
from .maps import PROJECTIONS, WIDE, joint_axis, name_axes
from .style import HUES, new_figure
from .tables import figure_unit

_ARROWS = 250
_LENGTH = 1 / 12  # of the extent: a large residual is drawn so long
_GROUPS = 24  # parts of a joint's range
_FEWEST = 5  # rows that say something of a part


def in_space(model: Model) -> bool:
    """Whether the arm's positions have three coordinates."""
    return len(model.axes) == 3


def has_curves(model: Model) -> bool:
    """Whether the body has error curves of its joints."""
    return bool(_curved(model))


def residual_vectors(evidence: Evidence) -> Any:
    """Measured minus predicted positions as arrows, seen along each axis of the sensor."""
    residuals = evidence.residuals
    if residuals is None:
        return None
    some = thinned(len(residuals.q), _ARROWS)
    x = residuals.x[some]
    off = x - evidence.model.forward(residuals.q[some])
    size = np.linalg.norm(off, axis=1)
    # the largest would shrink all others if it is an outlier
    large = float(np.nanquantile(size, 0.95))
    if not large > 0.0:
        return None
    enlarged = _LENGTH * evidence.extent / large
    figure = new_figure(WIDE, 2.9)
    axes = figure.subplots(1, 3)
    factor, _ = figure_unit(evidence.unit)
    for ax, view in zip(axes, PROJECTIONS[3], strict=True):
        ax.quiver(
            *(factor * x[:, view]).T,
            *(factor * enlarged * off[:, view]).T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.006,
            color=HUES["local"],
        )
        name_axes(ax, evidence, view)
        ax.set_adjustable("datalim")
        ax.grid(visible=True)
    words = length_in_words(large, evidence.unit)
    axes[1].set_title(f"enlarged {enlarged:,.0f} times; 95 % are shorter than {words}")
    return figure


def by_joint(evidence: Evidence) -> Any:
    """Mean and 95 % of the forward error over the value of each joint."""
    residuals, about = evidence.residuals, evidence.model.about
    if residuals is None or not len(residuals.q):
        return None
    errors = residuals.errors[evidence.model.default_readout]
    factor, unit = figure_unit(evidence.unit)
    figure, axes = _each_joint(len(about.joint_names))
    for k, ax in enumerate(axes):
        by, label = joint_axis(about, k)
        q = residuals.q[:, k] * by
        edges = np.linspace(q.min(), q.max() + 1e-12, _GROUPS + 1)
        group = np.digitize(q, edges[1:-1])
        parts = [errors[group == g] for g in range(_GROUPS)]
        known = np.array([len(part) >= _FEWEST for part in parts])
        middle = ((edges[1:] + edges[:-1]) / 2)[known]
        for what, style, of in (
            ("mean", "o-", np.mean),
            ("95 %", "v:", lambda part: np.quantile(part, 0.95)),
        ):
            values = [factor * float(of(p)) for p, use in zip(parts, known, strict=True) if use]
            ax.plot(middle, values, style, color=HUES["local"], markersize=2.5, label=what)
        ax.set(xlabel=label)
        ax.grid(visible=True, axis="y")
        if k % 3 == 0:
            ax.set_ylabel(f"error [{unit}]")
    axes[0].set_ylim(bottom=0.0)
    axes[0].legend(fontsize=7.5)
    return figure


def joint_curves(evidence: Evidence) -> Any:
    """Error curve of each joint with its 95 % interval, over the learned range."""
    model = evidence.model
    curved, body = _curved(model), model.body
    if body is None or not curved:
        return None
    root = body.root
    figure, axes = _each_joint(len(curved))
    rows = None if model.rows is None else model.rows.q
    for ax, k in zip(axes, curved, strict=False):
        by, label = joint_axis(model.about, k)
        low, high = float(model.about.lower[k]), float(model.about.upper[k])
        if rows is not None:
            low, high = float(rows[:, k].min()), float(rows[:, k].max())
        q = np.linspace(low, high, 600)
        # real and imaginary parts of exp(i k q): the body's cosines and sines in one call
        waves = powers(q)
        waves = np.concatenate([waves.real, waves.imag], axis=1)
        index = body.structure.groups[f"curve.{k}"]
        value = 1e3 * (waves @ body.beta[index])
        place = np.searchsorted(body.active, index)
        # beta ~ N(m, R R'): a curve w beta has the standard deviation |w R|
        half = 1.96e3 * np.linalg.norm(waves @ root[place], axis=1)
        ax.fill_between(
            q * by,
            value - half,
            value + half,
            color=HUES["local"],
            alpha=0.25,
            linewidth=0,
        )
        ax.plot(q * by, value, color=HUES["local"], linewidth=1.0)
        ax.set(xlabel=label)
        ax.grid(visible=True, axis="y")
        if k % 3 == 0:
            ax.set_ylabel("curve [mrad]")
    return figure


def _curved(model: Model) -> list[int]:
    body = model.body
    if body is None:
        return []
    groups = body.structure.groups
    curves = [(k, groups.get(f"curve.{k}", ())) for k in range(body.structure.dof)]
    return [k for k, ix in curves if len(ix) and bool(np.isin(ix, body.active).all())]


def _each_joint(n: int) -> tuple[Any, Any]:
    """Axes of as many joints, three in a row."""
    rows = -(-n // 3)
    figure = new_figure(WIDE, 0.4 + 1.7 * rows)
    grid = np.ravel(figure.subplots(rows, 3, squeeze=False, sharey=True))
    for ax in grid[n:]:
        ax.set_visible(False)
    return figure, grid[:n]
