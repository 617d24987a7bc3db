"""Figures of a rig: where cameras and board are, how far corners are off, by picture and in one."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

import numpy as np

from ...common.wording import number
from ...recording.rig import HandEye
from ..setup import things_of_rig
from .drawing import GREY, INK, SECOND, panels
from .figures import draw_setup

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def corners(rig: HandEye) -> Figure | None:
    """Corners over a picture that the fit did not see, as predicted and as seen."""
    if rig.photo is None:
        return None
    from PIL import Image

    jpeg = base64.b64decode(rig.photo["jpeg"])
    with Image.open(io.BytesIO(jpeg)) as opened:
        pixels = np.asarray(opened.convert("L"))
    width, height = rig.lens["size"]
    figure, (ax,) = panels([3.5 * height / width + 0.5])
    box = (-0.5, width - 0.5, height - 0.5, -0.5)
    ax.imshow(
        pixels, extent=box, origin="upper", cmap="gray", vmin=-150, vmax=280
    )
    seen = np.array(rig.photo["corners"])
    off = np.array(rig.photo["predicted"]) - seen
    length = float(np.linalg.norm(off, axis=1).max())
    times = float(f"{max(0.05 * width / max(length, 1e-9), 1.0):.0e}")
    ends = np.stack([seen, seen + times * off])
    ax.plot(
        *seen.T,
        "o",
        ms=3,
        mfc="none",
        label="seen",
    )
    lines = ax.plot(*ends.transpose(2, 0, 1), color=SECOND)
    lines[0].set_label(f"to predicted, {number(times)} times as long")
    ax.set(
        xticks=[],
        yticks=[],
        xlim=box[:2],
        ylim=box[2:],
    )
    ax.set_title(rig.photo["name"], color=INK)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
