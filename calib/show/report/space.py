"""Figures of arms in space: errors in three projections, by joint, and the joints' own curves."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from ...body.curves import powers
from ...common.rows import thinned
from ...model.model import Model
from ...model.nominal import moves_in_space
from ..error_scale import length_in_words
from .evidence import Evidence
from .maps import PROJECTIONS, WIDE, joint_axis, name_axes
from .style import HUES, new_figure
from .tables import figure_unit

_ARROWS = 250
_LENGTH = 1 / 12  # of the extent: a large residual is drawn so long
_GROUPS = 24  # parts of a joint's range
_FEWEST = 5  # rows that say something of a part


def residual_vectors(evidence: Evidence) -> Any:
    """Measured minus predicted positions as arrows, seen along each axis of the sensor."""
    residuals = evidence.residuals
    if residuals is None or len(evidence.model.axes) < 3:
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
    """Mean and 95 % of the forward error over the value of each joint, of arms in space."""
    residuals, model = evidence.residuals, evidence.model
    if residuals is None or not len(residuals.q) or not moves_in_space(model):
        return None
    errors = residuals.errors[model.default_readout]
    factor, unit = figure_unit(evidence.unit)
    figure, axes = _each_joint(model, range(residuals.q.shape[1]), f"error [{unit}]")
    for k, by, ax in axes:
        q = residuals.q[:, k] * by
        edges = np.linspace(q.min(), q.max() + 1e-12, _GROUPS + 1)
        group = np.digitize(q, edges[1:-1])
        parts = [errors[group == g] * factor for g in range(_GROUPS)]
        middle = (edges[1:] + edges[:-1]) / 2
        known = [(m, part) for m, part in zip(middle, parts, strict=True) if len(part) >= _FEWEST]
        for what, style, of in (
            ("mean", "o-", np.mean),
            ("95 %", "v:", lambda part: np.quantile(part, 0.95)),
        ):
            rows = [(m, float(of(part))) for m, part in known]
            ax.plot(
                *zip(*rows, strict=True), style, color=HUES["local"], markersize=2.5, label=what
            )
    axes[0][2].set_ylim(bottom=0.0)
    axes[0][2].legend(fontsize=7.5)
    return figure


def joint_curves(evidence: Evidence) -> Any:
    """Error curve of each joint with its 95 % interval, over the measured range."""
    model, body = evidence.model, evidence.model.body
    if body is None:
        return None
    groups = body.structure.groups
    curves = {k: groups.get(f"curve.{k}", ()) for k in range(body.structure.dof)}
    curves = {k: ix for k, ix in curves.items() if len(ix) and np.isin(ix, body.active).all()}
    if not curves:
        return None
    root = body.root
    figure, axes = _each_joint(model, curves, "curve [mrad]")
    for k, by, ax in axes:
        low, high = model.about.lower[k], model.about.upper[k]
        if model.rows is not None:
            low, high = model.rows.q[:, k].min(), model.rows.q[:, k].max()
        q = np.linspace(low, high, 600)
        # real and imaginary parts of exp(i k q): the body's cosines and sines in one call
        waves = powers(q)
        waves = np.concatenate([waves.real, waves.imag], axis=1)
        value = 1e3 * (waves @ body.beta[curves[k]])
        place = np.searchsorted(body.active, curves[k])
        # beta ~ N(m, R R'): a curve w beta has the standard deviation |w R|
        half = 1.96e3 * np.linalg.norm(waves @ root[place], axis=1)
        ax.fill_between(
            q * by, value - half, value + half, color=HUES["local"], alpha=0.25, linewidth=0
        )
        ax.plot(q * by, value, color=HUES["local"], linewidth=1.0)
    return figure


def _each_joint(model: Model, joints: Collection[int], label: str) -> tuple[Any, Any]:
    """A figure, and of some joints their numbers, factors for their unit and axes, three in a row.

    label : of the vertical axes
    """
    rows = -(-len(joints) // 3)
    figure = new_figure(WIDE, 0.4 + 1.7 * rows)
    grid = figure.subplots(rows, 3, squeeze=False, sharey=True)
    found = []
    for k, ax in zip(joints, grid.flat, strict=False):
        by, name = joint_axis(model.about, k)
        ax.set(xlabel=name)
        ax.grid(visible=True, axis="y")
        found.append((k, by, ax))
    for ax in grid.flat[len(joints) :]:
        ax.set_visible(False)
    for row in grid:
        row[0].set_ylabel(label)
    return figure, found
