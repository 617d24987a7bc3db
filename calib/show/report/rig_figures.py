"""Figures of a rig: where cameras and board are, and how far corners are off by picture."""

import numpy as np
from matplotlib.figure import Figure

from ...recording.rig import HandEye
from ..setup import things_of_rig
from .drawing import GREY, panels
from .figures import draw_setup


def setup(rig: HandEye) -> Figure:
    """Base, flange, cameras and board to scale, at the motion in the middle of all."""
    flange = rig.flange[len(rig.flange) // 2]
    return draw_setup(np.array([np.eye(4), flange]), things_of_rig(rig))


def misses(rig: HandEye) -> Figure:
    """How far corners are from where a fit that did not see their picture expects them."""
    figure, (ax,) = panels([1.9])
    rows = np.arange(1, len(rig.misses) + 1)
    out = np.isin(rig.names, rig.left_out)
    ax.bar(rows[~out], rig.misses[~out])
    if out.any():
        ax.bar(rows[out], rig.misses[out], color=GREY, label="left out")
        figure.legend(loc="outside lower center")
    ax.set(xlabel="picture", ylabel="corners off, rms [px]")
    ax.locator_params(axis="x", integer=True)
    return figure
