"""Figures of curves: error histogram, training, calibration of the expected error."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...common.arrays import Array
from ...maps.node_bounds import COVERAGE
from ..error_scale import ROUNDED_AWAY, length_in_words
from .evidence import Evidence
from .maps import WIDE
from .style import DASHES, HUES, INK, new_figure
from .tables import figure_unit


def _least(evidence: Evidence) -> float:
    """Errors below this are rounding [unit]."""
    return ROUNDED_AWAY if evidence.unit == "m" else ROUNDED_AWAY * evidence.extent


def histogram(evidence: Evidence) -> Any:
    """How often errors of each size occur, forward and inverse, beside the sensor's noise."""
    residuals = evidence.residuals
    if residuals is None:
        return None
    figure = new_figure(WIDE, 3.1)
    axes = figure.subplots(1, 2, sharey=True)
    factor, unit = figure_unit(evidence.unit)
    floor = _least(evidence)
    for ax, found, title in (
        (axes[0], residuals.errors, "forward"),
        (axes[1], residuals.distance, "inverse"),
    ):
        # errors of rounding have no place on a logarithmic axis
        shown = {r: np.maximum(e, floor) for r, e in found.items()}
        low = min(float(e.min()) for e in shown.values())
        high = max(float(e.max()) for e in shown.values())
        if evidence.noise:
            low, high = min(low, evidence.noise), max(high, evidence.noise)
        edges = np.geomspace(low * 0.9, max(high, low * 10) * 1.1, 60)
        for readout, errors in shown.items():
            share = np.histogram(errors, edges)[0] / len(errors)
            ax.stairs(
                100 * share,
                edges * factor,
                label=readout,
                color=HUES[readout],
                linestyle=DASHES[readout],
                linewidth=1.6,
            )
        if evidence.noise:
            words = f"sensor noise, {length_in_words(evidence.noise, evidence.unit)} per axis"
            ax.axvline(evidence.noise * factor, color=_ink(), linewidth=1.0, label=words)
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
    figure = new_figure(WIDE, 4.6)
    grid = figure.subplots(3, 2, sharex="col")
    for column, (name, part) in enumerate((("motor", model.motor), ("sensory", model.sensory))):
        history = part.history
        epoch = np.arange(1, len(history) + 1)
        rows = (
            ("quantization error\n[ranges]", history[:, 2], "log"),
            ("topographic error\n[share]", history[:, 3], "linear"),
            ("radius sigma\n[nodes]", history[:, 1], "log"),
        )
        for ax, (label, values, scale) in zip(grid[:, column], rows, strict=True):
            ax.plot(epoch, values, "o-", color=HUES["local"], markersize=2.5, linewidth=1.2)
            for change in np.flatnonzero(np.diff(history[:, 0])):
                ax.axvline(change + 1.5, color=_ink(), linewidth=0.6, linestyle=":")
            if scale == "log" and (values > 0).any():
                ax.set_yscale("log")
                _label_steps(ax.yaxis)
            ax.grid(visible=True, axis="y")
            if column == 0:
                ax.set_ylabel(label)
        stages = [f"{int(n):,}" for n in dict.fromkeys(history[:, 0].tolist())]
        grid[0, column].set_title(f"{name} map: lattices of {', '.join(stages)} nodes")
        grid[-1, column].set_xlabel("epoch")
    return figure


def calibration(evidence: Evidence) -> Any:
    """Whether errors keep to what is expected of them: the shares within parts of their bounds."""
    pairs = bound_pairs(evidence)
    if pairs is None:
        return None
    bound, error = pairs
    figure = new_figure(WIDE, 2.8)
    ax = figure.subplots()
    ratio = np.sort(error / bound)
    share = 100 * np.arange(1, len(ratio) + 1) / len(ratio)
    keep = np.unique(np.linspace(0, len(ratio) - 1, 400).astype(int))
    ax.plot(ratio[keep], share[keep], color=HUES["local"], linewidth=1.6)
    ax.axvline(1.0, color=_ink(), linewidth=0.8)
    ax.axhline(100 * COVERAGE, color=_ink(), linewidth=0.8, linestyle=":")
    ax.set(
        xlim=(0.0, max(2.0, float(np.quantile(ratio, 0.995)))),
        ylim=(0, 101),
        xlabel="error over expected error",
        ylabel="share of the samples [%]",
        title=f"{100 * coverage(bound, error):.1f} % within their bound",
    )
    return figure


def bound_pairs(evidence: Evidence) -> tuple[Array, Array] | None:
    """Expected and actual errors (n,) of the test samples, None where all is rounding."""
    residuals = evidence.residuals
    if residuals is None or not len(residuals.q):
        return None
    bound = evidence.model.expected_error(residuals.q)
    error = residuals.errors[evidence.model.default_readout]
    known = np.isfinite(bound) & (bound > 0)
    if not known.any() or bound[known].max() < _least(evidence):
        return None
    return bound[known], error[known]


def coverage(bound: Array, error: Array) -> float:
    """Share of the errors that keep to their bound."""
    return float(np.mean(error <= bound))


def _label_steps(axis: Any) -> None:
    """Label 1, 2 and 5 of a logarithmic axis: less than a decade has no power of ten to tell."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())  # laying minor labels out takes half of the drawing


def _ink() -> str:
    import matplotlib as mpl

    return str(mpl.rcParams["text.color"] or INK)
