"""Figures of curves: errors by size and by joint, training, bounds, the joints' own curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...body.curves import powers
from ...common.wording import length_in_words
from ...model.nominal import moves_in_space
from .drawing import HUE, HUES, INK, figure_unit, label_steps, over_each_joint, panels
from .evidence import Evidence

_GROUPS, _FEWEST = 24, 5  # parts of a joint's range, and rows that say something of one


def histogram(evidence: Evidence) -> Any:
    """How often errors of each size occur, forward and inverse, beside the sensor's noise."""
    residuals = evidence.residuals
    if residuals is None:
        return None
    figure, [axes] = panels(1, 2, 3.1, sharey=True)
    factor, unit = figure_unit(evidence.unit)
    noise = [evidence.noise] if evidence.noise else []
    sides = {"forward": residuals.errors, "inverse": residuals.distance}
    for ax, (title, found) in zip(axes, sides.items(), strict=True):
        # errors of rounding have no place on a logarithmic axis
        shown = {readout: np.maximum(e, evidence.least) for readout, e in found.items()}
        every = np.concatenate([*shown.values(), noise])
        low, high = every.min(), every.max()
        edges = np.geomspace(low * 0.9, max(high, low * 10) * 1.1, 60)
        for readout, errors in shown.items():
            share = 100 * np.histogram(errors, edges)[0] / len(errors)
            hue, dashes = HUES[readout]
            style: dict[str, Any] = {"color": hue, "linestyle": dashes, "linewidth": 1.6}
            ax.stairs(share, edges * factor, label=readout, **style)
        for value in noise:
            words = f"sensor noise, {length_in_words(value, evidence.unit)} per axis"
            ax.axvline(value * factor, color=_ink(), linewidth=1.0, label=words)
        ax.set(xscale="log", xlabel=f"error [{unit}]", title=title)
        ax.grid(visible=True, axis="y")
    axes[0].set_ylabel("share of the samples [%]")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=7.5)
    return figure


def training(evidence: Evidence) -> Any:
    """Quantization error, topographic error and radius, epoch by epoch."""
    model = evidence.model
    if not len(model.motor.history) or not len(model.sensory.history):
        return None
    figure, grid = panels(3, 2, 4.6, sharex="col")
    labels = "quantization error\n[ranges]", "topographic error\n[share]", "radius sigma\n[nodes]"
    parts = {"motor": model.motor.history, "sensory": model.sensory.history}
    for axes, (name, history) in zip(grid.T, parts.items(), strict=True):
        epoch = np.arange(1, len(history) + 1)
        for ax, label, column in zip(axes, labels, (2, 3, 1), strict=True):
            values = history[:, column]
            ax.plot(epoch, values, "o-", color=HUE, markersize=2.5, linewidth=1.2)
            for change in np.flatnonzero(np.diff(history[:, 0])):
                ax.axvline(change + 1.5, color=_ink(), linewidth=0.6, linestyle=":")
            if column != 3 and (values > 0).any():
                ax.set_yscale("log")
                label_steps(ax.yaxis)
            ax.grid(visible=True, axis="y")
            if name == "motor":
                ax.set_ylabel(label)
        stages = [f"{int(n):,}" for n in dict.fromkeys(history[:, 0].tolist())]
        axes[0].set_title(f"{name} map: lattices of {', '.join(stages)} nodes")
        axes[-1].set_xlabel("epoch")
    return figure


def by_joint(evidence: Evidence) -> Any:
    """Mean and 95 % of the forward error over the value of each joint, of arms in space."""
    residuals, model = evidence.residuals, evidence.model
    if residuals is None or not len(residuals.q) or not moves_in_space(model):
        return None
    factor, unit = figure_unit(evidence.unit)
    errors = residuals.errors[model.default_readout] * factor
    figure, axes = over_each_joint(model.about, range(residuals.q.shape[1]), f"error [{unit}]")
    for k, by, ax in axes:
        q = residuals.q[:, k] * by
        edges = np.linspace(q.min(), q.max() + 1e-12, _GROUPS + 1)
        group = np.digitize(q, edges[1:-1])
        full = np.flatnonzero(np.bincount(group, minlength=_GROUPS) >= _FEWEST)
        parts = [errors[group == g] for g in full]
        at = ((edges[1:] + edges[:-1]) / 2)[full]
        style = {"color": HUE, "markersize": 2.5}
        ax.plot(at, [part.mean() for part in parts], "o-", label="mean", **style)
        ax.plot(at, [np.quantile(part, 0.95) for part in parts], "v:", label="95 %", **style)
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
    figure, axes = over_each_joint(model.about, list(curves), "curve [mrad]")
    measured = [model.about.lower, model.about.upper]
    if model.rows is not None:
        measured = [model.rows.q.min(axis=0), model.rows.q.max(axis=0)]
    for k, by, ax in axes:
        q = np.linspace(measured[0][k], measured[1][k], 600)
        # real and imaginary parts of exp(i k q): the body's cosines and sines in one call
        waves = powers(q)
        waves = np.concatenate([waves.real, waves.imag], axis=1)
        value = 1e3 * (waves @ body.beta[curves[k]])
        # beta ~ N(m, R R'): a curve w beta has the standard deviation |w R|
        root = body.root[np.searchsorted(body.active, curves[k])]
        half = 1.96e3 * np.linalg.norm(waves @ root, axis=1)
        ax.fill_between(q * by, value - half, value + half, color=HUE, alpha=0.25, linewidth=0)
        ax.plot(q * by, value, color=HUE, linewidth=1.0)
    return figure


def _ink() -> str:
    import matplotlib as mpl

    return str(mpl.rcParams["text.color"] or INK)
