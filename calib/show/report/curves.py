"""Figures of curves: errors by socket, training, the joints' own curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...body.curves import powers
from ...model.nominal import nominal_arm
from .drawing import HUE, INK, joint_axis, label_steps, panels
from .evidence import Evidence


def training(evidence: Evidence) -> Any:
    """Quantization error, topographic error and radius, epoch by epoch."""
    import matplotlib as mpl

    parts = {"motor": evidence.model.motor.history, "sensory": evidence.model.sensory.history}
    if not all(map(len, parts.values())):
        return None
    figure, grid = panels(3, 2, 4.6, sharex="col")
    ink = str(mpl.rcParams["text.color"])
    labels = "quantization error\n[ranges]", "topographic error\n[share]", "radius sigma\n[nodes]"
    for axes, (name, history) in zip(grid.T, parts.items(), strict=True):
        epoch = np.arange(1, len(history) + 1)
        for ax, label, column in zip(axes, labels, (2, 3, 1), strict=True):
            values = history[:, column]
            ax.plot(epoch, values, "o-", color=HUE, markersize=2.5, linewidth=1.2)
            for change in np.flatnonzero(np.diff(history[:, 0])):
                ax.axvline(change + 1.5, color=ink, linewidth=0.6, linestyle=":")
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
    rows = -(-len(curves) // 3)
    figure, grid = panels(rows, 3, 0.4 + 1.7 * rows, sharey=True, sharex=False)
    for ax in grid.flat[len(curves) :]:
        ax.set_visible(False)
    measured = [model.about.lower, model.about.upper]
    if model.rows is not None:
        measured = [model.rows.q.min(axis=0), model.rows.q.max(axis=0)]
    for k, ax in zip(curves, grid.flat, strict=False):
        by, name = joint_axis(model.about, k)
        ax.set(xlabel=name, ylabel="curve [mrad]" if ax in grid[:, 0] else "")
        ax.grid(visible=True, axis="y")
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


def by_socket(evidence: Evidence) -> Any:
    """Distances of tips from the mean of their socket, by the drawing and as learned."""
    log, model = evidence.touches, evidence.model
    if log is None or log.touch is None:
        return None
    touch, q = log.touch, model.about.joints_of(log)
    tips = {"as learned": model.forward(q)}
    if model.about.urdf:
        tips = {"as drawn": nominal_arm(model).forward(q), **tips}
    names = [" ".join(each).strip() for each in touch.sockets]
    figure, [[ax]] = panels(1, 1, 1.0 + 0.32 * len(names))
    for k, (label, tip) in enumerate(tips.items()):
        hue, up = (INK, HUE)[k - len(tips)], 0.16 - 0.32 * k
        off = 1e3 * np.linalg.norm(tip - touch.means(tip)[touch.number], axis=1)
        off[touch.number < 0] = np.nan
        ax.plot(off, touch.number + up, ".", color=hue, alpha=0.35, ms=4)
        mean = [np.nanmean(off[touch.number == j]) for j in range(len(names))]
        ax.plot(mean, np.arange(len(names)) + up, "|", color=hue, ms=11, mew=2.2, label=label)
    ax.set_yticks(range(len(names)), names)
    ax.set(xscale="log", xlabel="distance from the socket's mean [mm] (bars: mean)")
    ax.grid(visible=True, axis="x")
    figure.legend(loc="outside lower center", ncols=2, fontsize=7.5)
    return figure
