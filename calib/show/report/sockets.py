"""The figure of sockets: how far tips scatter about each, by the drawing and as learned."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...model.nominal import nominal_arm
from .drawing import HUE, INK, panels
from .evidence import Evidence


def by_socket(evidence: Evidence) -> Any:
    """Distances of tips from the mean of their socket, before and after."""
    log, model = evidence.touches, evidence.model
    if log is None or log.touch is None:
        return None
    touch = log.touch
    tips = {"as learned": model.forward(model.about.joints_of(log))}
    if model.about.urdf:
        tips = {"as drawn": nominal_arm(model).forward(model.about.joints_of(log)), **tips}
    names = [" ".join(each).strip() for each in touch.sockets]
    figure, [[ax]] = panels(1, 1, 1.0 + 0.32 * len(names))
    for k, (label, tip) in enumerate(tips.items()):
        means, hue = touch.means(tip), (INK, HUE)[k - len(tips)]
        off = 1e3 * np.linalg.norm(tip - means[touch.number], axis=1)
        off[touch.number < 0] = np.nan
        height = touch.number + 0.16 - 0.32 * k
        mean = [np.nanmean(off[touch.number == j]) for j in range(len(names))]
        ax.plot(off, height, ".", color=hue, alpha=0.35, markersize=4)
        at = np.arange(len(names)) + 0.16 - 0.32 * k
        ax.plot(mean, at, "|", color=hue, markersize=11, markeredgewidth=2.2, label=label)
    ax.set_yticks(range(len(names)), names)
    ax.set(xscale="log", xlabel="distance from the socket's mean [mm] (bars: mean)")
    ax.grid(visible=True, axis="x")
    figure.legend(loc="outside lower center", ncols=2, fontsize=7.5)
    return figure
